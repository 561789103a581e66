"""Score tests: gain of each model error without a second fit.

With y = J e + H theta + n and what the solution leaves, rho = M y (see `linear_rows`), the score of theta at zero is u = H'rho
with the information F = H'M H, so that u'F^-1 u is chi-squared (Rao 1948). Of an error drawn anew at every epoch the variance
s^2 has the likelihood ratio u'(F + I/s^2)^-1 u - ln|I + s^2 F|. Noise levels that were identified from the same data have taken
part of an error for noise; the gain therefore counts by how much every variance component falls once the error is removed,

    gain = sum over components of (S + 1) ln((r + 1) / (r' + 1)),

with r and r' its squared residuals before and after, S its redundancy: u'F^-1 u for small errors, and the fall of -2 ln of the
likelihood profiled over the noise levels for large ones; r - r' of a level that is stated. The error is removed at its most
probable size, beside what is plausible of it, and a size beyond that costs what it is less probable. How likely as much is
without the error: `null_distributions`.
"""

from collections.abc import Iterable
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.model_errors.alternative import Alternative
from spinfilters.estimators.model_errors.column_products import ColumnProducts
from spinfilters.estimators.model_errors.columns import Columns
from spinfilters.estimators.model_errors.epoch_information import information_by_epoch
from spinfilters.estimators.model_errors.error_size import LEAST_LEFT, ErrorSize
from spinfilters.estimators.model_errors.linear_rows import summed
from spinfilters.estimators.model_errors.noise_components import NoiseComponents
from spinfilters.estimators.model_errors.null_distributions import gain_tail, weighted_chi_square_tail
from spinfilters.estimators.model_errors.score_test import ScoreTest
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.linear_algebra.chi_square import chi_square_tail

MOST_EPOCHS: Final = 60
"""At which an error drawn by epoch is looked for; of a longer recording they are chosen evenly."""
VARIANCES: Final = np.logspace(-2, 6, 65)
"""Of an error by epoch that are tried, in those that its most telling direction is known to."""
UNEVEN: Final = 1e-3
"""Probability of a larger error at some epoch among such, below which it is a jump there."""
TESTED_VARIANCES: Final = (0.1, 1.0, 10.0, 100.0)
"""Of an error by epoch, likewise, for each of which there is a test: the most powerful one against it."""


class _Left(NamedTuple):
    """What the solution leaves of the measurements, and its squares by noise component."""

    columns: Columns
    squares: Float[np.ndarray, " c"]


class _ErrorColumns(NamedTuple):
    """An error, and its right-hand sides H."""

    error: Alternative
    columns: Columns


def score_tests(
    motion: SmoothedMotion, noise: NoiseComponents, errors: Iterable[Alternative]
) -> list[ScoreTest]:
    """Score tests of all possible errors, the most explaining first.

    Those that a data set can have and that its states leave room for.
    """
    left = _Left(motion.rows.left, noise.squares(motion.rows.left))
    found: list[ScoreTest | None] = []
    constant: list[_ErrorColumns] = []
    for error in errors:
        columns = None if error.is_held(motion) else error.columns(motion)
        if columns is None:
            continue
        if error.by_epoch:
            found.append(_by_epoch(motion, noise, _ErrorColumns(error, columns), left))
        else:
            constant.append(_ErrorColumns(error, columns))
    found += _constant(motion, noise, constant)
    return sorted((each for each in found if each is not None), key=lambda each: -each.merit)


def likelier(found: list[ScoreTest], beside: list[ScoreTest], advantage: float) -> list[ScoreTest]:
    """The better of two tests of each error.

    Among noise that explains the misfit, and in the place of that noise.

    Parameters
    ----------
    found: at noise levels as the data would have them.   beside: at those stated.
    advantage: by how much -2 ln likelihood is less at the former, which an error has to make up for.
    """
    other = {each.error.name: each for each in beside}
    best = []
    for each in found:
        instead = other.get(each.error.name)
        gained = -np.inf if instead is None else instead.statistic - advantage
        if instead is not None and gained > each.gain:
            beyond = _probability(each.error, gained, instead.dof, instead.level_dof)
            each = replace(
                instead, statistic=gained, gain=gained, p_value=min(beyond, each.p_value), beside_all=1.0
            )
        best.append(each)
    return sorted(best, key=lambda each: -each.merit)


