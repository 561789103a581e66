"""Noise of measured points: from a specification, or identified from the scans themselves."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.optimize import nnls

from spinfilters.geometry.ray_angles import angles_of, unit_vectors
from spinfilters.lidar.ray_pattern import angle_tree
from spinfilters.lidar.scan import Scan
from spinfilters.linear_algebra.chi_square import chi_square_median

FLOOR: Final = 1e-10
"""Least standard deviation of a point across a plane, m: rounding at a kilometre."""
_PATCH, _PATCHES, _LOOKED_AT, _SCANS = 25, 1500, 4000, 5
_EDGES: Final = (0.2, 0.4, 0.6, 0.8)  # of bins of slope, quantiles
_FEWEST_IN_BIN = 10
_ALIKE = 0.001  # how strongly both angles are held to be alike, in terms of what the slopes tell
_PARAMETERS = 3  # of a plane


@dataclass(frozen=True)
class PointNoise:
    """Standard deviations of range, m, azimuth and elevation, rad."""

    range_std: float
    azimuth_std: float
    elevation_std: float

    def across(
        self, points: Float[np.ndarray, "n 3"], normal: Float[np.ndarray, "..."]
    ) -> Float[np.ndarray, "..."]:
        """Standard deviation of points across a plane, m.

        s^2 = n' S n with S of range, azimuth and elevation.

        Parameters
        ----------
        normal: (3,) of one plane, or (3, m) of several, which give (n, m).
        """
        r = np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1e-12)
        azimuth, elevation = _lateral(points)
        square = (self.range_std * (points / r @ normal)) ** 2
        square += (self.azimuth_std * (azimuth @ normal)) ** 2 + (
            self.elevation_std * (elevation @ normal)
        ) ** 2
        return np.sqrt(square + FLOOR**2)


def _lateral(points: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Derivatives of points by azimuth and by elevation, m/rad."""
    x, y, z = points.T
    across = np.hypot(x, z)
    safe = np.maximum(across, 1e-12)
    return np.stack([-z, np.zeros_like(x), x], axis=1), np.stack(
        [-x * y / safe, across, -z * y / safe], axis=1
    )


def identified_noise(scans: Sequence[Scan]) -> PointNoise:
    """Range and angle noise from what neighbouring rays differ by: the medians of small planes' residuals.

    The residual variance of ranges on a plane is range_std^2 + (slope_a azimuth_std)^2 + (slope_e elevation_std)^2, with the slopes
    of the range over the angles; medians within bins of both slopes keep edges out. Scans of the whole sequence are looked at, for
    where all faces are steep, ranges hardly tell their own noise. Angles that the slopes do not tell apart are taken alike.
    """
    usable = [scan for scan in scans if np.count_nonzero(scan.is_return) > 2 * _PATCH]
    chosen = np.unique(np.linspace(0, len(usable) - 1, min(_SCANS, len(usable))).astype(int))
    samples = [_patch_residuals(usable[k].points) for k in chosen]
    if not samples:
        return PointNoise(0.0, 0.0, 0.0)
    return _noise_of_slopes(np.concatenate(samples, axis=1))


def _noise_of_slopes(samples: Float[np.ndarray, "3 m"]) -> PointNoise:
    """Noise from squared slopes and residual variances of the range.

    Slopes over azimuth and elevation, (m/rad)^2; residual variances unbiased, m^2.
    """
    *slopes, variance = samples
    bins = [np.searchsorted(np.quantile(each, _EDGES), each) for each in slopes]
    rows, values, shares = [], [], []
    for cell in np.unique(np.stack(bins), axis=1).T:
        inside = (bins[0] == cell[0]) & (bins[1] == cell[1])
        if inside.sum() > _FEWEST_IN_BIN:
            rows.append([1.0, *(np.median(each[inside]) for each in slopes)])
            values.append(np.median(variance[inside]))
            shares.append(np.sqrt(np.count_nonzero(inside)))
    if not rows:
        return PointNoise(0.0, 0.0, 0.0)
    A, b = np.array(rows), np.array(values)
    weights = np.array(shares) / np.maximum(b, FLOOR**2)
    scale = np.maximum(np.abs(A).max(axis=0), 1e-300)
    scale[1:] = scale[1:].max()
    whitened = A / scale * weights[:, None]
    alike = _ALIKE * np.linalg.norm(whitened) * np.array([[0.0, 1.0, -1.0]])
    squares = nnls(np.concatenate([whitened, alike]), np.append(b * weights, 0.0))[0] / scale
    return PointNoise(*np.sqrt(squares).tolist())


def _patch_residuals(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "3 m"]:
    """Squared slopes and residual variances of planes through neighbouring rays.

    Slopes of the range over the angles, (m/rad)^2; variance, m^2.
    The range is fitted rather than a plane in space: where beams lie closer than the noise a cloud is thickest along the range.
    Over a tangent plane the inverse depth of a plane is linear; its range is curved, for near bodies by more than the noise.
    """
    kept = points[np.linspace(0, len(points) - 1, min(_LOOKED_AT, len(points))).astype(int)]
    angles = np.stack(angles_of(kept), axis=1)
    seeds = np.linspace(0, len(kept) - 1, min(_PATCHES, len(kept))).astype(int)
    rows = angle_tree(angles).query(angles[seeds], _PATCH)[1]
    middle = angles[rows].mean(axis=1)
    centre = unit_vectors(*middle.T)
    by_azimuth, by_elevation = (each / np.sum(each**2, axis=1, keepdims=True) for each in _lateral(centre))
    depth, across, along = (
        np.einsum("mki,mi->mk", kept[rows], each) for each in (centre, by_azimuth, by_elevation)
    )
    angle = np.stack([across, along], axis=2) / depth[:, :, None]
    width = np.maximum(np.abs(angle).max(axis=(1, 2)), 1e-300)[:, None, None]
    A = np.concatenate([angle / width, np.ones((*angle.shape[:2], 1))], axis=2)
    typical = depth.mean(axis=1, keepdims=True)
    r = typical - typical**2 / depth
    solution = np.linalg.pinv(A) @ r[:, :, None]
    residual = r - (A @ solution)[:, :, 0]
    freedom = _PATCH - _PARAMETERS
    slope = solution[:, :2, 0] / width[:, :, 0]
    variance = np.sum(residual**2, axis=1) / float(chi_square_median(freedom))
    return np.stack([*(slope.T**2), variance])
