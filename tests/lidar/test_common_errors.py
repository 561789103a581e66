"""Inflation of poses' covariances for the errors that they share."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spinfilters.lidar.adjustment_covariance import shared_inflation, smooth_inflation
from spinfilters.lidar.scan_pose import ScanPose

COUNT = 40


def poses() -> list[ScanPose]:
    """Of a body that turns by 0.3 rad from scan to scan and wobbles."""
    spin, wobble = (
        Rotation.from_rotvec(np.outer(rate * np.arange(COUNT), axis))
        for rate, axis in ((0.3, [0.6, 0.0, 0.8]), (0.4, [0.0, 1.0, 0.0]))
    )
    turns = (spin * wobble).as_matrix()
    return [ScanPose(float(k), R, np.zeros(3), np.eye(6)) for k, R in enumerate(turns)]


def inflation(joint: np.ndarray) -> float:
    own = np.broadcast_to(np.eye(6), (COUNT, 6, 6))
    return smooth_inflation(poses(), own, joint.__matmul__)


def test_independent_errors_need_none() -> None:
    assert inflation(np.eye(6 * COUNT)) == pytest.approx(1.0, abs=1e-9)


def test_an_error_of_the_frame_needs_none() -> None:
    common = np.tile(np.eye(6), (COUNT, 1))
    assert inflation(np.eye(6 * COUNT) + 5.0 * common @ common.T) == pytest.approx(1.0, abs=1e-9)


def test_slow_errors_are_weighed_as_a_motion_fitted_to_them_has_them() -> None:
    """Along the lidar's axes a shift that grows in time is one of 18 directions, and has all of its variance there."""
    late, along = np.linspace(-1.0, 1.0, COUNT), np.zeros((COUNT, 6))
    along[:, 3:] = late[:, None] * np.array([pose.rotation.T[:, 0] for pose in poses()])
    slow = along.reshape(-1, 1)
    most = 1 + 2.0 * np.sum(late**2) / 18
    assert 0.9 * most < inflation(np.eye(6 * COUNT) + 2.0 * slow @ slow.T) <= most


def test_white_errors_weigh_as_they_are() -> None:
    alternating = np.kron((-1.0) ** np.arange(COUNT), [0, 0, 0, 1.0, 0, 0])[:, None]
    assert inflation(np.eye(6 * COUNT) + alternating @ alternating.T) < 1.05


def test_what_faces_share_is_a_ratio_of_variances() -> None:
    common = np.diag([0.0, 0.0, 0.0, 3.0, 3.0, 3.0])
    given = [replace(pose, covariance=np.eye(6) + common) for pose in poses()]
    assert shared_inflation(given, [common] * COUNT) == pytest.approx(2.5)
    assert shared_inflation(given, [np.zeros((6, 6))] * COUNT) == pytest.approx(1.0)
