"""The linear problem of a filter's step, solved in four ways.

Of a filter without a map, and three other ways of solving it.
A step takes the covariance P of all errors to T P+ T' + G G' of the state's, P+ = P - K S K' the update with unit noise and rows
H over state and landmarks. Of the state the filter's update is exact, however few modes landmarks share. The reference solves it
by the square-root array of Morf and Kailath (1975) with Householder reflections in extended precision (64 bits of mantissa); the
conventional filters form covariances in the precision that is tried, and symmetrise them.
"""

from dataclasses import dataclass

import mpmath
import numpy as np
from jaxtyping import Float

from experiments.arithmetic_runs import LAYOUT, FilterStep, RandomRun
from spinfilters.filters.landmark_map import HeldMap

STATE = LAYOUT.error_dim
DIGITS = 80
"""Of mpmath where extended precision cannot tell: more than any product of two factors has."""


@dataclass(frozen=True)
class LinearStep:
    """P -> T P+ T' + G G'.

    ``rows`` H (m, N) whitened, ``transition`` T (M, N), ``noise`` G (M, k).
    """

    rows: Float[np.ndarray, "m N"]
    transition: Float[np.ndarray, "M N"]
    noise: Float[np.ndarray, "M k"]


def joint_before(run: RandomRun, step: FilterStep) -> Float[np.ndarray, "N N"]:
    """Factor of the errors of state and landmarks before a step."""
    held = HeldMap.restored(step.before, run.options)
    if held is None:
        return step.before["factor"]
    return held.belief(LAYOUT, step.before["mean"], step.before["factor"]).joint_factor()


def linear_step(run: RandomRun, step: FilterStep) -> LinearStep:
    """The linear problem that the filter solved in this step.

    Of first order, of all errors before it, those of the state after it.
    """
    size = STATE + 3 * len(step.before.get("map.ids", ()))
    T = np.zeros((STATE, size))
    if step.measurement is None:
        _, T[:, :STATE], noise = run.process.linearise(step.before["mean"], run.dt)
        return LinearStep(np.zeros((0, size)), T, noise)
    T[:, :STATE] = LAYOUT.reset_jacobian(LAYOUT.local(step.before["mean"], step.after["mean"]))
    rows = _reading_rows(step, size) if step.change is None else _observation_rows(run, step, size)
    return LinearStep(rows, T, np.zeros((STATE, 0)))


def _reading_rows(step: FilterStep, size: int) -> Float[np.ndarray, "m N"]:
    measured = step.measurement
    assert measured is not None
    at = measured.model.linearise(step.before["mean"], measured.parameters, measured.values)
    H = np.zeros((at.jacobian.shape[1] * bool(step.accepted), size))
    if step.accepted:
        H[:, measured.model.columns] = at.jacobian[0]
    return H


def _observation_rows(run: RandomRun, step: FilterStep, size: int) -> Float[np.ndarray, "m N"]:
    measured, change = step.measurement, step.change
    assert measured is not None
    assert measured.ids is not None
    assert change is not None
    sensor = measured.model.landmark_sensor
    assert sensor is not None
    held = HeldMap.restored(step.before, run.options)
    if held is None:
        return np.zeros((0, size))
    before = held.belief(LAYOUT, step.before["mean"], step.before["factor"])
    where = [before.ids.tolist().index(i) for i in change.used.tolist()]
    rows = [measured.ids.tolist().index(i) for i in change.used.tolist()]
    parameters = np.concatenate([before.points[where], measured.parameters[rows, 3:]], axis=1)
    at = sensor.linearise_landmarks(before.mean, parameters, measured.values[rows])
    H = np.zeros((len(rows), 3, size))
    H[:, :, measured.model.columns] = at.jacobian
    for k, row in enumerate(where):
        H[k, :, STATE + 3 * row : STATE + 3 * row + 3] = at.by_landmark[k]
    return (np.sqrt(change.weights)[:, None, None] * H).reshape(-1, size)


def reference(factor: Float[np.ndarray, "N N"], step: LinearStep) -> Float[np.ndarray, "M M"]:
    """Factor after a step, in extended precision."""
    exact = [part.astype(np.longdouble) for part in (step.rows, step.transition, step.noise)]
    H, T, G = exact
    count = len(H)
    array = np.block(
        [[np.eye(count, dtype=np.longdouble), H @ factor], [np.zeros((len(factor), count)), factor]]
    )
    corrected = lower(array)[count:, count:]
    return lower(np.concatenate([T @ corrected, G], axis=1))


