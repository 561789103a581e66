"""How far interpolated poses of a camera are off where its path bends."""

import numpy as np
import pytest

from spinfilters.core.attitude_conversions import angle_between
from spinfilters.core.camera_trajectory import CameraTrajectory, Displacement, drifting, later, turning
from spinfilters.simulation.inspector import INSPECTORS

CENTRE = np.array([0.0, 0.0, 0.6])


def paths(name: str, apart: float) -> tuple[CameraTrajectory, np.ndarray, np.ndarray]:
    """Poses so many seconds apart; times in between with the right poses there."""
    make = INSPECTORS[name]
    assert make is not None
    path, time = make(CENTRE, 0), np.arange(0.0, 60.0 + apart, apart)
    between = np.linspace(apart, 60.0 - apart, 301)
    return CameraTrajectory(time, path(time)), between, path(between)


@pytest.mark.parametrize(("name", "apart"), [("circle", 2.0), ("circle", 5.0), ("sway", 1.0), ("sway", 3.0)])
def test_the_bends_of_sparse_poses_tell_what_interpolation_errs_by(name: str, apart: float) -> None:
    trajectory, time, right = paths(name, apart)
    place, turn = trajectory.interpolation_errors(time)
    off = trajectory.at(time)
    true_place = np.linalg.norm(off[:, :3] - right[:, :3], axis=1)
    true_turn = angle_between(off[:, 3:], right[:, 3:])
    assert np.sqrt(np.mean(place**2)) == pytest.approx(np.sqrt(np.mean(true_place**2)), rel=0.25)
    assert np.sqrt(np.mean(turn**2)) == pytest.approx(np.sqrt(np.mean(true_turn**2)), rel=0.25, abs=1e-7)


def test_poses_at_the_stamps_and_straight_paths_have_no_error() -> None:
    trajectory, _, _ = paths("sway", 3.0)
    place, turn = trajectory.interpolation_errors(trajectory.time)
    np.testing.assert_allclose([place, turn], 0.0)
    straight = np.zeros((9, 7))
    straight[:, 0], straight[:, 6] = np.arange(9.0), 1.0
    place, turn = CameraTrajectory(np.arange(9.0), straight).interpolation_errors(np.linspace(0, 8, 50))
    np.testing.assert_allclose([place, turn], 0.0, atol=1e-12)


def test_noise_of_dense_poses_is_no_bend() -> None:
    """Denser poses, the cure of sparse ones, would else make it worse."""
    trajectory, time, _ = paths("sway", 0.1)
    noisy = trajectory.poses.copy()
    noisy[:, :3] += np.random.default_rng(5).normal(0.0, 1e-3, (len(noisy), 3))
    place, _ = CameraTrajectory(trajectory.time, noisy).interpolation_errors(time)
    assert np.sqrt(np.mean(place**2)) < 0.15e-3  # all of the second differences would be 0.3 mm


def test_two_poses_tell_no_bend() -> None:
    trajectory = CameraTrajectory(np.array([0.0, 1.0]), np.tile([0.0, 0, 0, 0, 0, 0, 1], (2, 1)))
    np.testing.assert_allclose(trajectory.interpolation_errors(np.array([0.5])), 0.0)


@pytest.mark.parametrize("displacement", [later, drifting, turning])
def test_a_camera_that_sees_nothing_is_displaced_by_nothing(displacement: Displacement) -> None:
    assert displacement(np.zeros(0), np.zeros((0, 7))).shape[:2] == (0, 6)