def _constant(
    motion: SmoothedMotion, noise: NoiseComponents, errors: list[_ErrorColumns]
) -> list[ScoreTest | None]:
    if not errors:
        return []
    every = ColumnProducts.of(motion.rows, noise, [columns for _, columns in errors])
    return [_tested(motion, noise, each, own, every) for each, own in zip(errors, every.places, strict=True)]


def _tested(
    motion: SmoothedMotion,
    noise: NoiseComponents,
    named: _ErrorColumns,
    own: slice,
    every: ColumnProducts,
) -> ScoreTest | None:
    """One error of the whole recording, with its place ``own`` among all columns."""
    error, columns = named
    scale = np.sqrt(every.squares[own])
    if not (np.isfinite(scale).all() and scale.max(initial=0.0) > 0):
        return None
    scale = np.where(scale > 0, scale, 1.0)
    F, u = every.information[own, own] / np.outer(scale, scale), every.score[own] / scale
    size = ErrorSize.of(F, u, (scale * error.plausible) ** -2.0)
    if size is None:
        return None
    removed = size.probable / scale
    gain = noise.gain(every.left, every.left_without(own, removed))
    gained, dof = gain.value - size.improbability, size.dof
    std = np.sqrt(np.diag(size.covariance)) / scale
    if error.only_positive and size.value[0] < 0:
        return ScoreTest(error, size.value / scale, std, 0.0, dof, 0.0, 1.0)
    p_value, statistic = _probability(error, gained, dof, gain.dof), float(u @ size.value)
    found = ScoreTest(error, size.value / scale, std, statistic, dof, gained, p_value)
    beside_all = noise.beside_all(statistic, dof, every.left)
    found = replace(found, level=gain.level, level_dof=gain.dof, beside_all=beside_all)
    if not found.is_telling:
        return found
    right = columns.times(removed[:, None])
    return found.removing(motion, right, motion.rows.residual(right))


def _probability(error: Alternative, gained: float, dof: float, level_dof: float) -> float:
    """Probability of a greater gain without the error.

    Of an error that has one sign half that of either, of one that was sought in many places that of the largest of all.
    """
    once = gain_tail(gained, dof, level_dof) / (2.0 if error.only_positive else 1.0)
    return min(1.0, error.trials * once)


def _by_epoch(
    motion: SmoothedMotion, noise: NoiseComponents, named: _ErrorColumns, left: _Left
) -> ScoreTest | None:
    """An error drawn anew at every epoch, of the variance that is most likely."""
    error, columns = named
    K = len(motion.time)
    chosen = np.unique(np.linspace(0, K - 1, min(K, MOST_EPOCHS)).astype(int))
    F = information_by_epoch(motion.rows, columns, chosen)
    u = _score_by_epoch(motion, columns, left.columns)[chosen].reshape(-1)
    if not np.isfinite(F).all() or np.trace(F) <= LEAST_LEFT * float(np.trace(columns.gram(columns))):
        return None
    values, vectors = np.linalg.eigh(F)
    values, along = np.maximum(values, 0.0), vectors.T @ u
    variance, likelihood = _most_likely(values, along, error.plausible**2)
    every = np.zeros((K, columns.count))
    drawn = vectors @ (variance * along / (1 + variance * values))
    every[chosen] = drawn.reshape(len(chosen), -1)
    free = float((variance * values / (1 + variance * values)).sum())
    right = _drawn(motion, columns, every[:, :, None])
    explained = motion.rows.residual(right)
    after = noise.gain(left.squares, noise.squares(left.columns.minus(explained)))
    gain = max(likelihood, after.value - 2 * free) * K / len(chosen)
    curvature = float(((values / (1 + variance * values)) ** 2).sum()) / 2
    std = np.sqrt(1 / curvature) / (2 * np.sqrt(variance)) if variance else curvature**-0.25
    p_value = _p_value(values, along, noise.sensor_dof)
    found = ScoreTest(error, np.array([np.sqrt(variance)]), np.array([std]), likelihood, 1.0, gain, p_value)
    spread = np.sqrt(vectors**2 @ (variance**2 * values / (1 + variance * values)))
    found = replace(found, is_possible=_is_even(drawn, spread))
    return found.removing(motion, right, explained) if found.is_telling else found


