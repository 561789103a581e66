"""Score tests: what a smoothing problem's solution would gain by each model error, without a second fit.

With y = J e + H theta + n and what the solution leaves, rho = M y (see `linear_rows`), the score of theta at zero is u = H'rho
with the information F = H'M H, so that u'F^-1 u is chi-squared (Rao 1948). An error drawn anew at every epoch has the variance
score u'u, whose mean and variance are tr F and 2 tr F^2. Noise levels that were identified from the same data have taken part of
an error for noise; the gain therefore counts by how much every variance component falls once the error is removed,

    gain = sum over components of (S + 1) ln((r + 1) / (r' + 1)),

with r and r' its squared residuals before and after, S its redundancy: u'F^-1 u for small errors, and the fall of -2 ln of the
likelihood profiled over the noise levels for large ones.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.stats import chi2

from spinfilters.estimators.model_errors.linear_rows import Columns
from spinfilters.estimators.model_errors.model_error import ModelError
from spinfilters.estimators.model_errors.noise_components import NoiseComponents
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion

LEAST_LEFT: Final = 1e-6
"""Share of a direction's information that states and landmarks must leave; with less it is consistent with any size."""
MOST_EPOCHS: Final = 120
"""At which an error drawn by epoch is looked for; of a longer recording they are chosen evenly."""
TOGETHER: Final = 48
"""Right-hand sides that are solved for at once."""


@dataclass(frozen=True)
class ScoreTest:
    """What one model error explains.

    Attributes
    ----------
    size, std: of its components, in its unit; of an error by epoch its standard deviation.
    statistic, dof: of the score, chi-squared without the error.   p_value: of the greater of statistic and gain.
    gain: see the module.
    """

    error: ModelError
    size: Float[np.ndarray, " m"]
    std: Float[np.ndarray, " m"]
    statistic: float
    dof: float
    gain: float

    @property
    def p_value(self) -> float:
        """Probability of as much without the error."""
        return float(chi2.sf(max(self.statistic, self.gain), self.dof))

    @property
    def merit(self) -> float:
        """Gain beyond what so many free numbers take of noise (Akaike 1974)."""
        return self.gain - 2 * self.dof


def score_tests(
    motion: SmoothedMotion, noise: NoiseComponents, errors: Iterable[ModelError]
) -> list[ScoreTest]:
    """All errors that a data set can have and that its states leave room for, the most explaining first."""
    left = motion.rows.residual(motion.rows.right)
    found: list[ScoreTest | None] = []
    constant: list[tuple[ModelError, Columns]] = []
    for error in errors:
        columns = None if error.is_held(motion) else error.columns(motion)
        if columns is None:
            continue
        if error.by_epoch:
            found.append(_by_epoch(motion, noise, (error, columns), left))
        else:
            constant.append((error, columns))
    found += _constant(motion, noise, constant, left)
    return sorted((each for each in found if each is not None), key=lambda each: -each.merit)


def _constant(
    motion: SmoothedMotion, noise: NoiseComponents, errors: list[tuple[ModelError, Columns]], left: Columns
) -> list[ScoreTest | None]:
    if not errors:
        return []
    after = motion.rows.residual(Columns.joined([columns for _, columns in errors]))
    found, first = [], 0
    for error, columns in errors:
        own = slice(first, first + columns.count)
        first = own.stop
        found.append(_tested(noise, (error, columns), after.part(own), left))
    return found


def _tested(
    noise: NoiseComponents, named: tuple[ModelError, Columns], after: Columns, left: Columns
) -> ScoreTest | None:
    """One error of the whole recording; ``after`` is M H."""
    error, columns = named
    scale = np.sqrt(np.diag(columns.gram(columns)))
    if not (np.isfinite(scale).all() and scale.max(initial=0.0) > 0):
        return None
    scale = np.where(scale > 0, scale, 1.0)
    F, u = after.gram(columns) / np.outer(scale, scale), columns.gram(left)[:, 0] / scale
    values, vectors = np.linalg.eigh((F + F.T) / 2)
    told = values > LEAST_LEFT
    if not told.any():
        return None
    along = vectors[:, told]
    covariance = along / values[told] @ along.T
    size = covariance @ u
    removed = left.minus(after.times((size / scale)[:, None]))
    return ScoreTest(
        error,
        size / scale,
        np.sqrt(np.diag(covariance)) / scale,
        float(u @ size),
        float(told.sum()),
        noise.gain(left, removed),
    )


