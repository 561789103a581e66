"""Likelihood of the noise levels of a solved linear problem, states and landmarks integrated out."""

from typing import Final

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import gammaln

from spinfilters.estimators.model_errors.linear_rows import LinearRows

GROSS: Final = 30.0
"""Width of gross errors over the standard deviation of the noise."""
RARE: Final = 0.02
"""Share of measurements that are gross errors, before the data tell."""


def minus_twice_log_likelihood(rows: LinearRows) -> float:
    """-2 ln likelihood of the measurements, states and landmarks integrated out (Laplace).

    Up to a constant of the measurements' number. Measurements that are refused count as gross errors.
    """
    total = float(rows.left.gram(rows.left)[0, 0]) + _of_sensors(rows) + _of_observations(rows)
    fit, s = rows.normal.eliminated, rows.solution
    d = len(rows.problem.ordering.moving)
    total -= 2 * float(np.linalg.slogdet(rows.here.dynamics.rows[:, :, d : 2 * d])[1].sum())
    total += 2 * float(np.log(np.diag(s.information_sqrt)).sum())
    total += 2 * float(np.log(np.einsum("kii->ki", s.tridiagonal.information_sqrts)).sum())
    if fit is not None:
        told = np.einsum("kii->ki", fit.information_sqrt[fit.is_constrained])
        total += 2 * float(np.log(told).sum())
    return total


def _of_sensors(rows: LinearRows) -> float:
    """ln determinant of the noise covariances, and what refused measurements add."""
    total = 0.0
    for sensor, counts in zip(rows.problem.motion.sensors, rows.counted, strict=True):
        if not len(sensor.epoch):
            continue
        x, scale = rows.here.trajectory[sensor.epoch], 1.0 if sensor.scale is None else sensor.scale
        innovation, valid = sensor.model.innovations(x, sensor.parameters, sensor.values)
        whitening = sensor.model.whitening(x, sensor.parameters) / np.expand_dims(scale, -1)
        total += _stated_cost(innovation[valid] / scale, whitening[valid], counts[valid])
    return total


def _of_observations(rows: LinearRows) -> float:
    """The same of observations of landmarks that are well-constrained."""
    fit, observations, total = rows.normal.eliminated, rows.problem.observations, 0.0
    if fit is None or observations is None:
        return total
    for group in observations.groups:
        told = fit.is_constrained[observations.landmark[group.rows]]
        at, scale = group.rows[told], observations.scale
        points, x = rows.here.points[observations.landmark[at]], rows.here.trajectory[observations.epoch[at]]
        parameters = np.concatenate([points, group.parameters[told]], axis=1)
        innovation, valid = group.model.innovations(x, parameters, group.values[told])
        whitening = group.model.whitening(x, parameters) / scale
        total += _stated_cost(innovation[valid] / scale, whitening[valid], fit.used[at][valid])
    return total


def _stated_cost(
    innovation: Float[np.ndarray, "k i"],
    whitening: Float[np.ndarray, "k i i"],
    counts: Bool[np.ndarray, " k"],
) -> float:
    squares = np.sum(innovation[~counts] ** 2, axis=1)
    refused = gross_error_cost(squares, innovation.shape[1]).sum()
    return float(refused - 2 * np.linalg.slogdet(whitening)[1].sum())


def gross_error_cost(squares: Float[np.ndarray, " k"], size: int) -> Float[np.ndarray, " k"]:
    """-2 ln density of gross errors over that of white noise at its centre.

    Cauchy's, far wider than the noise, times how rare they are: noise that is too small does not gain by what is refused for it.

    Parameters
    ----------
    squares: squared lengths of whitened innovations of ``size`` components.
    """
    shape = (size + 1) / 2
    constant = size * np.log(GROSS**2 / 2) + 2 * (gammaln(0.5) - gammaln(shape)) - 2 * np.log(RARE)
    return constant + 2 * shape * np.log1p(squares / GROSS**2)
