"""Information on errors drawn anew at every epoch, by solved rows.

F = H'M H = H'H - z'z with z = A^-1 J'H, J'J = A A': H is that of one epoch alone, so that H'H is block-diagonal and J'H holds the
states and landmarks of that epoch; no column of the length of all measurements is formed.
"""

import numpy as np
from jaxtyping import Float, Int

from spinfilters.estimators.model_errors.columns import Columns
from spinfilters.estimators.model_errors.linear_rows import LinearRows, summed
from spinfilters.estimators.model_errors.solved_columns import Gradient
from spinfilters.estimators.smoothing.factors.epoch_rows import EpochRows


def information_by_epoch(
    rows: LinearRows, columns: Columns, chosen: Int[np.ndarray, " c"]
) -> Float[np.ndarray, "n n"]:
    """F among the errors of the chosen epochs, epoch by epoch, of measured columns."""
    q, count = columns.count, len(chosen)
    F = -rows.half_solved(_gradient(rows, columns, chosen)).gram
    own = np.zeros((rows.problem.ordering.epochs, q, q))
    for sensor, part in zip(rows.problem.motion.sensors, columns.sensors, strict=True):
        each = EpochRows(part, sensor.epoch)
        own[sensor.epoch[each.first]] += each.information
    observations = rows.problem.observations
    if observations is not None and columns.observations is not None:
        products = np.swapaxes(columns.observations, 1, 2) @ columns.observations
        own += summed(observations.epoch, len(own), products)
    number = np.arange(count)
    blocks = F.reshape(count, q, count, q)
    blocks[number, :, number] += own[chosen]
    return F


def _gradient(rows: LinearRows, columns: Columns, chosen: Int[np.ndarray, " c"]) -> Gradient:
    """J'H, a column for each chosen epoch and error."""
    ordering, fit, q, count = rows.problem.ordering, rows.normal.eliminated, columns.count, len(chosen)
    K, d, number = ordering.epochs, len(ordering.moving), np.arange(count)
    every = np.zeros((K, len(ordering.order), count, q))
    for sensor, made, part in zip(rows.problem.motion.sensors, rows.by_epoch, columns.sensors, strict=True):
        by_epoch = made.gradient(part, K)[chosen]
        every[chosen[:, None], rows.columns_of(sensor), number[:, None]] += by_epoch
    landmarks = np.zeros((len(rows.here.points), 3, count * q))
    if fit is not None and rows.observation_rows is not None and columns.observations is not None:
        place = np.full(K, -1)
        place[chosen] = number
        own = np.flatnonzero(place[fit.observations.epoch] >= 0)
        at, landmark = place[fit.observations.epoch[own]], fit.observations.landmark[own]
        by_row = np.swapaxes(rows.observation_rows[own, :, :-1], 1, 2) @ columns.observations[own]
        every[chosen, :6, number] += summed(at, count, by_row[:, :6])
        seen = summed(landmark * count + at, len(landmarks) * count, by_row[:, 6:])
        seen = seen.reshape(len(landmarks), count, 3, q)
        landmarks = np.swapaxes(seen, 1, 2).reshape(len(landmarks), 3, count * q)
    flat = every.reshape(K, -1, count * q)
    return Gradient(flat[:, :d], flat[:, d:].sum(axis=0), landmarks)
