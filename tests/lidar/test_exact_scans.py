"""Scans without noise: corners and rotations to rounding, both of the thesis' sequences."""

import pytest

from experiments.lidar_attitude import corner_error, transitions
from spinfilters.lidar.scan import LidarNoise


@pytest.mark.parametrize("sequence", [0, 1])
def test_corners_without_noise_are_exact_at_500_m(sequence: int) -> None:
    assert 0 < corner_error(500.0, 0.24, sequence, 71) < 1e-10


@pytest.mark.parametrize("sequence", [0, 1])
def test_transitions_without_noise_are_exact_at_500_m(sequence: int) -> None:
    assert transitions(500.0, 0.24, sequence, 0, 51, LidarNoise()) < 1e-9
