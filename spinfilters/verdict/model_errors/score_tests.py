"""Score tests of model errors: size, gain and probability of each without a second fit.

With y = J e + H theta + n and what the solution leaves, rho = M y (see `linear_rows`), the score of theta at zero is u = H'rho
with the information F = H'M H, so that u'F^-1 u is chi-squared (Rao 1948). Of an error drawn anew at every epoch the variance
s^2 has the likelihood ratio u'(F + I/s^2)^-1 u - ln|I + s^2 F|. Noise levels that were identified from the same data have taken
part of an error for noise; the gain therefore counts by how much every variance component falls once the error is removed,

    gain = sum over components of (S + 1) ln((r + 1) / (r' + 1)),

with r and r' its squared residuals before and after, S its redundancy: u'F^-1 u for small errors, and the fall of -2 ln of the
likelihood profiled over the noise levels for large ones; r - r' of a level that is stated. The error is removed at its most
probable size, compared with what is plausible of it, and a size beyond that costs what it is less probable. The probability of as
large a gain without the error is that of `noise_components`.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float

from spinfilters.core.chi_square import chi_square_tail
from spinfilters.core.linear_algebra import evenly_spaced
from spinfilters.verdict.model_errors.alternatives import Alternative
from spinfilters.verdict.model_errors.linear_rows import Columns, summed
from spinfilters.verdict.model_errors.noise_components import (
    ColumnProducts,
    NoiseComponents,
    gain_tail,
    information_by_epoch,
    weighted_chi_square_tail,
)
from spinfilters.verdict.model_errors.smoothed_motion import SmoothedMotion

TELLING: Final = 1e-2
"""Probability of a test below which its error is removed from the solution, to see what that changes."""

TINY: Final = float(np.finfo(float).tiny)


class Effect(NamedTuple):
    """Effect of an error on the state component it moves most, in deviations: at one epoch, and rms over all."""

    largest: float
    rms: float


@dataclass(frozen=True)
class ScoreTest:
    """Score test of one model error.

    Attributes
    ----------
    size, std : (m,) float array
        Of its components, in its unit; of an error by epoch its standard deviation.
    statistic, dof : float
        Of the score, chi-squared without the error.
    gain : float
        See the module.
    p_value : float
        Probability of as much without the error.
    shift : (k, n) float array or None
        By which the states of all epochs move once the error is removed; None of one that is not `TELLING`.
    explained : (r,) float array or None
        What it explains of all whitened residuals, likewise.
    level : float
        By how much ln variance of an identified noise level falls with it removed, of the one that falls most.
    level_dof : float
        Degrees of freedom that identify the levels that fall; infinite of stated ones.
    beside_all : float
        Probability of a greater statistic relative to what all residuals leave, at the level of a correlated error; else 1.
    slow : float
        Share of what it explains (squared) that slow changes explain as well, of a gyro in a spin about one axis; else 0.
    beside_slow : float
        Statistic of what it explains in addition to these; infinite where there are none.
    map_share, beside_map : float
        Likewise in addition to errors of a map of the body that poses were registered to.
    is_possible : bool
        Whether a recording can have an error of this size; one by epoch also whether it is in more than a few of these.
    """

    error: Alternative
    size: Float[np.ndarray, " m"]
    std: Float[np.ndarray, " m"]
    statistic: float
    dof: float
    gain: float
    p_value: float
    shift: Float[np.ndarray, "k n"] | None = None
    explained: Float[np.ndarray, " r"] | None = None
    level: float = 0.0
    level_dof: float = np.inf
    beside_all: float = 1.0
    slow: float = 0.0
    beside_slow: float = np.inf
    map_share: float = 0.0
    beside_map: float = np.inf
    is_possible: bool = True

    @property
    def magnitude(self) -> float:
        """Length of the size."""
        return float(np.linalg.norm(self.size))

    @property
    def magnitude_std(self) -> float:
        """Its standard deviation."""
        return float(np.sqrt(self.std**2 @ self.size**2)) / max(self.magnitude, np.finfo(float).tiny)

    def likeness(self, other: "ScoreTest") -> float:
        """Correlation of what two errors explain; 0 where it is not known."""
        a, b = self.explained, other.explained
        if a is None or b is None or a.shape != b.shape:
            return 0.0
        product = float(a @ b) / max(float(np.sqrt((a @ a) * (b @ b))), TINY)
        return product if np.isfinite(product) else 0.0

    def effect(self, std: Float[np.ndarray, "k n"]) -> Effect:
        """How far the states would move, in their deviations; infinite where it is not known."""
        if self.shift is None or not (np.isfinite(self.shift).all() and std.shape == self.shift.shape):
            return Effect(np.inf, np.inf)
        moved = np.abs(self.shift) / np.where(std > 0, std, np.inf)
        return Effect(
            float(moved.max(initial=0.0)), float(np.sqrt(np.mean(moved**2, axis=0)).max(initial=0.0))
        )

    @property
    def is_telling(self) -> bool:
        """Whether as much is improbable enough without the error to see what its removal changes."""
        return self.p_value < TELLING

    def removing(self, motion: SmoothedMotion, right: Columns, explained: Columns) -> "ScoreTest":
        """With what its removal does, and whether there can be so much of it."""
        shift = motion.rows.sensitivity(right).states[:, :, 0]
        own, left = (
            np.concatenate([p.ravel() for p in each.parts]) for each in (explained, motion.rows.left)
        )
        is_possible = self.is_possible and self.error.is_possible(self.size, motion)
        found = replace(self, shift=shift, explained=own, is_possible=is_possible)
        if motion.slow_changes is not None:
            share, statistic = _split_explained(motion.slow_changes, own, left)
            found = replace(found, slow=share, beside_slow=statistic)
        if motion.map_changes is not None:
            share, statistic = _split_explained(motion.map_changes, own, left)
            found = replace(found, map_share=share, beside_map=statistic)
        return found

    @property
    def score_p_value(self) -> float:
        """Probability of a greater statistic at the noise levels of the estimates."""
        once = float(chi_square_tail(self.statistic, self.dof))
        return min(self.error.trials * once, self.beside_all)

    def p_value_of_inflated(self, inflation: float) -> float:
        """Probability of a greater statistic than one that errors inflate by a factor."""
        return min(1.0, self.error.trials * float(chi_square_tail(self.statistic / inflation, self.dof)))

    @property
    def p_value_beside_slow(self) -> float:
        """Probability of a greater statistic in addition to slow changes."""
        return float(chi_square_tail(self.beside_slow, self.dof))

    @property
    def p_value_beside_map(self) -> float:
        """Probability of a greater statistic in addition to errors of a map."""
        return min(1.0, self.error.trials * float(chi_square_tail(self.beside_map, self.dof)))

    @property
    def merit(self) -> float:
        """Gain beyond what so many free numbers take of noise (Akaike 1974)."""
        return self.gain - 2 * self.dof


def _split_explained(
    changes: Float[np.ndarray, "r s"], own: Float[np.ndarray, " r"], left: Float[np.ndarray, " r"]
) -> tuple[float, float]:
    """Share of what an error explains that changes explain as well, and its statistic in addition to these."""
    beside = own - changes @ (changes.T @ own)
    square, every = float(beside @ beside), max(float(own @ own), TINY)
    return 1 - square / every, float(beside @ left) ** 2 / max(square, TINY)


LEAST_LEFT: Final = 5e-6
"""Share of a direction's information that states and landmarks must leave; with less it is consistent with any size."""

