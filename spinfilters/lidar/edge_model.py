"""Pose of a convex body from all ranges.

The points at edges, which belong to no one face, count too.
Where a face is few beams wide that halves the standard deviation of the attitude.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from spinfilters.geometry.ray_angles import angles_of
from spinfilters.lidar.convex_ranges import ExpectedRanges, expected_ranges
from spinfilters.lidar.face_map import Face
from spinfilters.lidar.planes import FEWEST, WIDE, border_reach, inside_of
from spinfilters.lidar.point_noise import PointNoise
from spinfilters.lidar.scan_pose import ScanPose, pose_covariance, rotation_matrix

FITTING: Final = 1.5
"""Reduced chi-square of all points, at most: above, the body is not the convex one of these faces."""
_MOST, _STEPS = 4000, 6
_LARGE = 4.0  # standard deviations beyond which a point counts less (Huber)


class _RangeFit(NamedTuple):
    """Normal equations of a pose with bounded residuals, whose mean square is chi."""

    information: Float[np.ndarray, "6 6"]
    gradient: Float[np.ndarray, " 6"]
    chi: float


def _fit(expected: ExpectedRanges, measured: Float[np.ndarray, " n"]) -> _RangeFit | None:
    """Fit of ranges, m, to those expected.

    None where a tenth of the rays misses the body.
    """
    residual = (measured - expected.mean) / expected.std
    good = np.isfinite(residual)
    if good.mean() < 0.9:
        return None
    J = np.nan_to_num(expected.by_pose / expected.std[:, None]) * good[:, None]
    weight = np.minimum(1.0, _LARGE / np.maximum(np.abs(residual), 1e-12))
    residual = np.nan_to_num(residual)
    chi = float(np.mean(np.minimum(residual[good] ** 2, _LARGE**2)))
    return _RangeFit((J * weight[:, None]).T @ J, J.T @ (weight * residual), chi)


def with_edges(
    pose: ScanPose,
    points: Float[np.ndarray, "n 3"],
    faces: Sequence[Face],
    noise: PointNoise,
    size: float,
    common: Float[np.ndarray, "6 6"],
) -> ScanPose:
    """The pose from all points within the outline, or the given one.

    Given: beams that do not jitter, a body that is not convex, nothing gained.

    Parameters
    ----------
    points: frame L, m.   size: of the body, m.   common: share of the map's errors in the pose's covariance.
    """
    kept = inner_rays(points, noise, _MOST)
    if kept is None:
        return pose
    points = points[kept]
    angles, measured = np.stack(angles_of(points), axis=1), np.linalg.norm(points, axis=1)
    R, t = pose.rotation, pose.translation
    H, chi, prior = np.zeros((6, 6)), np.inf, np.diag(np.repeat([1.0, 1 / size], 3) ** 2)
    for _ in range(_STEPS):
        fit = _fit(expected_ranges(angles, faces, R, t, noise), measured)
        if fit is None:
            return pose
        H, chi = fit.information, fit.chi
        step = np.linalg.solve(H + prior, fit.gradient)
        R, t = moved_pose(R, t, step)
        if np.abs(step).max() < 1e-9:
            break
    if not (chi < FITTING and np.isfinite(t).all()):
        return pose
    covariance, lacking = pose_covariance(H / max(1.0, chi), R, size)
    found = replace(pose, rotation=R, translation=t, covariance=covariance + common, undetermined=lacking)
    return found if _is_nearer(found, pose) else pose


def _is_nearer(found: ScanPose, pose: ScanPose) -> bool:
    """Whether the place is known better than before."""
    return bool(np.trace(found.covariance[3:, 3:]) < np.trace(pose.covariance[3:, 3:]))


def inner_rays(
    points: Float[np.ndarray, "n 3"], noise: PointNoise, most: int
) -> Int[np.ndarray, " k"] | None:
    """At most this many rays within the outline, evenly chosen.

    None of too few, or where edges are no wider than a ray.
    """
    angles = np.stack(angles_of(points), axis=1)
    kept = np.flatnonzero(inside_of(angles, noise))
    if len(kept) < FEWEST or border_reach(angles, noise).max() < WIDE:
        return None
    return kept[np.linspace(0, len(kept) - 1, min(most, len(kept))).astype(int)]


def moved_pose(
    R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"], step: Float[np.ndarray, "6"]
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """A pose after a rotation in L, rad, and a translation, m."""
    return rotation_matrix(step[:3]) @ R, t + step[3:]
