"""Noise of the points of a scan, and the planes fitted to them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import uniform_filter
from scipy.optimize import nnls

from spinfilters.core.chi_square import chi_square_median
from spinfilters.core.linear_algebra import evenly_spaced
from spinfilters.core.ray_angles import angles_of, unit_vectors
from spinfilters.lidar.scan import Scan, angle_tree

FLOOR: Final = 1e-10
"""Least standard deviation of a point across a plane, m: rounding at a kilometre."""
_PATCH, _PATCHES, _LOOKED_AT, _SCANS = 25, 1500, 4000, 5
_EDGES: Final = (0.2, 0.4, 0.6, 0.8)  # of bins of slope, quantiles
_FEWEST_IN_BIN = 10
_ALIKE = 0.001  # weight of the assumption that both angles have the same noise, in terms of the slopes' information
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
        normal : ndarray
            (3,) of one plane, or (3, m) of several, which give (n, m).
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
    of the range over the angles; medians within bins of both slopes keep edges out. Scans of the whole sequence are used, for where
    all faces are steep, ranges hardly determine their own noise. Angles that the slopes do not separate are assumed alike.
    """
    usable = [scan for scan in scans if np.count_nonzero(scan.is_return) > 2 * _PATCH]
    samples = [_patch_residuals(usable[k].points) for k in evenly_spaced(len(usable), _SCANS)]
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
    kept = points[evenly_spaced(len(points), _LOOKED_AT)]
    angles = np.stack(angles_of(kept), axis=1)
    rows = angle_tree(angles).query(angles[evenly_spaced(len(kept), _PATCHES)], _PATCH)[1]
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


GATE: Final = 3.5
"""Standard deviations within which a point belongs to a plane."""
CLEAR: Final = 5.0
"""Standard deviations that it must be away from every other plane."""
FEWEST: Final = 20
"""Points of a plane, at least."""
SMALLEST_SHARE: Final = 0.004
"""Of the scan's points, at least."""
BORDER: Final = 2.0
"""Standard deviations of the angles within which the border of a plane is left out: jittering beams cross it."""
FRONT: Final = 5.0
"""Standard deviations of its distance that the lidar must be before a plane."""
GRAZING: Final = 0.01
"""Cosine of incidence, at least: a line of rays at one elevation is a cone, which differs from a plane along the beams by less."""
WIDE: Final = 0.5
"""Rays that a border is wide, from which it counts."""
FLATNESS: Final = 1e-5
"""Departure of a face from its plane, in sizes of the body, and its tilt, rad: machining, and half a kelvin of thermal expansion.

This error is common to all points of a face, so that no number of exact ranges, such as a simulated lidar without noise gives,
averages it. Covariances of planes beyond it would also be singular next to a direction that no plane determines.
"""
_SEEDS, _SUBSET, _ROUNDS, _MOST = 30, 1500, 6, 24
_PLANES_LOOKED_AT = 8000  # points among which planes are looked for; all are used for the fits
_FULL = 0.8  # share of neighbours that the inside of a face has


