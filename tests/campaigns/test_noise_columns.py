"""Rows of a campaign have the true and identified levels of every sensor that can be simulated."""

import pytest

from spinfilters.campaigns.recording_factors import (
    BodyFactor,
    FaultFactor,
    MotionFactor,
    NoiseFactor,
    RecordingFactors,
    SensorFactor,
)
from spinfilters.campaigns.row_columns import noise_levels
from spinfilters.io.sensor_format import dataset_kinds
from spinfilters.simulation.scenario import Scenario, simulate


@pytest.mark.parametrize("kind", dataset_kinds())
def test_the_true_levels_of_a_simulated_recording_are_in_the_rows(kind: str) -> None:
    dataset = simulate(Scenario.simplified(kind=kind, epochs=4, landmarks=20))
    told = dataset.options.sensor_noise
    factors = RecordingFactors(MotionFactor(), BodyFactor(), SensorFactor(), NoiseFactor(), FaultFactor())
    levels = factors.levels
    assert told
    assert told.keys() <= levels.keys()
    assert {name: levels[name] for name in told} == pytest.approx(dict(told))
    assert set(levels) == set(noise_levels())
