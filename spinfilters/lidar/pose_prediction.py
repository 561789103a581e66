"""Prediction of the next scan's pose: mean rate of the scans before, and a centre that drifts uniformly."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.lidar.scan_pose import ScanPose, rotation_matrix, rotation_vector

MOST_SCANS: Final = 20
"""Scans before that a prediction is made from."""
CHANGE: Final = 0.3
"""Change of a rate in a time, per square of the rate: that of a torque-free body whose moments differ by so much."""


def predicted_pose(
    poses: Sequence[ScanPose], time: float, size: float
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Pose at a time if the body goes on as in the scans before, each with the weight of its covariance.

    What a scan does not determine is taken from those that do: a body that shows one face for some scans is found again after.

    Parameters
    ----------
    poses: at least one.   size: of the body, m: how far the origin of g may be from the centre of mass.
    """
    recent = poses[-MOST_SCANS:]
    last = recent[-1]
    if len(recent) < 2:
        return last.rotation, last.translation
    rotation = rotation_matrix((time - last.time) * _mean_rate(recent)) @ last.rotation
    return rotation, _drifted(recent, time, rotation, size)


def _mean_rate(poses: Sequence[ScanPose]) -> Float[np.ndarray, "3"]:
    """Rate in L, rad/s, of the steps between scans; older ones have less weight the faster the body turns."""
    times = np.array([pose.time for pose in poses])
    span = np.diff(times)
    steps = np.array([rotation_vector(b.rotation @ a.rotation.T) for a, b in pairwise(poses)])
    rates = steps / span[:, None]
    P = np.array([pose.rotation @ pose.covariance[3:, 3:] @ pose.rotation.T for pose in poses])
    aged = CHANGE * np.sum(np.median(rates, axis=0) ** 2) * (times[-1] - times[:-1]) * span
    W = (
        np.linalg.inv(P[:-1] + P[1:] + (aged**2 + 1e-20)[:, None, None] * np.eye(3))
        * span[:, None, None] ** 2
    )
    return np.linalg.solve(np.sum(W, axis=0), np.einsum("nij,nj->i", W, rates))


def _drifted(
    poses: Sequence[ScanPose], time: float, rotation: Float[np.ndarray, "3 3"], size: float
) -> Float[np.ndarray, "3"]:
    """Origin of g at a time, m: t = r + v time - R c with the centre c in g; r, v and c of least squares, weighted."""
    last, span = poses[-1], poses[-1].time - poses[0].time
    H, b = np.eye(9) / size**2, np.zeros(9)
    for pose in poses:
        W = np.linalg.inv(pose.covariance[:3, :3] + (1e-9 * size) ** 2 * np.eye(3))
        A = np.hstack([np.eye(3), np.eye(3) * (pose.time - last.time) / span, last.rotation - pose.rotation])
        H += A.T @ W @ A
        b += A.T @ W @ (pose.translation - last.translation)
    A = np.hstack([np.eye(3), np.eye(3) * (time - last.time) / span, last.rotation - rotation])
    return last.translation + A @ np.linalg.solve(H, b)