@dataclass(frozen=True, eq=False)
class FittedPlane:
    """Plane n.p = n.c of points, normal towards the lidar.

    Attributes
    ----------
    normal : ndarray of shape (3,)
    centroid : ndarray of shape (3,)
        Weighted mean of its points, m.
    tangents : ndarray of shape (3, 2)
    covariance : ndarray of shape (3, 3)
        Of (two tangent components of the normal, offset at the centroid), 1 and m^2; of a scan's planes with
        what `FLATNESS` adds.
    count : int
        Points.
    spread : float
        Root of the reduced chi-square; the covariance is inflated where it exceeds 1.
    """

    normal: Float[np.ndarray, "3"]
    centroid: Float[np.ndarray, "3"]
    tangents: Float[np.ndarray, "3 2"]
    covariance: Float[np.ndarray, "3 3"]
    count: int
    spread: float

    def distances(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Signed distances of points, m."""
        return (points - self.centroid) @ self.normal

    @property
    def shows_its_front(self) -> bool:
        """Whether the lidar is clearly before the plane.

        A plane along the beams, such as that of one line of rays, has no front.
        """
        distance, gradient = abs(self.normal @ self.centroid), np.append(self.centroid @ self.tangents, 1.0)
        least = FRONT * np.sqrt(gradient @ self.covariance @ gradient)
        return bool(distance > max(least, GRAZING * float(np.linalg.norm(self.centroid))))


def fitted_plane(
    points: Float[np.ndarray, "n 3"], noise: PointNoise, normal: Float[np.ndarray, "3"] | None = None
) -> FittedPlane:
    """Weighted total least squares, with the noise across the plane that it begins from.

    Parameters
    ----------
    normal : ndarray of shape (3,) or None
        Where the weights begin from; None takes equal weights.
    """
    if normal is None:
        _, vectors = _principal_axes(points, np.ones(len(points)))
        normal = vectors[:, 0]
    centroid, vectors = _principal_axes(points, noise.across(points, normal) ** -2.0)
    normal, centred = vectors[:, 0] * (-1.0 if vectors[:, 0] @ centroid > 0 else 1.0), points - centroid
    std = noise.across(points, normal)
    rows = np.column_stack([centred @ vectors[:, 1:], -np.ones(len(points))]) / std[:, None]
    information = rows.T @ rows
    spread = float(np.sqrt(np.sum((centred @ normal / std) ** 2) / max(len(points) - 3, 1)))
    covariance = np.linalg.pinv(information, hermitian=True) * max(1.0, spread) ** 2
    return FittedPlane(normal, centroid, vectors[:, 1:], covariance, len(points), spread)


def _principal_axes(
    points: Float[np.ndarray, "n 3"], weights: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
    """Weighted centroid, m, and axes of the scatter about it as columns, the thinnest first."""
    centroid = weights @ points / weights.sum()
    centred = points - centroid
    return centroid, np.linalg.eigh((weights[:, None] * centred).T @ centred)[1]


def extract_planes(
    points: Float[np.ndarray, "n 3"], noise: PointNoise, generator: np.random.Generator
) -> tuple[list[FittedPlane], float]:
    """Planes in the order of their points, and the points' share on one."""
    if len(points) < FEWEST:
        return [], 0.0
    fewest = max(FEWEST, int(SMALLEST_SHARE * min(_PLANES_LOOKED_AT, len(points))))
    angles = np.stack(angles_of(points), axis=1)
    left, found = generator.permutation(len(points))[:_PLANES_LOOKED_AT], []
    looked_at = len(left)
    while len(left) >= fewest and len(found) < _MOST:
        plane = _largest_plane(points[left], angles[left], noise, generator)
        if plane is None or plane.count < fewest:
            break
        found.append(plane)
        left = left[np.abs(plane.distances(points[left])) > CLEAR * noise.across(points[left], plane.normal)]
    return _refit_clear_points(points, angles, found, noise), 1.0 - len(left) / looked_at


def _largest_plane(
    points: Float[np.ndarray, "n 3"],
    angles: Float[np.ndarray, "n 2"],
    noise: PointNoise,
    generator: np.random.Generator,
) -> FittedPlane | None:
    """The plane with most votes among patches of neighbouring rays, grown over all points."""
    size = int(np.clip(len(points) // 40, 12, 400))
    subset = points[generator.choice(len(points), min(_SUBSET, len(points)), replace=False)]
    seeds = generator.integers(len(points), size=_SEEDS)
    patches = np.asarray(angle_tree(angles).query(angles[seeds], min(size, len(points)))[1])
    centres = points[patches].mean(axis=1)
    centred = points[patches] - centres[:, None]
    normals = np.linalg.eigh(np.swapaxes(centred, 1, 2) @ centred)[1][:, :, 0]
    off = np.abs(subset @ normals.T - np.sum(centres * normals, axis=1))
    votes = np.count_nonzero(off < GATE * noise.across(subset, normals.T), axis=0)
    winner = int(np.argmax(votes))
    best: FittedPlane | None = fitted_plane(points[patches[winner]], noise, normals[winner])
    for _ in range(_ROUNDS):
        if best is None:
            return None
        near = np.abs(best.distances(points)) < GATE * noise.across(points, best.normal)
        best = fitted_plane(points[near], noise, best.normal) if near.sum() >= FEWEST else None
    return best


def _refit_clear_points(
    points: Float[np.ndarray, "n 3"],
    angles: Float[np.ndarray, "n 2"],
    planes: list[FittedPlane],
    noise: PointNoise,
) -> list[FittedPlane]:
    """Planes fitted again to the points that are clearly theirs and not at their border, no flatter than `FLATNESS`."""
    for _ in range(2):
        rows = rows_of_planes(points, angles, planes, noise)
        fitted = [
            fitted_plane(points[own], noise, plane.normal)
            for plane, own in zip(planes, rows, strict=True)
            if len(own) >= FEWEST and _is_wide(points[own], plane, noise)
        ]
        planes = [plane for plane in fitted if plane.shows_its_front]
    flatness = np.diag(np.array([1.0, 1.0, extent_of(points)]) * FLATNESS) ** 2
    planes = [replace(plane, covariance=plane.covariance + flatness) for plane in planes]
    return sorted(planes, key=lambda plane: -plane.count)


def extent_of(points: Float[np.ndarray, "n 3"]) -> float:
    """Diagonal of the box around a cloud, without its outermost hundredths, m."""
    return float(np.linalg.norm(np.subtract(*np.quantile(points, [0.99, 0.01], axis=0))))


def rows_of_planes(
    points: Float[np.ndarray, "n 3"],
    angles: Float[np.ndarray, "n 2"],
    planes: Sequence[FittedPlane],
    noise: PointNoise,
) -> list[Int[np.ndarray, " k"]]:
    """Points clearly of each plane, away from its border where possible."""
    if not planes:
        return []
    off = np.stack([np.abs(p.distances(points)) / noise.across(points, p.normal) for p in planes], axis=1)
    own = off.argmin(axis=1)
    ordered = np.sort(off, axis=1)
    clear = ordered[:, 0] < GATE
    if len(planes) > 1:
        clear &= ordered[:, 1] > CLEAR
    found = []
    for k in range(len(planes)):
        rows = np.flatnonzero(clear & (own == k))
        inner = rows[inside_of(angles[rows], noise)] if len(rows) >= FEWEST else rows
        found.append(inner if len(inner) >= FEWEST else rows)
    return found


def _is_wide(points: Float[np.ndarray, "n 3"], plane: FittedPlane, noise: PointNoise) -> bool:
    """Whether points extend in both directions of their plane by much more than their noise."""
    centred = (points - points.mean(axis=0)) @ plane.tangents
    narrow = np.sqrt(max(np.linalg.eigvalsh(centred.T @ centred / len(points))[0], 0.0))
    return bool(narrow > 2 * np.median(noise.across(points, plane.normal)))


def inside_of(angles: Float[np.ndarray, "n 2"], noise: PointNoise) -> Bool[np.ndarray, " n"]:
    """Points of a face with neighbours all around, within the angular noise."""
    step, reach = _angular_step(angles), border_reach(angles, noise)
    cells = np.rint((angles - angles.min(axis=0)) / step).astype(int)
    if reach.max() < WIDE or cells.max() > 4000:
        return np.ones(len(angles), dtype=bool)
    size = (2 * np.ceil(reach) + 1).astype(int)
    image = np.zeros(cells.max(axis=0) + 1)
    image[cells[:, 0], cells[:, 1]] = 1.0
    share = uniform_filter(image, size=size.tolist(), mode="constant")[cells[:, 0], cells[:, 1]]
    return share >= _FULL * np.quantile(share, 0.9)


def border_reach(angles: Float[np.ndarray, "n 2"], noise: PointNoise) -> Float[np.ndarray, "2"]:
    """Width of a border in azimuth and elevation that jittering beams cross, rays."""
    return BORDER * np.array([noise.azimuth_std, noise.elevation_std]) / _angular_step(angles)


def _angular_step(angles: Float[np.ndarray, "n 2"]) -> float:
    """Median angle between neighbouring rays, rad."""
    sample = evenly_spaced(len(angles), 500)
    near = angle_tree(angles).query(angles[sample], 2)[0][:, 1]
    return float(max(np.median(near), 1e-12))
