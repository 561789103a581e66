"""Gauss-Newton on the first state of a timeline, with everything after it marginalised.

About the noise-free motion from a trial first state, the errors e_k obey a linear model with process noise. A fixed-point smoother
carries e_0 along with e_k (Anderson and Moore 1979, ch. 7): one forward sweep gives the posterior of e_0, hence the next trial, its
information, and the cost (normalised innovations squared), so that no process noise is mistaken for inertia.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular

from spinfilters.estimators.estimator import Measurement, ProcessModel
from spinfilters.estimators.gain import MeasurementPrediction, apply_gain, compressed, triangular_factor
from spinfilters.estimators.timeline import Timeline

COST_CHANGE = 1e-3
"""A step that lowers the cost by less (in units of a squared standard deviation) changes nothing that matters."""
HOPELESS_DAMPING = 1e8


@dataclass(frozen=True)
class FirstStatePrior:
    """Mean (point of the layout) and standard deviations of the independent prior of the first state."""

    mean: Float[np.ndarray, " m"]
    std: Float[np.ndarray, " n"]


@dataclass(frozen=True)
class FirstState:
    """A fitted first state.

    Attributes
    ----------
    information: (n, n) of the measurements alone, without the prior.
    cost: sum of normalised innovations squared under it.   dof: number of scalar measurements.
    total: cost with the prior, by which fits are compared.
    """

    mean: Float[np.ndarray, " m"]
    information: Float[np.ndarray, "n n"]
    cost: float
    total: float
    dof: int
    iterations: int
    converged: bool


@dataclass(frozen=True)
class _Sweep:
    """Posterior of the first error about a trial point: its mean and covariance factor.

    ``cost`` is what the best first error of the linear model leaves; ``total``, the cost of the trial point itself, is that plus the
    squared length of the step to it, which is exact because the linear model is exact at the trial point.
    """

    error: np.ndarray
    factor: np.ndarray
    total: float
    cost: float
    dof: int


def fit_first_state(
    process: ProcessModel, frames: Timeline, x: Float[np.ndarray, " m"], prior: FirstStatePrior, iterations: int
) -> FirstState:
    """The most probable first state, by Levenberg-Marquardt from ``x``."""
    layout, damping, converged, used = process.layout, 0.0, False, 0
    sweep = _sweep(process, frames, x, prior)
    for _ in range(iterations):
        used += 1
        trial = layout.retract(x, _damped(sweep, damping))
        new = _sweep(process, frames, trial, prior)
        if np.isfinite(new.total) and new.total <= sweep.total + COST_CHANGE:
            converged = sweep.total - new.total < COST_CHANGE and damping < 1e-2
            x, sweep, damping = trial, new, damping / 10 if damping > 1e-4 else 0.0
            if converged:
                break
        else:
            damping = max(damping * 10, 1e-3)
            if damping > HOPELESS_DAMPING:
                break
    return FirstState(x, _information(sweep, prior), sweep.cost, sweep.total, sweep.dof, used, converged)


def _damped(sweep: _Sweep, damping: float) -> np.ndarray:
    if damping == 0.0:
        return sweep.error
    information = np.linalg.inv(sweep.factor @ sweep.factor.T)
    scale = np.sqrt(np.diag(information))
    scaled = information / np.outer(scale, scale)
    return np.linalg.solve(scaled + damping * np.eye(len(scale)), scaled @ (scale * sweep.error)) / scale


def _information(sweep: _Sweep, prior: FirstStatePrior) -> np.ndarray:
    """Information of the data: the posterior's less the prior's, with rounding below zero cut off."""
    scaled = sweep.factor / prior.std[:, None]
    values, vectors = np.linalg.eigh(np.linalg.inv(scaled @ scaled.T) - np.eye(len(scaled)))
    return (vectors * np.maximum(values, 0.0)) @ vectors.T / np.outer(prior.std, prior.std)


def _sweep(process: ProcessModel, frames: Timeline, x: np.ndarray, prior: FirstStatePrior) -> _Sweep:
    """Fixed-point smoother of (e_k, e_0) about the noise-free motion from x."""
    layout, n = process.layout, process.layout.error_dim
    away = layout.local(x, prior.mean)
    error = np.concatenate([away, away])
    factor = np.zeros((2 * n, 2 * n))
    factor[:n, :n] = factor[n:, :n] = np.diag(prior.std)
    time, cost, dof = frames[0].time, 0.0, 0
    for frame in frames:
        if frame.time > time:
            x, transition, noise = process.linearise(x, frame.time - time)
            time = frame.time
            error[:n] = transition @ error[:n]
            moved = np.concatenate([transition @ factor[:n], factor[n:]])
            wide = np.concatenate([noise, np.zeros_like(noise)])
            factor = triangular_factor(np.concatenate([moved.T, wide.T]))
        for measurement in frame.measurements:
            prediction = _predicted(measurement, x, error[:n], factor)
            correction = apply_gain(prediction)
            error = error + correction.error
            factor, cost, dof = correction.factor, cost + correction.nis, dof + prediction.dof
    root = triangular_factor(factor[n:].T)
    whitened = solve_triangular(root, error[n:], lower=True)
    return _Sweep(error[n:], root, cost + float(whitened @ whitened), cost, dof)


def _predicted(
    measurement: Measurement, x: np.ndarray, error: np.ndarray, factor: np.ndarray
) -> MeasurementPrediction:
    model = measurement.model
    rho, H, valid, log_noise = model.linearise(x, measurement.parameters, measurement.values)
    if not valid.all():
        rho, H, log_noise = rho[valid], H[valid], log_noise[valid]
    columns = model.columns
    count = rho.size
    rows = H.reshape(-1, len(columns))
    innovation, jacobian, residual = compressed(rho.reshape(-1) - rows @ error[columns], rows)
    return MeasurementPrediction(
        innovation, jacobian @ factor[columns], factor, residual, count, float(log_noise.sum())
    )
