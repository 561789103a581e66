"""Poses predicted from scans of which some do not determine theirs."""

from collections.abc import Sequence

import numpy as np
import pytest

from spinfilters.core.attitude_conversions import matrix_from_rotation_vector
from spinfilters.lidar.scan_pose import (
    ScanPose,
    interpolated_rotation,
    predicted_pose,
    rates_of_steps,
    rotation_vector,
)

RATE, VELOCITY, PLACE = np.array([0.1, 0.2, -0.15]), np.array([0.0, 0.01, 0.02]), np.array([30.0, 0.0, 0.0])
CENTRE, SIZE = np.array([0.4, -0.2, 0.3]), 1.5


def pose(time: float, turn: Sequence[float], shift: Sequence[float], std: float) -> ScanPose:
    """Of a body that turns about its centre, with errors, rad and m."""
    R = matrix_from_rotation_vector(RATE * time)
    t = PLACE + VELOCITY * time - R @ CENTRE
    covariance = std**2 * np.eye(6)
    return ScanPose(time, matrix_from_rotation_vector(np.array(turn)) @ R, t + np.array(shift), covariance)


def off(poses: Sequence[ScanPose], time: float) -> tuple[float, float]:
    """Errors of the prediction, rad and m."""
    R, t = predicted_pose(poses, time, SIZE)
    true = pose(time, (0, 0, 0), (0, 0, 0), 1.0)
    return float(np.linalg.norm(rotation_vector(R @ true.rotation.T))), float(
        np.linalg.norm(t - true.translation)
    )


@pytest.mark.parametrize("count", [4, 12, 30])
def test_a_body_that_turns_about_its_centre_is_where_it_is_predicted(count: int) -> None:
    turned, shifted = off([pose(k, (0, 0, 0), (0, 0, 0), 1e-6) for k in range(count)], count + 2.0)
    assert turned < 1e-6
    assert shifted < 1e-3


def test_noise_of_the_last_scans_does_not_carry_a_prediction_away() -> None:
    generator = np.random.default_rng(0)
    noise = 0.03 * generator.standard_normal((15, 2, 3))
    poses = [pose(k, turn, shift, 0.03) for k, (turn, shift) in enumerate(noise)]
    turned, shifted = off(poses, 19.0)
    assert turned < 0.15
    assert shifted < 0.15


def test_scans_that_determine_nothing_have_no_say() -> None:
    sure = [pose(k, (0, 0, 0), (0, 0, 0), 1e-3) for k in range(10)]
    lost = [pose(10 + k, (0, 0, 0), (0.0, 1.0 + k, 0.0), 1.5) for k in range(4)]
    assert off([*sure, *lost], 15.0)[1] < 0.05


def test_one_scan_predicts_itself() -> None:
    first = pose(0.0, (0, 0, 0), (0, 0, 0), 1e-3)
    R, t = predicted_pose([first], 5.0, SIZE)
    assert R is first.rotation
    assert t is first.translation


@pytest.mark.parametrize("number", [0, 4, 8])
def test_a_scan_that_does_not_determine_its_rotation_is_led_by_its_neighbours(number: int) -> None:
    poses = [pose(k, (0, 0, 0), (0, 0, 0), 1e-6) for k in range(9)]
    poses[number] = pose(number, (0.3, 0.4, 0.0), (0, 0, 0), 0.2)
    turned = rotation_vector(
        interpolated_rotation(poses, number) @ matrix_from_rotation_vector(RATE * number).T
    )
    assert np.linalg.norm(turned) < 1e-6


def test_noise_of_the_neighbours_is_not_magnified() -> None:
    noise = 0.03 * np.random.default_rng(1).standard_normal((9, 3))
    poses = [pose(k, turn, (0, 0, 0), 0.03) for k, turn in enumerate(noise)]
    turned = rotation_vector(interpolated_rotation([pose(-1, (0, 0, 0), (0, 0, 0), 0.2), *poses], 0))
    assert np.linalg.norm(turned + RATE) < 0.15


def test_alone_it_keeps_its_own() -> None:
    only = pose(0.0, (0, 0, 0), (0, 0, 0), 0.2)
    assert interpolated_rotation([only], 0) is only.rotation


def test_an_exact_first_pose_leaves_the_prediction_finite() -> None:
    poses = [pose(k, (0, 0, 0), (0, 0, 0), 0.0 if k == 0 else 1e-4) for k in range(2)]
    assert np.isfinite(predicted_pose(poses, 2.0, SIZE)[1]).all()
    assert off([*poses, pose(2.0, (0, 0, 0), (0, 0, 0), 1e-4)], 3.0)[0] < 1e-3


def test_the_rate_across_scans_that_do_not_determine_their_rotation_comes_from_both_sides() -> None:
    """Faces on both sides of such scans are tied by it: a prediction from the scans before alone turned them by degrees."""
    rate, poses = np.array([0.1, 0.2, -0.15]), []
    for k in range(16):
        vague = k in (3, 4)
        wrong = np.array([0.0, 0.3, 0.0]) if vague else np.zeros(3)
        covariance = np.diag([*[1e-6] * 3, *[0.04 if vague else 1e-8] * 3])
        poses.append(
            ScanPose(float(k), matrix_from_rotation_vector(k * rate + wrong), np.zeros(3), covariance)
        )
    found = rates_of_steps(poses)
    assert found is not None
    np.testing.assert_allclose(found, np.tile(rate, (15, 1)), atol=1e-6)
    assert rates_of_steps(poses[:6]) is None