def _is_even(drawn: Float[np.ndarray, " n"], spread: Float[np.ndarray, " n"]) -> bool:
    """Whether no drawn error is too large for the distribution of all."""
    square = float(np.max((drawn / np.where(spread > 0, spread, np.inf)) ** 2))
    return len(drawn) * float(chi_square_tail(square, 1.0)) >= UNEVEN


def _p_value(values: Float[np.ndarray, " n"], along: Float[np.ndarray, " n"], dof: float) -> float:
    """Of the most telling of the tests against `TESTED_VARIANCES`, of which there are several."""
    told = values > LEAST_LEFT * values.max(initial=0.0)
    v, squares, found = values[told], along[told] ** 2, 1.0
    for each in TESTED_VARIANCES:
        share = each / max(float(v.max(initial=0.0)), np.finfo(float).tiny)
        weights = share * v / (1 + share * v)
        form = float((weights * squares / v).sum())
        found = min(found, weighted_chi_square_tail(weights, form, dof))
    return min(1.0, len(TESTED_VARIANCES) * found)


def _most_likely(
    values: Float[np.ndarray, " n"], along: Float[np.ndarray, " n"], largest: float
) -> tuple[float, float]:
    """Variance of independent errors with information ``values`` and scores ``along``, and its -2 ln likelihood ratio."""
    share = np.concatenate([[0.0], VARIANCES / max(float(values.max()), np.finfo(float).tiny)])[:, None]
    share = np.minimum(share, largest)
    likelihood = (share * along**2 / (1 + share * values) - np.log1p(share * values)).sum(axis=1)
    best = int(likelihood.argmax())
    return float(share[best, 0]), float(likelihood[best])


def _epochs_of(motion: SmoothedMotion) -> tuple[list[np.ndarray], np.ndarray | None]:
    """Epochs of the rows of every sensor, and of the observations."""
    problem = motion.rows.problem
    seen = None if problem.observations is None else problem.observations.epoch
    return [sensor.epoch for sensor in problem.motion.sensors], seen


def _drawn(motion: SmoothedMotion, columns: Columns, sizes: Float[np.ndarray, "k q m"]) -> Columns:
    """Right-hand sides of an error with these sizes at every epoch."""
    sensors, seen = _epochs_of(motion)
    nothing = motion.rows.nothing(sizes.shape[2])
    made = tuple(part @ sizes[epoch] for part, epoch in zip(columns.sensors, sensors, strict=True))
    observed = None
    if columns.observations is not None and seen is not None:
        observed = columns.observations @ sizes[seen]
    return Columns(made, nothing.steps, observed, nothing.prior)


def _score_by_epoch(motion: SmoothedMotion, columns: Columns, left: Columns) -> Float[np.ndarray, "k q m"]:
    """H_k' rho for every epoch."""
    sensors, seen = _epochs_of(motion)
    count = len(motion.time)
    found = np.zeros((count, columns.count, left.count))
    for part, rest, epoch in zip(columns.sensors, left.sensors, sensors, strict=True):
        found += summed(epoch, count, np.swapaxes(part, 1, 2) @ rest)
    if columns.observations is not None and left.observations is not None and seen is not None:
        found += summed(seen, count, np.swapaxes(columns.observations, 1, 2) @ left.observations)
    return found
