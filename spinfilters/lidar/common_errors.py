"""Errors shared by a sequence's poses, which estimators take for white noise.

Poses that were adjusted together have errors that are alike from scan to scan. A motion that is fitted to poses of covariances W^-1
each has the covariance N^-1 S N^-1 for the poses' joint covariance C, N = B' W B, S = B' W C W B, with B what the poses change by
with the motion. Covariances s W^-1 tell as much on average where s = tr(N^-1 S) / dim.

The columns of B stand for any smooth motion: places, velocities and attitudes at the start, drifts of the attitude in the lidar's
frame and in that of the body. A rotation and a shift of frame g are none, for nothing but the poses defines it.
"""

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.lidar.scan_pose import ScanPose

NEGLIGIBLE: Final = 1e-9
"""Share of the largest information, below which a direction is not told."""

LARGEST: Final = 1e6
"""Inflation that is told, at most."""

Product = Callable[[Float[np.ndarray, "a m"]], Float[np.ndarray, "a m"]]
"""A matrix times columns."""


def shared_inflation(poses: Sequence[ScanPose], common: Sequence[Float[np.ndarray, "6 6"]]) -> float:
    """Mean ratio of the poses' variances to those without what they share with others.

    Parameters
    ----------
    common: part of every pose's covariance that it shares.
    """
    ratios = [
        np.trace(np.linalg.pinv(pose.covariance - C, hermitian=True) @ pose.covariance) / 6
        for pose, C in zip(poses, common, strict=True)
    ]
    good = [ratio for ratio in ratios if ratio >= 1]
    return min(float(np.median(good)), LARGEST) if good else 1.0


def smooth_inflation(
    poses: Sequence[ScanPose], own: Float[np.ndarray, "k 6 6"], covariance: Product
) -> float:
    """Factor on the poses' own covariances, at least 1.

    Parameters
    ----------
    own: information of every pose, over (rotation, shift) in g.   covariance: joint, likewise.
    """
    frame, smooth = _changes(poses)
    weighted_frame, weighted = (_weighted(own, each) for each in (frame, smooth))
    held = np.linalg.pinv(frame.T @ weighted_frame, hermitian=True) @ weighted_frame.T @ smooth
    smooth, weighted = smooth - frame @ held, weighted - weighted_frame @ held
    values, vectors = np.linalg.eigh(smooth.T @ weighted)
    told = values > NEGLIGIBLE * values[-1]
    if not told.any():
        return 1.0
    whitened = weighted @ (vectors[:, told] / np.sqrt(values[told]))
    return float(np.clip(np.vdot(whitened, covariance(whitened)) / np.count_nonzero(told), 1.0, LARGEST))


def _changes(poses: Sequence[ScanPose]) -> tuple[Float[np.ndarray, "a 6"], Float[np.ndarray, "a m"]]:
    """Changes of all poses with the frame g, and with a smooth motion."""
    times = np.array([pose.time for pose in poses])
    late = (2 * times - times[0] - times[-1]) / max(float(np.ptp(times)), 1e-300)
    body, lidar = (
        np.broadcast_to(np.eye(3), (len(poses), 3, 3)),
        np.array([pose.rotation.T for pose in poses]),
    )

    def column(axes: Float[np.ndarray, "k 3 3"], power: int, first: int) -> Float[np.ndarray, "a 3"]:
        """Changes along three axes that grow with a power of time."""
        found = np.zeros((len(poses), 6, 3))
        found[:, first : first + 3] = axes * late[:, None, None] ** power
        return found.reshape(-1, 3)

    frame = [column(body, 0, 0), column(body, 0, 3)]
    turns = [column(lidar, 0, 0), column(lidar, 1, 0), column(body, 1, 0), column(body, 2, 0)]
    return np.hstack(frame), np.hstack([*turns, column(lidar, 0, 3), column(lidar, 1, 3)])


def _weighted(own: Float[np.ndarray, "k 6 6"], columns: Float[np.ndarray, "a m"]) -> Float[np.ndarray, "a m"]:
    return np.einsum("kij,kjc->kic", own, columns.reshape(len(own), 6, -1)).reshape(columns.shape)
