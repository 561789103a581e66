"""Scenarios have one source of defaults: the bundled example."""

import inspect
from dataclasses import replace

import pytest

from observability.analysis_report import assumptions
from spinfilters.api.analysis import observe
from spinfilters.api.simulation import simulate
from spinfilters.campaigns.recording_factors import (
    BodyFactor,
    FaultFactor,
    MotionFactor,
    NoiseFactor,
    RecordingFactors,
    SensorFactor,
)
from spinfilters.cli.main import parser
from spinfilters.models.process import THESIS_NOISE
from spinfilters.simulation.image_sequence import ImageScenario
from spinfilters.simulation.scenario import Scenario


def test_a_campaign_that_varies_nothing_simulates_the_default_scenario() -> None:
    factors = RecordingFactors(MotionFactor(), BodyFactor(), SensorFactor(), NoiseFactor(), FaultFactor())
    assert factors.scenario == Scenario() == Scenario.common_workload()


@pytest.mark.parametrize("function", [simulate, observe])
def test_python_has_the_defaults_of_a_scenario(function: object) -> None:
    signature = inspect.signature(function).parameters  # pyright: ignore[reportArgumentType]
    given = {name: signature[name].default for name in ("rate_rpm", "moments", "frames", "interval")}
    default = Scenario()
    assert given == {
        "rate_rpm": default.rate_rpm,
        "moments": default.principal_moments,
        "frames": default.epochs,
        "interval": default.interval,
    }


@pytest.mark.parametrize("command", [["simulate", "-o", "x"], ["observe"]])
def test_the_command_line_has_the_defaults_of_a_scenario(command: list[str]) -> None:
    options, default = parser().parse_args(command), Scenario()
    assert (options.frames, options.interval) == (default.epochs, default.interval)
    assert (options.rate_rpm, options.moments) == (default.rate_rpm, default.principal_moments)


def test_rendered_images_are_of_the_default_motion() -> None:
    default = Scenario()
    assert replace(ImageScenario().scenario, radius_m=default.radius_m) == default


def test_the_analyser_assumes_the_disturbances_of_the_example() -> None:
    assert Scenario().noise == THESIS_NOISE
    text = " ".join(assumptions(observe("pose", frames=3).report.case))
    assert f"{THESIS_NOISE.force_psd:g} (m/s^2)^2/Hz" in text
