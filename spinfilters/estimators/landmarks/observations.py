"""Observations of landmarks of the map, from their rows to a correction of state and modes."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from spinfilters.estimators.filters.square_root_update import Correction
from spinfilters.estimators.landmarks.steps import LinearisedObservations, MapObservations, WhitenedLandmarks
from spinfilters.estimators.robust.outlier_rejection import SensorOutlierRejection


class ChosenObservations(NamedTuple):
    """Choice of k observations, and their weights."""

    which: Int[np.ndarray, " u"]
    weights: Float[np.ndarray, " u"]


class SolvedObservations(NamedTuple):
    """Solution of an update by observations of landmarks.

    Attributes
    ----------
    used: (u,) which of the k count, and their weights.
    whitened: rows of those; the last linearisation's, told about the point before the update.
    """

    correction: Correction
    used: Int[np.ndarray, " u"]
    weights: Float[np.ndarray, " u"]
    whitened: WhitenedLandmarks

    @property
    def coordinates(self) -> Float[np.ndarray, " N"]:
        """Coordinates of the correction, as `length` measures it."""
        return self.correction.coordinates

    def length(self, step: Float[np.ndarray, " N"]) -> float:
        """See `spinfilters.estimators.filters.iterated_update.Solution`."""
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
    return _weighed(o, o.rows_at(x), factor, guard) if found is None else _accepted(o, *found, guard)


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
    return _weighed(o, linear, factor, guard) if found is None else _accepted(o, *found, guard)


def _accepted(
    observations: MapObservations,
    correction: Correction,
    whitened: WhitenedLandmarks,
    guard: SensorOutlierRejection,
) -> SolvedObservations:
    """The correction by all observations, each of full weight."""
    k = len(observations.at)
    guard.count(k, 0)
    return SolvedObservations(correction, np.arange(k), np.full(k, 1 / observations.scale), whitened)


def _weighed(
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