def lower(rows: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n n"]:
    """Lower triangular L with L L' = rows rows', by Householder reflections.

    In the precision of the rows.
    """
    n, k = rows.shape
    A = np.zeros((max(n, k), n), dtype=rows.dtype)
    A[:k] = rows.T
    for j in range(n):
        v = A[j:, j].copy()
        length = np.sqrt(v @ v)
        if length > 0:
            v[0] += np.copysign(length, v[0])
            A[j:, j:] -= np.outer(v * (2 / (v @ v)), v @ A[j:, j:])
    return np.tril(A[:n].T)


def subtracted(P: Float[np.ndarray, "N N"], step: LinearStep) -> Float[np.ndarray, "M M"]:
    """Covariance after a step by P - K S K'."""
    H, T, G = (part.astype(P.dtype) for part in (step.rows, step.transition, step.noise))
    S = H @ P @ H.T + np.eye(len(H), dtype=P.dtype)
    K = P @ H.T @ np.linalg.inv(S)
    return _symmetric(T @ (P - K @ S @ K.T) @ T.T + G @ G.T)


def joseph(P: Float[np.ndarray, "N N"], step: LinearStep) -> Float[np.ndarray, "M M"]:
    """Covariance by (I - K H) P (I - K H)' + K K'."""
    H, T, G = (part.astype(P.dtype) for part in (step.rows, step.transition, step.noise))
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + np.eye(len(H), dtype=P.dtype))
    A = np.eye(len(P), dtype=P.dtype) - K @ H
    return _symmetric(T @ (A @ P @ A.T + K @ K.T) @ T.T + G @ G.T)


CONVENTIONAL = {"P - K S K'": subtracted, "Joseph": joseph}


def _symmetric(P: np.ndarray) -> np.ndarray:
    return (P + P.T) / 2


def is_definite(P: Float[np.ndarray, "N N"]) -> bool:
    """Whether the stored covariance is positive definite.

    Its correlations by Cholesky in extended precision.
    """
    variances = np.diagonal(P).astype(np.longdouble)
    if not (np.isfinite(P).all() and (variances > 0).all()):
        return False
    scale = 1 / np.sqrt(variances)
    A = P.astype(np.longdouble) * scale[:, None] * scale
    for j in range(len(A)):
        if not A[j, j] > 0:
            return False
        A[j + 1 :, j + 1 :] -= np.outer(A[j + 1 :, j] / A[j, j], A[j, j + 1 :])
    return True


def forms_definite(factor: Float[np.ndarray, "N N"]) -> bool:
    """Whether the covariance formed from a factor is positive definite.

    The precision rises until that is proven or refuted.
    In double precision correlations minus a bound of their rounding must have a Cholesky factor; then in extended precision; what
    neither can tell is formed and factored in `DIGITS` digits.
    """
    scale = np.linalg.norm(factor.astype(np.longdouble), axis=1, keepdims=True)
    if not (np.isfinite(scale).all() and (scale > 0).all()):
        return False
    rows, eye = factor / scale, np.eye(len(factor))
    double = rows.astype(float)
    try:
        np.linalg.cholesky(double @ double.T - _rounding(double) * eye)
    except np.linalg.LinAlgError:
        return is_definite(rows @ rows.T - _rounding(rows) * eye) or _exactly_definite(factor)
    return True


def _rounding(rows: np.ndarray) -> np.floating:
    """Bound of what products of unit rows and their Cholesky factor lose."""
    return 4 * len(rows) ** 2 * np.finfo(rows.dtype).eps


def _exactly_definite(factor: Float[np.ndarray, "N N"]) -> bool:
    with mpmath.workdps(DIGITS):
        exact = mpmath.matrix(factor.astype(float).tolist())
        try:
            mpmath.cholesky(exact * exact.T)
        except ValueError:
            return False
    return True


def stds(factor: np.ndarray) -> np.ndarray:
    """Standard deviations, in the precision of extended numbers."""
    rows = factor.astype(np.longdouble)
    return np.sqrt((rows * rows).sum(axis=1))
