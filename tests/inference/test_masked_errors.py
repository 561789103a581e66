"""Gross errors for which identified levels would rise until they pass the gate."""

from dataclasses import replace

import numpy as np
import pytest

from spinfilters.inference.setup import Setup
from spinfilters.io.dataset import Dataset
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.measurement_faults import with_stream
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_noise

SETTINGS = Settings(process={"gravity": False})  # pyright: ignore[reportArgumentType]
STD = {"gyro": 0.002, "pose": 0.005}


def silent(kind: str, seed: int = 2) -> Dataset:
    """A short rich motion of which nobody states the noise."""
    return without_noise(
        simulate(Scenario.simplified(kind=kind, rate_rpm=RICH_RPM, epochs=50, interval=0.4, seed=seed))
    )


def with_first_off(dataset: Dataset, kind: str, deviations: float = 10.0) -> Dataset:
    """The first rate or place off by so many standard deviations."""
    (stream,) = dataset.log.streams
    values = stream.values.copy()
    values[0, :3] += deviations * STD[kind] * np.array([0.6, 0.0, -0.8])
    return with_stream(dataset, replace(stream, values=values))


def levels(setup: Setup) -> dict[str, float]:
    """As identified by the initialisation."""
    return {each.name: each.value for each in setup.identified}


@pytest.mark.parametrize("kind", ["gyro", "pose"])
def test_a_gross_error_at_the_begin_leaves_the_levels_as_they_are(kind: str) -> None:
    dataset = silent(kind)
    right, wrong = prepare(dataset, SETTINGS), prepare(with_first_off(dataset, kind), SETTINGS)
    assert (right.initial.rejected, wrong.initial.rejected) == (0, 1)
    for name, value in levels(right).items():
        assert levels(wrong)[name] == pytest.approx(value, rel=0.5), name


@pytest.mark.parametrize(("kind", "seed"), [("gyro", 3), ("gyro", 4), ("pose", 4)])
def test_a_first_measurement_off_by_eight_deviations_is_refused(kind: str, seed: int) -> None:
    dataset = with_first_off(silent(kind, seed), kind, 8.0)
    assert prepare(dataset, SETTINGS).initial.rejected == 1
