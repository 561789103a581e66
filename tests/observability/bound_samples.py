"""Flights before a stereo pair for the tests of the bound."""

import numpy as np

from observability.canonical_motions import CanonicalMotion, landmarks, point_of
from observability.coordinates import FilterChart
from observability.exact_numbers import as_floats
from observability.reference_trajectory import ReferenceTrajectory, SensorSchedule, free_reference
from spinfilters.models.camera_landmarks import StereoLandmark, camera_parameters
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout

LAYOUT = StateLayout(FULL_BLOCKS)
CALIBRATION = np.array([466.7, 470.0, 320.0, 240.0, 0.09])
MODEL = StereoLandmark(LAYOUT)


def flight_of(
    motion: CanonicalMotion, frames: int, interval: float, noise: ProcessNoise
) -> ReferenceTrajectory:
    """A free motion over frames."""
    process = TorqueFreeProcess(LAYOUT, noise, tolerance=1e-13)
    return free_reference(process, as_floats(point_of(FilterChart(LAYOUT), motion)), frames, interval)


def stereo_watch(count: int, frames: int, pixel_std: float = 1.0) -> SensorSchedule:
    """Unknown landmarks, of which each is missed now and then."""
    points = np.stack([as_floats(point) for point in landmarks(count)])
    seen = (np.arange(frames)[:, np.newaxis] + np.arange(count)) % 5 > 0
    return SensorSchedule(MODEL, camera_parameters(points, CALIBRATION, pixel_std), 3, seen)
