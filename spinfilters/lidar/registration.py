"""Point-to-plane registration of a cloud to a map: the pose of a body without plane faces."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import count
from typing import Final

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from spinfilters.core.attitude_conversions import matrix_from_rotation_vector
from spinfilters.core.gauss_newton import StepEquations, gauss_newton, step_equations
from spinfilters.core.linear_algebra import evenly_spaced
from spinfilters.core.robust_losses import median_deviation
from spinfilters.lidar.scan_pose import Placement, move_placement

NEIGHBOURS: Final = 16
"""Points that a normal is fitted to."""
SAMPLED: Final = 500
"""Points by which the distance between points is judged."""
REACHED: Final = 1.5
"""Largest distance from a point of the surface to the next of a cloud, in distances between these."""
FACING: Final = 0.5
"""Cosine of the angle between two normals that may belong together, at least."""
ADMITTED: Final = 0.3
"""Residual that counts whatever the deviation while matches come nearer, in terms of their largest distance."""
_ITERATIONS, _COARSE, _COARSE_ITERATIONS = 40, 400, 12
_TRIMMED = 3.0  # robust standard deviations of a residual beyond which it has no weight
_SETTLED = 1e-9
_PATCH = 0.3  # side of a patch of like residuals, in sizes of the map


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points, m, with unit normals; ``tree`` over the points."""

    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    tree: KDTree

    @classmethod
    def of(cls, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]) -> "Cloud":
        """Cloud with its search tree."""
        return cls(points, normals, KDTree(points))

    @property
    def size(self) -> float:
        """Root-mean-square distance from the middle, m."""
        return float(np.sqrt(np.mean(np.sum((self.points - self.points.mean(axis=0)) ** 2, axis=1))))

    @cached_property
    def least_reach(self) -> float:
        """Least distance of matches, m, however small the noise: a multiple of the median point spacing."""
        every = self.points[:: max(1, len(self.points) // SAMPLED)]
        nearest = self.tree.query(every, 2)[0][:, 1]
        return max(REACHED * float(np.median(nearest)), 1e-9)


@dataclass(frozen=True, eq=False)
class Registration:
    """Pose p_map = R p + t of the cloud in the map, with its information matrix.

    Attributes
    ----------
    information : ndarray of shape (6, 6)
        Over (rotation, translation) in map axes, with the residuals' own deviation, m^-2 and 1.
    residual_std : float
        Of the point-to-plane distances, m.
    matched : int
        Points.
    overlap : float
        Their share of the cloud.
    """

    rotation: Float[np.ndarray, "3 3"]
    translation: Float[np.ndarray, "3"]
    information: Float[np.ndarray, "6 6"]
    residual_std: float
    matched: int
    overlap: float


def registered(
    source: Cloud, target: Cloud, R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"], reach: float
) -> Registration:
    """The pose refined from a start, with its information.

    Residuals of neighbouring points are alike where a target is shared, or the surface is rougher than the noise. So the variance
    is that which sums of residuals over patches of the surface have, never less than that of independent points.

    Parameters
    ----------
    R : ndarray of shape (3, 3)
    t : ndarray of shape (3,)
        Where the pose begins from, p_map = R p + t, m.
    reach : float
        Distance of matches at first, m.
    """
    R, t = refined_pose(source, target, R, t, reach)
    near = closest_points(source, target, R, t, reach)
    near = closest_points(source, target, R, t, max(6 * near.std, target.least_reach))
    if len(near.rows) < 6:
        return Registration(R, t, np.zeros((6, 6)), np.inf, len(near.rows), 0.0)
    variance = max(float(np.mean(near.residual**2)), 1e-24)
    information = near.equations(t).information / (variance * _dependence_factor(near, target.size))
    return Registration(
        R, t, information, float(np.sqrt(variance)), len(near.rows), len(near.rows) / len(source.points)
    )


def refined_pose(
    source: Cloud, target: Cloud, R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"], reach: float
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Pose by point-to-plane iterated closest points, whose matches come nearer from step to step (Chen and Medioni 1992).

    While they do, residuals of a share of their distance count whatever the deviation: where most points lie on one panel without
    noise, that is rounding, and no other point would tell what the panel leaves open.
    """
    is_near = False

    def match(placement: Placement) -> StepEquations | None:
        nonlocal reach, is_near
        matches = closest_points(source, target, *placement, reach, 0.0 if is_near else ADMITTED * reach)
        nearer = max(reach * 0.8, 6 * matches.std, target.least_reach)
        reach, is_near = nearer, nearer >= reach
        return matches.equations(placement[1]) if len(matches.rows) >= 6 else None

    settled = _SETTLED * max(1.0, target.size)
    return gauss_newton(
        (R, t),
        match,
        move_placement,
        lambda step, _: is_near and bool(np.abs(step).max() < settled),
        _ITERATIONS,
        lambda H: 1e-9 * np.trace(H),
    ).state


@dataclass(frozen=True, eq=False)
class ScanMatches:
    """Moved source points ``moved`` against planes of the target; ``arms`` from the present translation."""

    rows: Int[np.ndarray, " m"]
    targets: Int[np.ndarray, " m"]
    moved: Float[np.ndarray, "m 3"]
    normals: Float[np.ndarray, "m 3"]
    residual: Float[np.ndarray, " m"]
    std: float

    def equations(self, t: Float[np.ndarray, "3"]) -> StepEquations:
        """Unweighted; rotation in map axes about the translation's point, then translation."""
        J = np.concatenate([np.cross(self.moved - t, self.normals), self.normals], axis=1)
        return step_equations(-self.residual, J)


def closest_points(
    source: Cloud,
    target: Cloud,
    R: Float[np.ndarray, "3 3"],
    t: Float[np.ndarray, "3"],
    reach: float,
    admitted: float = 0.0,
) -> ScanMatches:
    """Moved points of the source with the nearest of the target.

    Those within ``reach`` m that face alike.
    Residuals beyond three robust standard deviations, and beyond ``admitted`` m, are left out.
    """
    moved = source.points @ R.T + t
    distance, index = target.tree.query(moved, distance_upper_bound=reach)
    rows = np.flatnonzero(np.isfinite(distance))
    index = index[rows]
    alike = np.einsum("ni,ni->n", source.normals[rows] @ R.T, target.normals[index]) > FACING
    rows, index = rows[alike], index[alike]
    normals = target.normals[index]
    residual = np.einsum("ni,ni->n", moved[rows] - target.points[index], normals)
    std = median_deviation(residual) if len(residual) else 0.0
    kept = np.abs(residual) <= max(_TRIMMED * std + 1e-12, admitted)
    return ScanMatches(rows[kept], index[kept], moved[rows[kept]], normals[kept], residual[kept], std)


def _dependence_factor(matches: ScanMatches, size: float) -> float:
    """Variance factor of sums of correlated residuals over patches.

    It is in terms of that of independent residuals; at least 2, for the target's noise.
    """
    _, patch = distinct_rows(np.floor(matches.moved / (_PATCH * size)).astype(np.int64))
    total = np.bincount(patch, weights=matches.residual)
    return max(2.0, float(np.sum(total**2) / max(np.sum(matches.residual**2), 1e-300)))


def distinct_rows(rows: Int[np.ndarray, "n k"]) -> tuple[Int[np.ndarray, "m k"], Int[np.ndarray, " n"]]:
    """Rows that differ, in ascending order by column, and the number among them of each given row.

    As ``np.unique`` along an axis, which compares whole rows and takes four times as long.
    """
    order = np.lexsort(rows.T[::-1])  # its last key, here the first column, counts most
    ascending = rows[order]
    begins = np.ones(len(rows), dtype=bool)  # of a run of equal rows
    begins[1:] = (ascending[1:] != ascending[:-1]).any(axis=1)
    number = np.empty(len(rows), dtype=np.intp)
    number[order] = np.cumsum(begins) - 1
    return ascending[begins], number


def coarse_pose(
    source: Cloud, target: Cloud, about: Float[np.ndarray, "3 3"], widest: float
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """The best of many starts about the middles of both clouds, rotations up to ``widest`` rad from ``about``."""
    few = Cloud.of(
        *(each[:: max(1, len(source.points) // _COARSE)] for each in (source.points, source.normals))
    )
    middle, centre, reach = target.points.mean(axis=0), source.points.mean(axis=0), 0.7 * target.size
    best, score = (about, middle - about @ centre), np.inf
    axes = np.concatenate(
        [np.eye(3), -np.eye(3), *([[a, b, c]] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1))]
    )
    axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    turns = [np.zeros(3), *(angle * axis for angle in np.arange(0.35, widest + 0.01, 0.35) for axis in axes)]
    for turn in turns:
        R = matrix_from_rotation_vector(turn) @ about
        t = middle - R @ centre
        reaches = (reach * 0.75**k for k in count())

        def match(placement: Placement, reaches: Iterator[float] = reaches) -> StepEquations | None:
            matches = closest_points(few, target, *placement, next(reaches))
            return matches.equations(placement[1]) if len(matches.rows) >= 20 else None

        R, t = gauss_newton(
            (R, t),
            match,
            move_placement,
            lambda *_: False,
            _COARSE_ITERATIONS,
            lambda H: 1e-6 * np.trace(H),
        ).state
        distance = target.tree.query(few.points @ R.T + t)[0]
        found = float(np.mean(np.minimum(distance, 0.1 * target.size)))
        if found < score:
            best, score = (R, t), found
    return best


def cloud_of(points: Float[np.ndarray, "n 3"], viewpoint: Float[np.ndarray, "3"], most: int) -> Cloud:
    """A scan's thinned cloud; normals come from all of its points and face the viewpoint."""
    kept = points[evenly_spaced(len(points), most)]
    tree = KDTree(points)
    around = points[tree.query(kept, min(NEIGHBOURS, len(points)))[1]]
    centred = around - around.mean(axis=1, keepdims=True)
    _, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", centred, centred))
    normals = vectors[:, :, 0]
    away = np.einsum("ni,ni->n", normals, kept - viewpoint) > 0
    return Cloud.of(kept, np.where(away[:, None], -normals, normals))
