"""Ranges of a convex body of known faces by jittering beams.

With their derivatives by pose and faces.
A beam whose direction is known to a standard deviation meets, near an edge, now one face and now the other. The range is the
largest of the faces' ranges, each linear in the deviation of the beam: its mean and variance are those of the maximum of jointly
normal variables (Clark 1961, The greatest of a finite set of random variables).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from spinfilters.geometry.ray_angles import unit_vectors
from spinfilters.lidar.face_map import Face
from spinfilters.lidar.point_noise import PointNoise

GRAZING: Final = 0.02
"""Cosine of incidence below which a face is not met."""
_PARAMETERS = 4  # of a face in L: its normal, and the lidar's distance behind it


@dataclass(frozen=True, eq=False)
class ExpectedRanges:
    """Ranges of beams, m; NaN of one that no face is before.

    Attributes
    ----------
    mean, std: (n,).   by_pose: (n, 6) derivative of the mean by (rotation in L, rad; translation, m).
    by_faces: (n, 3 F) by two tangent components of every face's normal and its offset, m.
    """

    mean: Float[np.ndarray, " n"]
    std: Float[np.ndarray, " n"]
    by_pose: Float[np.ndarray, "n 6"]
    by_faces: Float[np.ndarray, "n f"]


@dataclass(frozen=True, eq=False)
class _Variable:
    """Normal variables of beams: means, slopes (n, 2) over two standard normal deviations, variances, derivatives.

    ``by``: (n, p) of the mean, ``slopes_by``: (n, 2, p) of the slopes, by the parameters of all faces in L.
    """

    mean: Float[np.ndarray, " n"]
    slopes: Float[np.ndarray, "n 2"]
    variance: Float[np.ndarray, " n"]
    by: Float[np.ndarray, "n p"]
    slopes_by: Float[np.ndarray, "n 2 p"]


def expected_ranges(
    angles: Float[np.ndarray, "n 2"],
    faces: Sequence[Face],
    R: Float[np.ndarray, "3 3"],
    t: Float[np.ndarray, "3"],
    noise: PointNoise,
) -> ExpectedRanges:
    """Ranges of jittering beams, of the body in a pose.

    Azimuth, elevation, rad; t in m.
    """
    u, by_angles = unit_vectors(*angles.T), _deviations(angles, noise)
    count, size = len(u), _PARAMETERS * len(faces)
    nothing = np.zeros((count, 2, size))
    largest = _Variable(np.full(count, np.nan), nothing[:, :, 0], np.zeros(count), nothing[:, 0], nothing)
    for number, face in enumerate(faces):
        if face.offset + R @ face.normal @ t < 0:
            largest = _larger(largest, _of_face(u, by_angles, face, R, t, number, size))
    std = np.sqrt(largest.variance + noise.range_std**2 + 1e-20)
    by_pose, by_faces = np.zeros((count, 6)), np.zeros((count, 3 * len(faces)))
    for number, face in enumerate(faces):
        by = largest.by[:, _PARAMETERS * number : _PARAMETERS * (number + 1)]
        n, tangents = R @ face.normal, R @ face.tangents
        by_pose[:, :3] += np.cross(n, by[:, :3]) + by[:, 3:] * np.cross(n, t)
        by_pose[:, 3:] += by[:, 3:] * n
        by_faces[:, 3 * number : 3 * number + 2] = by[:, :3] @ tangents + by[:, 3:] * (t @ tangents)
        by_faces[:, 3 * number + 2] = by[:, 3]
    return ExpectedRanges(largest.mean, std, by_pose, by_faces)


def _deviations(angles: Float[np.ndarray, "n 2"], noise: PointNoise) -> Float[np.ndarray, "n 2 3"]:
    """Change of a beam's direction per standard deviation of azimuth and of elevation."""
    (ca, ce), (sa, se) = np.cos(angles).T, np.sin(angles).T
    by_azimuth = np.stack([-ce * sa, 0 * sa, ce * ca], axis=1) * noise.azimuth_std
    by_elevation = np.stack([-se * ca, ce, -se * sa], axis=1) * noise.elevation_std
    return np.stack([by_azimuth, by_elevation], axis=1)


def _of_face(
    u: Float[np.ndarray, "n 3"],
    by_angles: Float[np.ndarray, "n 2 3"],
    face: Face,
    R: Float[np.ndarray, "3 3"],
    t: Float[np.ndarray, "3"],
    number: int,
    size: int,
) -> _Variable:
    """Ranges of one face, r = d / (u.n) with d = offset + n.t.

    NaN where it is met at a grazing angle or from behind.
    """
    n = R @ face.normal
    front = u @ n < -GRAZING
    along = np.where(front, u @ n, -1.0)
    r = (face.offset + n @ t) / along
    ahead = by_angles @ n
    slopes = -(r / along)[:, None] * ahead
    by, slopes_by = np.zeros((len(u), size)), np.zeros((len(u), 2, size))
    at, last = slice(_PARAMETERS * number, _PARAMETERS * number + 3), _PARAMETERS * number + 3
    by[:, at], by[:, last] = -(r / along)[:, None] * u, 1 / along
    slopes_by[:, :, at] = (2 * r / along**2)[:, None, None] * ahead[:, :, None] * u[:, None]
    slopes_by[:, :, at] -= (r / along)[:, None, None] * by_angles
    slopes_by[:, :, last] = -ahead / along[:, None] ** 2
    return _Variable(np.where(front, r, np.nan), slopes, np.sum(slopes**2, axis=1), by, slopes_by)


def _larger(a: _Variable, b: _Variable) -> _Variable:
    """Clark's maximum of two normal variables; NaN is none."""
    both = ~(np.isnan(a.mean) | np.isnan(b.mean))
    first = np.where(np.isnan(a.mean), 0.0, 1.0)
    means, variances = np.where(first > 0, a.mean, b.mean), np.where(first > 0, a.variance, b.variance)
    apart, apart_by = a.slopes - b.slopes, a.slopes_by - b.slopes_by
    spread = np.sqrt(np.maximum(np.sum(apart**2, axis=1), 1e-24))
    x = np.where(both, np.clip((a.mean - b.mean) / spread, -1e3, 1e3), 0.0)
    density = np.where(both, np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi), 0.0)
    first = np.where(both, ndtr(x), first)
    low = np.minimum(a.mean, b.mean)  # squares of ranges at 500 m would drown the variance
    p, q = a.mean - low, b.mean - low
    mean = p * first + q * (1 - first) + spread * density
    square = (p**2 + a.variance) * first + (q**2 + b.variance) * (1 - first) + (p + q) * spread * density
    spread_by = np.einsum("ni,nip->np", apart, apart_by) / spread[:, None]
    mixed = first[:, None] * a.by + (1 - first)[:, None] * b.by + density[:, None] * spread_by
    turned = (density / spread)[:, None] * (a.by - b.by - x[:, None] * spread_by)
    weight = first[:, None]
    return _Variable(
        np.where(both, low + mean, means),
        weight * a.slopes + (1 - weight) * b.slopes,
        np.where(both, np.maximum(square - mean**2, 0), variances),
        mixed,
        weight[:, :, None] * a.slopes_by
        + (1 - weight)[:, :, None] * b.slopes_by
        + apart[:, :, None] * turned[:, None],
    )
