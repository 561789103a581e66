"""Ranges of a convex body of known faces through beams that jitter.

Points at edges, which belong to no one face, count too.
A beam whose direction is known to a standard deviation meets, near an edge, now one face and now the other. The range is the
largest of the faces' ranges, each linear in the deviation of the beam: its mean and variance are those of the maximum of jointly
normal variables (Clark 1961, The greatest of a finite set of random variables). Where a face is few beams wide that halves the
standard deviation of the attitude.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float, Int
from scipy.special import ndtr

from spinfilters.lidar.face_map import Face
from spinfilters.lidar.planes import FEWEST, WIDE, border_reach, inside_of
from spinfilters.lidar.point_noise import PointNoise
from spinfilters.lidar.ray_pattern import angles_of, unit_vectors
from spinfilters.lidar.scan_pose import ScanPose, pose_covariance, rotation_matrix

FITTING: Final = 1.5
"""Reduced chi-square of all points, at most: above, the body is not the convex one of these faces."""
GRAZING: Final = 0.02
"""Cosine of incidence below which a face is not met."""
_MOST, _STEPS, _DELTA = 4000, 6, 1e-6
_LARGE = 4.0  # standard deviations beyond which a point counts less (Huber)


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
    scale, H, chi = np.repeat([_DELTA, _DELTA * size], 3), np.zeros((6, 6)), np.inf
    for _ in range(_STEPS):
        expected, std = expected_ranges(angles, faces, R, t, noise)
        residual = (measured - expected) / std
        good = np.isfinite(residual)
        if good.mean() < 0.9:
            return pose
        moved = [moved_pose(R, t, step) for step in np.diag(scale)]
        ahead = [expected_ranges(angles, faces, *each, noise)[0] for each in moved]
        J = np.nan_to_num((np.stack(ahead, axis=1) - expected[:, None]) / scale / std[:, None])
        residual, weight = (
            np.nan_to_num(residual),
            np.minimum(1.0, _LARGE / np.maximum(np.abs(residual), 1e-12)),
        )
        chi = float(np.mean(np.minimum(residual[good] ** 2, _LARGE**2)))
        H = (J * weight[:, None]).T @ J
        step = np.linalg.solve(H + np.diag(np.repeat([1.0, 1 / size], 3) ** 2), J.T @ (weight * residual))
        R, t = moved_pose(R, t, step)
        if np.abs(step).max() < 1e-9:
            break
    covariance, lacking = pose_covariance(H / max(1.0, chi), R, size)
    gained = np.trace(covariance[3:, 3:]) < np.trace((pose.covariance - common)[3:, 3:])
    if not (gained and chi < FITTING and np.isfinite(t).all()):
        return pose
    return replace(pose, rotation=R, translation=t, covariance=covariance + common, undetermined=lacking)


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


def expected_ranges(
    angles: Float[np.ndarray, "n 2"],
    faces: Sequence[Face],
    R: Float[np.ndarray, "3 3"],
    t: Float[np.ndarray, "3"],
    noise: PointNoise,
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Mean and standard deviation of the ranges of jittering beams, m.

    Beams by azimuth and elevation; NaN of one that no face is before.
    """
    u = unit_vectors(*angles.T)
    c, s = np.cos(angles), np.sin(angles)
    by_azimuth = np.stack([-c[:, 1] * s[:, 0], 0 * u[:, 0], c[:, 1] * c[:, 0]], axis=1) * noise.azimuth_std
    by_elevation = np.stack([-s[:, 1] * c[:, 0], c[:, 1], -s[:, 1] * s[:, 0]], axis=1) * noise.elevation_std
    mean, slopes, variance = np.full(len(u), np.nan), np.zeros((len(u), 2)), np.zeros(len(u))
    for face in faces:
        n = R @ face.normal
        along, distance = u @ n, face.offset + n @ t
        if distance >= 0:
            continue
        front = along < -GRAZING
        own = np.where(front, distance / np.where(front, along, -1.0), np.nan)
        slope = -(own / np.where(front, along, -1.0))[:, None] * np.stack(
            [by_azimuth @ n, by_elevation @ n], axis=1
        )
        mean, slopes, variance = _larger(mean, slopes, variance, own, slope)
    return mean, np.sqrt(variance + noise.range_std**2 + 1e-20)


def _larger(
    a: Float[np.ndarray, " n"],
    a_slopes: Float[np.ndarray, "n 2"],
    a_variance: Float[np.ndarray, " n"],
    b: Float[np.ndarray, " n"],
    b_slopes: Float[np.ndarray, "n 2"],
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 2"], Float[np.ndarray, " n"]]:
    """Clark's maximum of two normal variables.

    The second is linear in two standard normal deviations; NaN is none.
    """
    b_variance = np.sum(b_slopes**2, axis=1)
    spread = np.sqrt(np.maximum(np.sum((a_slopes - b_slopes) ** 2, axis=1), 1e-24))
    x = np.clip((a - b) / spread, -1e3, 1e3)
    first, density = ndtr(x), np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi)
    low = np.minimum(a, b)
    p, q = a - low, b - low  # squares of ranges at 500 m would drown the variance
    mean = p * first + q * (1 - first) + spread * density
    square = (p**2 + a_variance) * first + (q**2 + b_variance) * (1 - first) + (p + q) * spread * density
    both = (
        low + mean,
        first[:, None] * a_slopes + (1 - first)[:, None] * b_slopes,
        np.maximum(square - mean**2, 0),
    )
    alone_a, alone_b = np.isnan(b), np.isnan(a)
    return (
        np.where(alone_a, a, np.where(alone_b, b, both[0])),
        np.where(alone_a[:, None], a_slopes, np.where(alone_b[:, None], b_slopes, both[1])),
        np.where(alone_a, a_variance, np.where(alone_b, b_variance, both[2])),
    )


def moved_pose(
    R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"], step: Float[np.ndarray, "6"]
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """A pose after a rotation in L, rad, and a translation, m."""
    return rotation_matrix(step[:3]) @ R, t + step[3:]
