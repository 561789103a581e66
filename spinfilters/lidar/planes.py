"""Planes of a scan with covariance, fitted with the points' noise.

Found by random sampling.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import uniform_filter

from spinfilters.geometry.ray_angles import angles_of
from spinfilters.lidar.point_noise import PointNoise
from spinfilters.lidar.ray_pattern import angle_tree

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
averages it. Covariances of planes beyond it would also be singular beside a direction that no plane determines.
"""
_SEEDS, _SUBSET, _ROUNDS, _MOST = 30, 1500, 6, 24
_LOOKED_AT = 8000  # points among which planes are looked for; all are used for the fits
_FULL = 0.8  # share of neighbours that the inside of a face has


@dataclass(frozen=True, eq=False)
class FittedPlane:
    """Plane n.p = n.c of points, normal towards the lidar.

    Attributes
    ----------
    normal: (3,).   centroid: (3,) weighted mean of its points, m.   tangents: (3, 2).
    covariance: (3, 3) of (two tangent components of the normal, offset at the centroid), 1 and m^2; of a scan's planes with
        what `FLATNESS` adds.
    count: points.   spread: root of the reduced chi-square; the covariance is inflated where it exceeds 1.
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
    normal: where the weights begin from; None takes equal weights.
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
    fewest = max(FEWEST, int(SMALLEST_SHARE * min(_LOOKED_AT, len(points))))
    angles = np.stack(angles_of(points), axis=1)
    left, found = generator.permutation(len(points))[:_LOOKED_AT], []
    looked_at = len(left)
    while len(left) >= fewest and len(found) < _MOST:
        plane = _largest_plane(points[left], angles[left], noise, generator)
        if plane is None or plane.count < fewest:
            break
        found.append(plane)
        left = left[np.abs(plane.distances(points[left])) > CLEAR * noise.across(points[left], plane.normal)]
    return _separated(points, angles, found, noise), 1.0 - len(left) / looked_at


def _largest_plane(
    points: Float[np.ndarray, "n 3"],
    angles: Float[np.ndarray, "n 2"],
    noise: PointNoise,
    generator: np.random.Generator,
) -> FittedPlane | None:
    """The plane with the most points, grown over all points.

    Among those through patches of neighbouring rays.
    """
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


def _separated(
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
    sample: Int[np.ndarray, " s"] = np.linspace(0, len(angles) - 1, min(500, len(angles))).astype(int)
    near = angle_tree(angles).query(angles[sample], 2)[0][:, 1]
    return float(max(np.median(near), 1e-12))