LEAST_BESIDE_PRIOR: Final = 0.1
"""Likewise, relative to that of what is plausible: what data determine to three times that at best is the error of linearising."""

ROUNDING: Final = 1e-9
"""Length of a component's column relative to the longest, below which it is zero but for rounding: an arm along the axis about
which an inspector turns displaces nothing. Scaled to the others' length it would hide every direction that it mixes with."""

HARDLY_LEFT, FARTHEST = 1e-3, 10.0
"""Share of a direction's information below which a size beyond so many plausible deviations is no size: the states follow such an
error nearly, and what they leave of it is second order. A baseline larger by e makes a motion larger by e with all that disturbs
it, so that residuals are least at e = -1 whatever the baseline is."""


class ErrorSize(NamedTuple):
    """Size of q numbers by their score and information.

    Attributes
    ----------
    value, covariance : (q,) float array, (q, q) float array
        Without a prior.
    probable : (q,) float array
        Most probable with one.
    improbability : float
        -2 ln prior of that.
    dof : float
        Numbers that are reported.
    """

    value: Float[np.ndarray, " q"]
    covariance: Float[np.ndarray, "q q"]
    probable: Float[np.ndarray, " q"]
    improbability: float
    dof: float

    @classmethod
    def of(
        cls, F: Float[np.ndarray, "q q"], u: Float[np.ndarray, " q"], prior: Float[np.ndarray, " q"]
    ) -> "ErrorSize | None":
        """The size along what the data determine of it; None where that is nothing.

        Parameters
        ----------
        F, u : (q, q) float array, (q,) float array
            Information and score.
        prior : (q,) float array
            Information of the diagonal prior.
        """
        values, vectors = np.linalg.eigh((F + F.T) / 2)
        plausible = np.einsum("ij,i,ij->j", vectors, prior, vectors)
        told = values > np.maximum(LEAST_LEFT, LEAST_BESIDE_PRIOR * plausible)
        beyond = np.abs(vectors.T @ u) * np.sqrt(plausible) > FARTHEST * values
        told &= ~(beyond & (values < HARDLY_LEFT))
        if not told.any():
            return None
        along = vectors[:, told]
        covariance = along / values[told] @ along.T
        probable = along @ np.linalg.solve(along.T @ (F + np.diag(prior)) @ along, along.T @ u)
        return cls(covariance @ u, covariance, probable, float(prior @ probable**2), float(told.sum()))


