"""Densities that are stated as zero: nothing disturbs the motion, and every estimator can run."""

from dataclasses import replace

import numpy as np
import pytest

from spinfilters.inference.noise_choice import LEAST_STEP
from spinfilters.io.dataset import Dataset, DatasetOptions
from spinfilters.models.process import ProcessNoise
from spinfilters.run.estimation import compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import ProcessSettings, Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_noise

ZERO = ProcessSettings(force_psd=0.0, torque_psd=0.0, gravity=False)


@pytest.mark.parametrize("by", ["settings", "data set"])
def test_a_density_stated_as_zero_is_hardly_any(by: str) -> None:
    recording = simulate(Scenario.simplified(kind="pose", rate_rpm=RICH_RPM, epochs=12))
    settings = Settings(process=ZERO if by == "settings" else ProcessSettings(gravity=False))
    if by == "data set":
        recording = replace(recording, options=DatasetOptions(force_psd=0.0, torque_psd=0.0))
    noise = prepare(recording, settings).process.noise
    interval = recording.log.streams[0].time[1] - recording.log.streams[0].time[0]
    assert noise.force_psd == noise.torque_psd
    assert np.sqrt(noise.force_psd * interval**3 / 3) == pytest.approx(LEAST_STEP)


def undisturbed_throw() -> Dataset:
    """Poses at 300 Hz, whose steps have the smallest covariance."""
    scenario = Scenario.simplified(
        kind="pose",
        rate_rpm=(80.0, 180.0, 60.0),
        epochs=90,
        interval=1 / 300,
        noise=ProcessNoise(0.0, 0.0),
        seed=2,
    )
    return without_noise(simulate(scenario))


def test_an_undisturbed_throw_is_estimated_with_densities_of_zero() -> None:
    settings = Settings(("mekf", "smoother"), process=ZERO, verdict="filter")
    setup = prepare(undisturbed_throw(), settings)
    for each in compare_estimators(setup, settings, lambda *_: None).evaluations:
        assert not each.history.has_failed
        assert each.nees is not None
        assert each.nees.mean < 2


def test_densities_too_small_to_be_computed_with_end_in_no_trace() -> None:
    small = ProcessSettings(force_psd=1e-12, torque_psd=1e-12)
    prepare(undisturbed_throw(), Settings(process=small))