def _by_epoch(
    motion: SmoothedMotion, noise: NoiseComponents, named: tuple[ModelError, Columns], left: Columns
) -> ScoreTest | None:
    error, columns = named
    K = len(motion.time)
    chosen = np.unique(np.linspace(0, K - 1, min(K, MOST_EPOCHS)).astype(int))
    F, u = _information_by_epoch(motion, columns, chosen), _score_by_epoch(motion, columns, left)[chosen]
    u = u.reshape(-1)
    trace, squared = float(np.trace(F)), float(np.vdot(F, F))
    if not (np.isfinite(squared) and trace > 0):
        return None
    if trace < LEAST_LEFT * float(np.trace(columns.gram(columns))):
        return None
    variance = max((float(u @ u) - trace) / squared, 0.0)
    shrunk = np.linalg.solve(np.eye(len(u)) + variance * F, np.column_stack([u, F]))
    drawn, free = variance * shrunk[:, 0], variance * float(np.trace(shrunk[:, 1:]))
    every = np.zeros((K, columns.count))
    every[chosen] = drawn.reshape(len(chosen), -1)
    removed = left.minus(motion.rows.residual(_drawn(motion, columns, every[:, :, None])))
    share = K / len(chosen)
    size = np.sqrt(variance)
    std = np.sqrt(2 / squared) / (2 * size) if variance else np.sqrt(np.sqrt(2 / squared))
    scale = squared / trace  # Satterthwaite: u'u / scale is nearly chi-squared with trace / scale degrees of freedom
    statistic, dof = float(u @ u) / scale, trace / scale
    gain = noise.gain(left, removed) * share
    return ScoreByEpoch(
        error, np.array([size]), np.array([std]), statistic, dof, gain, free=free * share
    )


@dataclass(frozen=True)
class ScoreByEpoch(ScoreTest):
    """Of an error drawn anew at every epoch: one number, its variance, is free in the test, and as many as it explains in the fit.

    Attributes
    ----------
    free: effective number of what is drawn.
    """

    free: float = 0.0

    @property
    def p_value(self) -> float:
        """Of the variance score alone: the gain grows with every number that is drawn."""
        return float(chi2.sf(self.statistic, self.dof))

    @property
    def merit(self) -> float:
        """Gain beyond what the drawn numbers take of noise."""
        return self.gain - 2 * self.free


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
    found = np.zeros((len(motion.time), columns.count, left.count))
    for part, rest, epoch in zip(columns.sensors, left.sensors, sensors, strict=True):
        np.add.at(found, epoch, np.swapaxes(part, 1, 2) @ rest)
    if columns.observations is not None and left.observations is not None and seen is not None:
        np.add.at(found, seen, np.swapaxes(columns.observations, 1, 2) @ left.observations)
    return found


def _information_by_epoch(
    motion: SmoothedMotion, columns: Columns, chosen: Float[np.ndarray, " c"]
) -> Float[np.ndarray, "n n"]:
    """F among the errors of the chosen epochs."""
    q, K = columns.count, len(motion.time)
    F = np.empty((len(chosen) * q, len(chosen) * q))
    each = max(TOGETHER // q, 1)
    for first in range(0, len(chosen), each):
        part = chosen[first : first + each]
        sizes = np.zeros((K, q, len(part) * q))
        for number, epoch in enumerate(part):
            sizes[epoch, :, number * q : (number + 1) * q] = np.eye(q)
        after = motion.rows.residual(_drawn(motion, columns, sizes))
        F[:, first * q : first * q + len(part) * q] = _score_by_epoch(motion, columns, after)[
            chosen
        ].reshape(len(chosen) * q, -1)
    return (F + F.T) / 2
