"""Observations of landmarks of the map, from their rows to a correction of state and modes.

They are linearised by first derivatives (`solve_at`), or by statistical linear regression on sigma points of the pose and of
each landmark (`Regression`; Lefebvre, Bruyninckx, De Schutter 2002). In the regression the pose moves with the first s
coordinates of the factor; a landmark with them, and with three coordinates of what else it depends on: later coordinates of the
modes, and its own error. What the regression leaves is noise.

A landmark that few observations have placed has an error in each lever arm, which the next innovation shares: summed over many
landmarks, the product pulls the state one way. `corrected_at_landmarks` therefore linearises such observations once more, at the
points that they themselves give. Only the turn of the pose against the map may get the new lever arms, because no observation
sees a turn of both (Huang, Mourikis, Roumeliotis 2010): the part of a landmark's error that comes from the attitude from which
it was seen before turns with its point.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.attitude_conversions import cross_matrix
from spinfilters.core.linear_algebra import dtrtrs
from spinfilters.filters.landmark_steps import (
    LinearisedObservations,
    MapObservations,
    PoseSpread,
    WhitenedLandmarks,
)
from spinfilters.filters.measurement_prediction import SigmaPointOptions, SigmaPoints, sigma_points
from spinfilters.filters.outlier_rejection import SensorOutlierRejection
from spinfilters.filters.square_root import Correction, covariance_factor, last_nonzero, lower_roots

LEVER_BIAS = 0.3
"""Standard deviations by which errors of lever arms may pull an update, in order of magnitude, before it is linearised again."""


class ChosenObservations(NamedTuple):
    """Choice of k observations, and their weights."""

    which: Int[np.ndarray, " u"]
    weights: Float[np.ndarray, " u"]


class SolvedObservations(NamedTuple):
    """Solution of an update by observations of landmarks.

    Attributes
    ----------
    used : ndarray of int, shape (u,)
        Indices of the observations among the k that are inliers.
    whitened : WhitenedLandmarks
        Their whitened rows, of the last linearisation, referred to the point before the update.
    """

    correction: Correction
    used: Int[np.ndarray, " u"]
    weights: Float[np.ndarray, " u"]
    whitened: WhitenedLandmarks

    def rows_of(self, at: Int[np.ndarray, " k"]) -> Int[np.ndarray, " u"]:
        """Rows of the map of the observations that are used, of the rows of all."""
        return at if len(self.used) == len(at) else at[self.used]

    @property
    def coordinates(self) -> Float[np.ndarray, " N"]:
        """Coordinates of the correction, as `length` measures it."""
        return self.correction.coordinates

    def length(self, step: Float[np.ndarray, " N"]) -> float:
        """See `spinfilters.filters.iterated_update.Solution`."""
        return self.correction.length(step)


def solve_at(
    observations: MapObservations,
    x: Float[np.ndarray, " m"],
    factor: Float[np.ndarray, "N N"],
    guard: SensorOutlierRejection,
) -> SolvedObservations:
    """Solve with first derivatives at a state, in one pass where all observations pass."""
    o = observations
    found = o.landmarks.steps.solved(o, x, factor, guard.limit(o.sensor.dim))
    return (
        _weigh_observations(o, o.rows_at(x), factor, guard)
        if found is None
        else _accept_all(o, *found, guard)
    )


def solve(
    observations: MapObservations,
    linear: LinearisedObservations,
    factor: Float[np.ndarray, "N N"],
    guard: SensorOutlierRejection,
) -> SolvedObservations:
    """The correction by all valid observations that the guard lets pass; at once, as `solve_at`."""
    o, found = observations, None
    if linear.valid.all():
        limit, log_noise = guard.limit(o.sensor.dim), float(linear.log_noise.sum())
        found = o.landmarks.steps.solved_rows(o, linear.rows, log_noise, factor, limit)
    return _weigh_observations(o, linear, factor, guard) if found is None else _accept_all(o, *found, guard)


def _accept_all(
    observations: MapObservations,
    correction: Correction,
    whitened: WhitenedLandmarks,
    guard: SensorOutlierRejection,
) -> SolvedObservations:
    """The correction by all observations, each of full weight."""
    k = len(observations.at)
    guard.count(k, 0)
    return SolvedObservations(correction, np.arange(k), np.full(k, 1 / observations.scale), whitened)


def _weigh_observations(
    observations: MapObservations,
    linear: LinearisedObservations,
    factor: Float[np.ndarray, "N N"],
    guard: SensorOutlierRejection,
) -> SolvedObservations:
    """The correction by valid observations with the weights that the guard gives them."""
    o, steps, valid = observations, observations.landmarks.steps, np.flatnonzero(linear.valid)
    rows, at = (linear.rows, o.at) if len(valid) == len(o.at) else (linear.rows[valid], o.at[valid])
    weights = np.full(len(valid), 1 / o.scale)
    white = steps.whitened(o.landmarks, at, rows, weights)
    given = guard.weights(white.rows[..., -1], lambda which: white.rows[which, :, :-1] @ factor[o.columns])
    if given is None:
        return corrected(o, linear, white, ChosenObservations(valid, weights), factor)
    keep = np.flatnonzero(given > 0)
    weights = (weights * given)[keep]
    white = steps.whitened(o.landmarks, at[keep], rows[keep], weights)
    return corrected(o, linear, white, ChosenObservations(valid[keep], weights), factor)


def corrected(
    observations: MapObservations,
    linear: LinearisedObservations,
    white: WhitenedLandmarks,
    chosen: ChosenObservations,
    factor: Float[np.ndarray, "N N"],
) -> SolvedObservations:
    """The correction by chosen observations."""
    log_noise = float(linear.log_noise[chosen.which].sum())
    steps, columns = observations.landmarks.steps, observations.columns
    return SolvedObservations(steps.corrected(white, factor, columns, log_noise), *chosen, white)


def corrected_at_landmarks(
    observations: MapObservations,
    mean: Float[np.ndarray, " m"],
    factor: Float[np.ndarray, "N N"],
    first: SolvedObservations,
) -> SolvedObservations:
    """The correction linearised at the state and the landmarks that the first one leads to, where these are young.

    Parameters
    ----------
    mean : ndarray of float, shape (m,)
        State before the update.
    factor : ndarray of float, shape (N, N)
        Factor of its errors, of the modes and of the move.
    first : SolvedObservations
        The correction that counts the landmarks' own errors as noise. It is returned where lever arms are known well, or where
        its point is impossible.
    """
    o, used = observations, first.used
    if not len(used) or _lever_bias(o, first) <= LEVER_BIAS:
        return first
    n, pose, held = o.layout.error_dim, o.sensor.columns, o.landmarks
    error, c, at = first.correction.error, len(pose), o.at[used]
    shared = error[n : n + held.rank]
    # Own error of a landmark, L X' (rho - H_x x - H_p A m), and with A m the step of its point.
    rest = first.whitened.rows[..., -1] - first.whitened.rows[..., :-1] @ error[o.columns]
    own = np.einsum("kij,kdj,kd->ki", o.roots[used], first.whitened.by_own, rest)
    step = np.zeros(o.points.shape)
    step[used] = o.modes[used] @ shared + own
    linear = o.rows_at(o.layout.retract(mean, error[:n]), o.points + step)
    if not (linear.valid[used].all() and np.isfinite(linear.rows[used]).all()):
        return first
    held.modes[at] += cross_matrix(step[used]) @ held.attitude
    # Jacobian by the pose, of errors about the mean; the innovation, extrapolated back to mean and points before the update.
    rows = linear.rows.copy()
    rows[..., :c] = rows[..., :c] @ o.layout.reset_jacobian(error[:n])[np.ix_(pose, pose)]
    rows[..., -1] += rows[..., :c] @ error[pose] + np.einsum("kdi,ki->kd", rows[..., c:-1], step)
    white = held.steps.whitened(held, at, rows[used], first.weights)
    return corrected(o, linear, white, ChosenObservations(used, first.weights), factor)


def _lever_bias(observations: MapObservations, first: SolvedObservations) -> float:
    """Pull by errors of lever arms on the state, standard deviations in order of magnitude.

    Of k d innovations, the landmarks' own errors make the share sum X^2; each pulls by its part of a lever arm, at most all of it.
    """
    count, d, _ = first.whitened.shape
    held = observations.landmarks
    numbers, own, lever = held.steps.lever_squares(held, observations.at, first.whitened).tolist()
    pull, part = numbers / math.sqrt(count * d), own / max(lever, np.finfo(float).tiny)
    return pull * min(math.sqrt(part), 1.0)


@dataclass(frozen=True)
class Regression:
    """Observations from a state with this mean and lower triangular factor."""

    observations: MapObservations
    mean: Float[np.ndarray, " m"]
    factor: Float[np.ndarray, "N N"]

    def rows(self, options: SigmaPointOptions) -> LinearisedObservations:
        """Rows of `MapObservations.rows_at` by statistical regression."""
        o, n = self.observations, self.observations.layout.error_dim
        pose, modes = self.factor[o.sensor.columns], self.factor[n : n + o.landmarks.rank]
        # Coordinates: s that move the pose, then 3 of the landmark's own (later modes and own error together).
        s = last_nonzero(pose)
        points = sigma_points(s + 3, options)
        states = o.layout.retract_each(self.mean, points.offsets[:, :s] @ self.factor[:n, :s].T)
        spread = Spread(states, pose[:, :s], modes[:, :s], covariance_factor(modes[:, s:].T))
        found = o.landmarks.steps.regressed(o, spread, points)
        return spread.regressed(o, points) if found is None else found


class Spread(PoseSpread):
    """States and landmarks moved by sigma points, and the regression over them."""

    def regressed(self, o: MapObservations, points: SigmaPoints) -> LinearisedObservations:
        """Observations regressed on errors of the pose, the modes and the landmark."""
        s, shared = self.pose.shape[1], o.modes @ self.modes
        own = lower_roots(np.concatenate([o.modes @ self.late, o.roots], axis=2))
        away, valid, log_noise = self._sight_points(o, points, np.concatenate([shared, own], axis=2))
        mean = away @ points.mean_weights
        slope, left = points.regressed(mean[..., None] - away)
        # In coordinates slope = [by_pose + by_landmark shared | by_landmark own]: solved for the landmark, then the pose.
        by_landmark = _divided_by_lower(slope[..., s:], own)
        by_pose = slope[..., :s] - by_landmark @ shared
        by_state = self._by_errors(by_pose.reshape(-1, s)).reshape(*mean.shape, len(self.pose))
        # What the regression leaves is noise: rows whitened by the root of I + left left'.
        root = np.linalg.cholesky(np.eye(left.shape[1]) + left @ np.swapaxes(left, 1, 2))
        every = np.concatenate([by_state, by_landmark, mean[..., None]], axis=2)
        rows = _solved_by_lower(root, every)
        log_noise = log_noise + np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
        return LinearisedObservations(rows, valid & np.isfinite(rows).all(axis=(1, 2)), log_noise)

    def _sight_points(
        self, o: MapObservations, points: SigmaPoints, moves: Float[np.ndarray, "k 3 q"]
    ) -> tuple[Float[np.ndarray, "k d p"], np.ndarray, Float[np.ndarray, " k"]]:
        """Whitened innovations at every point (0 where one is not valid), and log determinants of the noise at the centre."""
        k, p = len(o.values), len(points.offsets)
        # Items point by point, landmark by landmark: p k places, with the state of their point and the value of their landmark.
        moved = points.offsets @ moves.reshape(3 * k, moves.shape[2]).T
        places, each = o.points + moved.reshape(p, k, 3), np.tile(np.arange(k), p)
        away, valid, determinant = o.sensor.observation_innovations(
            self.states,
            places.reshape(-1, 3),
            o.parameters[:, 3:],
            o.values,
            rows=(np.repeat(np.arange(p), k), None, each, each),
        )
        away = np.moveaxis(away.reshape(p, k, o.sensor.dim), 0, 2)
        good = np.logical_and.reduce(valid.reshape(p, k) > 0, axis=0) & np.isfinite(away).all(axis=(1, 2))
        return np.where(good[:, None, None], away, 0.0), good, np.log(determinant[:k, 0])

    def _by_errors(self, by_coordinates: Float[np.ndarray, "q s"]) -> Float[np.ndarray, "q c"]:
        """X of least squares with X pose = by_coordinates."""
        if self.is_solvable:
            return dtrtrs(self.pose, by_coordinates.T, lower=1, trans=1)[0].T
        if not np.isfinite(self.pose).all():
            raise np.linalg.LinAlgError("the state's covariance is not finite")
        return np.linalg.lstsq(self.pose.T, by_coordinates.T, rcond=None)[0].T


def _solved_by_lower(
    root: Float[np.ndarray, "k d d"], right: Float[np.ndarray, "k d q"]
) -> Float[np.ndarray, "k d q"]:
    """root^-1 right for lower triangular roots, by batched substitution; 0 in the rows of a pivot of 0."""
    result = np.zeros(right.shape)
    # Row j of the result by the rows before it, for all items at once.
    for j in range(root.shape[1]):
        known = sum(root[:, j, i, None] * result[:, i] for i in range(j))
        pivot = root[:, j, j, None]
        np.divide(right[:, j] - known, pivot, out=result[:, j], where=pivot != 0)
    return result


def _divided_by_lower(
    left: Float[np.ndarray, "k q d"], root: Float[np.ndarray, "k d d"]
) -> Float[np.ndarray, "k q d"]:
    """left root^-1, likewise."""
    # X root = left is root' X' = left', upper triangular: both orders reversed it is lower again.
    flipped = np.swapaxes(root, 1, 2)[:, ::-1, ::-1]
    return np.swapaxes(_solved_by_lower(flipped, np.swapaxes(left, 1, 2)[:, ::-1])[:, ::-1], 1, 2)
