"""Every cell of a ready study has enough to begin with: a study that nobody had run saw two landmarks."""

import numpy as np
import pytest

from spinfilters.campaigns.filter_comparison import NAMES, ready_study
from spinfilters.campaigns.recording_factors import FaultFactor
from spinfilters.simulation.scenario import simulate

FEWEST_SEEN = 4
"""Landmarks that an epoch must show for a start from poses."""


@pytest.mark.parametrize("name", NAMES)
def test_cameras_of_a_ready_study_see_enough_landmarks(name: str) -> None:
    scenarios = {
        repr(cell.recording.scenario): cell.recording.scenario
        for cell in ready_study(name).cells
        if cell.recording.fault == FaultFactor() and cell.recording.scenario.kind.endswith("tracks")
    }
    for scenario in scenarios.values():
        stream = simulate(scenario).log.streams[0]
        _, counts = np.unique(stream.time, return_counts=True)
        assert len(counts) == scenario.epochs
        assert counts.min() >= FEWEST_SEEN
