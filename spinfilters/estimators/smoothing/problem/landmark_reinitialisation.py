"""Re-initialisation of landmarks with fewer than two inliers.

A trial map may hold a landmark where a wrong association put it: then all its right observations fall to the gate for ever. Each
observation of such a landmark tells a point with a covariance by itself; the one that most others agree with wins.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.estimators.smoothing.factors.landmark_observations import (
    OBSERVATIONS_NEEDED,
    LandmarkObservations,
)


def reinitialised(
    observations: LandmarkObservations,
    trajectory: Float[np.ndarray, "k m"],
    points: Float[np.ndarray, "L 3"],
    inliers: Bool[np.ndarray, " N"],
    gate: float,
) -> Float[np.ndarray, "L 3"] | None:
    """Landmark points, those with fewer than two inliers re-initialised.

    m, frame g; None when there are none.

    Parameters
    ----------
    gate: Mahalanobis distance within which two observations' own points agree.
    """
    rows = _lost(observations, inliers)
    if not len(rows):
        return None
    rows, own, covariance_sqrt = _own_points(observations, trajectory, rows)
    rows, own, covariance_sqrt = _by_landmark(observations.landmark, rows, own, covariance_sqrt)
    if not len(rows):
        return None
    covariance = covariance_sqrt @ np.swapaxes(covariance_sqrt, 1, 2)
    landmark = observations.landmark[rows]
    one, other = _pairs(landmark)
    agree = _distance(own, covariance, one, other) < gate
    one, other = _both_ways(one[agree], other[agree], len(rows))
    votes = np.bincount(one, minlength=len(rows))
    order = np.lexsort((votes, landmark))
    winners = order[np.flatnonzero(np.diff(landmark[order], append=-1))]
    winners = winners[votes[winners] >= OBSERVATIONS_NEEDED]
    if not len(winners):
        return None
    kept = np.isin(one, winners)
    moved = points.copy()
    moved[landmark[winners]] = _means(one[kept], other[kept], own, covariance)[winners]
    return moved


def _lost(observations: LandmarkObservations, inliers: Bool[np.ndarray, " N"]) -> Int[np.ndarray, " r"]:
    """Observations of landmarks with fewer than two inliers, and with two observations that may agree."""
    every = np.diff(observations.start)
    hits = np.bincount(observations.landmark[inliers], minlength=len(every))
    lost = (hits < OBSERVATIONS_NEEDED) & (every >= OBSERVATIONS_NEEDED)
    return np.flatnonzero(lost[observations.landmark])


def _own_points(
    observations: LandmarkObservations, trajectory: Float[np.ndarray, "k m"], rows: Int[np.ndarray, " r"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows that tell a point by themselves, with points and covariance square roots."""
    found, points, covariance_sqrts = [np.zeros(0, dtype=int)], [np.zeros((0, 3))], [np.zeros((0, 3, 3))]
    for group in observations.groups:
        at = np.flatnonzero(np.isin(group.rows, rows))
        if not len(at):
            continue
        of = group.rows[at]
        parameters = np.concatenate([np.zeros((len(at), 3)), group.parameters[at]], axis=1)
        new = group.model.new_landmarks(trajectory[observations.epoch[of]], parameters, group.values[at])
        good = new.determined & np.isfinite(new.points).all(axis=1)
        found.append(of[good])
        points.append(new.points[good])
        covariance_sqrts.append(new.root[good])
    return np.concatenate(found), np.concatenate(points), np.concatenate(covariance_sqrts)


def _by_landmark(
    landmark: Int[np.ndarray, " N"], rows: Int[np.ndarray, " r"], *each: np.ndarray
) -> tuple[np.ndarray, ...]:
    order = np.argsort(landmark[rows], kind="stable")
    return rows[order], *(values[order] for values in each)


def _pairs(landmark: Int[np.ndarray, " r"]) -> tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]]:
    """Every pair of two rows of one landmark, the earlier first; landmarks ascend."""
    row = np.arange(len(landmark))
    count = np.searchsorted(landmark, landmark, side="right") - row - 1
    one = np.repeat(row, count)
    within = np.arange(len(one)) - np.repeat(np.cumsum(count) - count, count)
    return one, one + 1 + within


def _both_ways(
    one: Int[np.ndarray, " p"], other: Int[np.ndarray, " p"], rows: int
) -> tuple[Int[np.ndarray, " q"], Int[np.ndarray, " q"]]:
    """Ordered pairs, each row with itself among them."""
    itself = np.arange(rows)
    return np.concatenate([one, other, itself]), np.concatenate([other, one, itself])


def _distance(
    points: Float[np.ndarray, "r 3"],
    covariance: Float[np.ndarray, "r 3 3"],
    one: np.ndarray,
    other: np.ndarray,
) -> Float[np.ndarray, " p"]:
    """Mahalanobis distance of two points, by the adjugate of their covariances' sum."""
    x, y, z = (points[one] - points[other]).T
    spread = covariance[one] + covariance[other]
    a, b, c = spread[:, 0, 0], spread[:, 1, 1], spread[:, 2, 2]
    d, e, f = spread[:, 1, 0], spread[:, 2, 0], spread[:, 2, 1]
    first, second, third = b * c - f * f, e * f - d * c, d * f - e * b
    square = first * x * x + (a * c - e * e) * y * y + (a * b - d * d) * z * z
    square += 2 * (second * x * y + third * x * z + (d * e - a * f) * y * z)
    return np.sqrt(np.maximum(square, 0.0) / (a * first + d * second + e * third))


def _means(
    one: Int[np.ndarray, " p"],
    other: Int[np.ndarray, " p"],
    points: Float[np.ndarray, "r 3"],
    covariance: Float[np.ndarray, "r 3 3"],
) -> Float[np.ndarray, "r 3"]:
    """For every row named in ``one`` the information-weighted mean of the points of ``other``."""
    each = np.linalg.inv(covariance[other])
    information, weighted = np.zeros((len(points), 3, 3)), np.zeros((len(points), 3))
    np.add.at(information, one, each)
    np.add.at(weighted, one, (each @ points[other][..., None])[..., 0])
    result = np.full((len(points), 3), np.nan)
    named = np.unique(one)
    result[named] = np.linalg.solve(information[named], weighted[named][..., None])[..., 0]
    return result