MOST_EPOCHS: Final = 60
"""At which an error drawn by epoch is looked for; of a longer recording they are chosen evenly."""
VARIANCES: Final = np.logspace(-2, 6, 65)
"""Of an error by epoch that are tried, in those that its most telling direction is known to."""
UNEVEN: Final = 1e-3
"""Probability of a larger error at some epoch among such, below which it is a jump there."""
TESTED_VARIANCES: Final = (0.1, 1.0, 10.0, 100.0)
"""Of an error by epoch, likewise, for each of which there is a test: the most powerful one against it."""


class _UnexplainedResiduals(NamedTuple):
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
    """Score tests of all errors that apply and that the states leave room for, the most explaining first."""
    left = _UnexplainedResiduals(motion.rows.left, noise.squares(motion.rows.left))
    found: list[ScoreTest | None] = []
    constant, given = list[Alternative](), list[Columns]()
    for error in errors:
        columns = None if error.is_held(motion) else error.columns(motion)
        if columns is None:
            continue
        if error.by_epoch:
            found.append(_by_epoch(motion, noise, _ErrorColumns(error, columns), left))
        else:
            constant.append(error)
            given.append(columns)
        del columns
    found += _constant(motion, noise, constant, given)
    return sorted((each for each in found if each is not None), key=lambda each: -each.merit)


def likelier(found: list[ScoreTest], beside: list[ScoreTest], advantage: float) -> list[ScoreTest]:
    """The better of two tests of each error: at noise levels that explain the misfit, and at the stated levels.

    Parameters
    ----------
    found : list[ScoreTest]
        At noise levels as the data would have them.
    beside : list[ScoreTest]
        At those stated.
    advantage : float
        By how much -2 ln likelihood is less at the former, which an error has to make up for.
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
    motion: SmoothedMotion, noise: NoiseComponents, errors: list[Alternative], given: list[Columns]
) -> list[ScoreTest | None]:
    """Errors of the whole recording, with the right-hand sides of each."""
    if not errors:
        return []
    every = ColumnProducts.of(motion.rows, noise, given)
    named = map(_ErrorColumns, errors, given)
    return [
        _test_error(motion, noise, each, own, every) for each, own in zip(named, every.places, strict=True)
    ]


def _test_error(
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
    scale = np.where(scale > ROUNDING * scale.max(), scale, scale.max())
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
    motion: SmoothedMotion, noise: NoiseComponents, named: _ErrorColumns, left: _UnexplainedResiduals
) -> ScoreTest | None:
    """An error drawn anew at every epoch, of the variance that is most likely."""
    error, columns = named
    K = len(motion.time)
    chosen = evenly_spaced(K, MOST_EPOCHS)
    F = information_by_epoch(motion.rows, columns, chosen)
    u = _score_by_epoch(motion, columns, left.columns)[chosen].reshape(-1)
    if not np.isfinite(F).all() or np.trace(F) <= LEAST_LEFT * float(columns.squares.sum()):
        return None
    values, vectors = np.linalg.eigh(F)
    values, along = np.maximum(values, 0.0), vectors.T @ u
    variance, likelihood = _most_likely(values, along, error.plausible**2)
    every = np.zeros((K, columns.count))
    drawn = vectors @ (variance * along / (1 + variance * values))
    every[chosen] = drawn.reshape(len(chosen), -1)
    free = float((variance * values / (1 + variance * values)).sum())
    right = _scale_columns(motion, columns, every[:, :, None])
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


def _scale_columns(motion: SmoothedMotion, columns: Columns, sizes: Float[np.ndarray, "k q m"]) -> Columns:
    """Right-hand sides of an error with these sizes at every epoch."""
    sensors, seen = _epochs_of(motion)
    nothing = motion.rows.nothing(sizes.shape[2], is_measured=False)
    pairs = zip(columns.sensors, sensors, strict=not columns.seen)
    made = tuple(part @ sizes[epoch] for part, epoch in pairs)
    errors = tuple(replace(each, errors=each.errors @ sizes) for each in columns.seen)
    observed = None
    if columns.observations is not None and seen is not None:
        observed = columns.observations @ sizes[seen]
    return Columns(made, nothing.steps, observed, nothing.prior, seen=errors)


def _score_by_epoch(motion: SmoothedMotion, columns: Columns, left: Columns) -> Float[np.ndarray, "k q m"]:
    """H_k' rho for every epoch."""
    sensors, seen = _epochs_of(motion)
    count = len(motion.time)
    found = np.zeros((count, columns.count, left.count))
    for each, gradient in zip(columns.seen, motion.rows.left_gradients, strict=bool(columns.seen)):
        found += np.einsum("kcq,kc->kq", each.errors, gradient)[:, :, None]
    for part, rest, epoch in zip(columns.sensors, left.sensors, sensors, strict=not columns.seen):
        found += summed(epoch, count, np.swapaxes(part, 1, 2) @ rest)
    if columns.observations is not None and left.observations is not None and seen is not None:
        found += summed(seen, count, np.swapaxes(columns.observations, 1, 2) @ left.observations)
    return found
