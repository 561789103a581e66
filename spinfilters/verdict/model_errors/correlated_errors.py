"""Errors of measurements that are correlated in time, and the covariance of smoothed states that holds with them.

Estimates x = P J'z were made for white z. Had the whitened measurements the covariance C, that of x would be A = P J'C J P. With
P = F F', the eigenvalues of F^-1 A F^-T show by what factors the variances of the state's directions are wrong.

Three explanations of one linearised motion are compared by their marginal likelihood, levels at their most likely values:

    white         white errors and disturbances,
    correlated    these, and errors that last for a time tau (`LikelyLevels`),
    undisturbed   errors white and lasting, and no disturbances.

A disturbance lets rates wander for ever, an error that lasts comes back: a recording of many tau separates them. A shorter one
need not, so that what matters is the probability of lasting errors times what they do. With prior odds, and ln(epochs) for each
number that an explanation has more (Schwarz 1978), p is the probability of lasting errors; estimates that were made for white ones
have then the covariance P J' C J P in place of P, C that of the whitened measurements.

Of landmarks, the correlation of residuals from one observation to the next is tested. Where errors are white it is minus
what states and landmark take of both, a few per cent. Errors that last, of drifting features, leave it near their own
correlation rho, and weigh on slow states like white ones of (1 + rho) / (1 - rho) times the variance.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import ndtri

from spinfilters.core.errors import NUMERICAL_ERRORS, numerical
from spinfilters.filters.square_root import unique_roots
from spinfilters.inference.noise_model import NoiseModel
from spinfilters.smoother.linear_system import Marginals
from spinfilters.verdict.model_errors.linear_rows import LinearRows
from spinfilters.verdict.model_errors.noise_likelihood import (
    LEVEL_RANGE,
    MOST_EPOCHS,
    LikelihoodClimb,
    LikelyLevels,
    LinearMotion,
)

CLAIM = 4.0
"""Stated deviations that no error of an estimate called ok exceeds."""
MOST_WRONG: Final = 3e-4
"""Probability that errors which last, where they cannot be ruled out, take an estimate beyond what is claimed of it."""
UNKNOWN_LEVEL: Final = 2.0
"""Deviation of the logarithm of a level of which the data say nothing."""
EPOCHS_ASKED: Final = 8
"""Of which the change by levels is asked."""
NODES: Final = np.sqrt(3.0) * np.array([-1.0, 0.0, 1.0])
NODE_WEIGHTS: Final = np.array([1.0, 4.0, 1.0]) / 6
"""Gauss and Hermite's rule of three points, over what is not known of the levels, in deviations."""
STEP, SMALL = 0.1, 1e-9
"""Of a level, for that change; a deviation that is none."""


class Steepest(NamedTuple):
    """Step of one deviation in the levels along which ln A rises most, and its rise."""

    direction: Float[np.ndarray, " f"]
    rise: float


@dataclass(frozen=True)
class ExplainedErrors:
    """Errors of smoothed states by the measurements' own.

    Attributes
    ----------
    rows : LinearRows
        Of a solved problem without landmarks.
    model : NoiseModel
        Components of its measurement noise.
    """

    rows: LinearRows
    model: NoiseModel

    @cached_property
    def factors(self) -> Float[np.ndarray, "k n n"]:
        """F of the first epochs, lower triangular without negative diagonals."""
        epochs = min(self.rows.problem.ordering.epochs, MOST_EPOCHS)
        return unique_roots(Marginals(self.rows.solution, self.rows.normal.eliminated).first_factors(epochs))

    def covariance(
        self, levels: Float[np.ndarray, " c"], epochs: slice = slice(None)
    ) -> Float[np.ndarray, "k n n"]:
        """A of some of the first epochs at levels of `LikelyLevels`; the disturbances' part falls with their densities."""
        count, factors = len(self.model.components), self.factors[epochs]
        stated = factors @ np.swapaxes(factors, 1, 2)
        measured, lasting = np.zeros_like(stated), np.zeros_like(stated)
        # Unit errors of a component's r rows move states by M (n, r): M M' is their share of the stated covariance, M (w + S) M'
        # that of white errors with the variance w and of lasting ones, S_ij = s exp(-|t_i - t_j| / tau).
        for number, away, every in self._errors_by_row:
            slow, moved = np.exp(levels[count + number] - away / np.exp(levels[-1])), every[epochs]
            across = np.swapaxes(moved, 1, 2)
            measured += moved @ across
            lasting += moved @ (np.exp(levels[number]) * across + slow @ across)
        densities = np.exp(levels[2 * count : -1])
        left = float(np.clip(densities.mean(), 0.0, 1.0)) if len(densities) else 1.0
        return lasting + left * (stated - measured)

    def relative(
        self, levels: Float[np.ndarray, " c"], epochs: slice = slice(None)
    ) -> Float[np.ndarray, "k n n"]:
        """F^-1 A F^-T."""
        factors = self.factors[epochs]
        half = np.linalg.solve(factors, self.covariance(levels, epochs))
        return np.linalg.solve(factors, np.swapaxes(half, 1, 2))

    def inflation(self, levels: Float[np.ndarray, " c"]) -> float:
        """Largest over components of the mean over epochs of their variance, over that stated."""
        stated = (self.factors**2).sum(axis=2)
        ratio = np.diagonal(self.covariance(levels), axis1=1, axis2=2) / np.where(stated > 0, stated, np.inf)
        return float(ratio.mean(axis=0).max())

    def widening(
        self, likely: LikelyLevels, information: Float[np.ndarray, "f f"], probability: float
    ) -> Float[np.ndarray, "k n n"]:
        """B of covariance factors F B that hold for an explanation too.

        Errors are of covariance A with the explanation's probability p. In the space of a normal error and of the levels, an error
        beyond the claim has at a distance beta from the most probable values the probability p Phi(-beta) a side (first-order
        reliability method). With beta such that this is `MOST_WRONG` / 2, and v the deviation of ln A by the levels, the worst
        point has these u deviations along its gradient, and the error sqrt(beta^2 - u^2) of its own:
        u / (beta^2 - u^2) = v / 2. F B B' F' is the larger of F F' and of that A in every direction.

        Parameters
        ----------
        information : (f, f) float array
            Of the levels that are free.
        """
        beta = -float(ndtri(min(MOST_WRONG / (2 * probability), 0.5)))
        direction, deviation = self.steepest(likely, information)
        u = (np.sqrt(1 + (beta * deviation) ** 2) - 1) / max(deviation, SMALL)
        values, vectors = np.linalg.eigh(self.relative(likely.moved(u * direction).levels))
        larger = (beta**2 - u**2) / CLAIM**2 * values
        return vectors * np.sqrt(np.maximum(larger, 1.0))[:, np.newaxis]

    def steepest(self, likely: LikelyLevels, information: Float[np.ndarray, "f f"]) -> "Steepest":
        """Step in the levels along which ln A rises most.

        Parameters
        ----------
        information : (f, f) float array
            Of the levels that are free.
        """
        steps = STEP * np.eye(len(likely.free))
        here = self._log_size(likely)
        slope = np.array([(self._log_size(likely.moved(step)) - here) / STEP for step in steps])
        spread = np.linalg.solve(information + np.eye(len(slope)) / UNKNOWN_LEVEL**2, slope)
        deviation = float(np.sqrt(slope @ spread))
        return Steepest(spread / max(deviation, SMALL), deviation)

    def last_roots(
        self, likely: LikelyLevels, information: Float[np.ndarray, "f f"]
    ) -> Float[np.ndarray, "3 n n"]:
        """R with R R' = F^-1 A F^-T after the last of the first epochs, at `NODES` along the steepest step of the levels."""
        step, last = self.steepest(likely, information).direction, slice(-1, None)
        found = [self.relative(likely.moved(node * step).levels, last)[0] for node in NODES]
        values, vectors = np.linalg.eigh(np.array(found))
        return vectors * np.sqrt(np.maximum(values, 0.0))[:, np.newaxis]

    def _log_size(self, likely: LikelyLevels) -> float:
        """ln of the trace of A in the stated factors, over some epochs."""
        some = slice(None, None, -(-len(self.factors) // EPOCHS_ASKED))
        return float(np.log(np.trace(self.relative(likely.levels, some), axis1=1, axis2=2).sum()))

    @cached_property
    def _errors_by_row(self) -> list[tuple[int, Float[np.ndarray, "r r"], Float[np.ndarray, "k n r"]]]:
        """Component, time apart (s), and errors of states, by every row of measurements."""
        return list(self._walk_rows())

    def _walk_rows(self) -> Iterator[tuple[int, Float[np.ndarray, "r r"], Float[np.ndarray, "k n r"]]]:
        rows, sensors = self.rows, self.rows.problem.motion.sensors
        stamps = np.concatenate([[0.0], np.cumsum(rows.problem.motion.dt)])
        for number, each in enumerate(self.model.components):
            for k, own in each.sensors.items():
                early = np.flatnonzero(sensors[k].epoch < MOST_EPOCHS)
                time = stamps[sensors[k].epoch[early]]
                away = np.abs(np.subtract.outer(time, time))
                at = early[np.abs(rows.sensor_rows[k][early]).max(axis=(1, 2)) > 0]
                for row in own:
                    right = rows.nothing(len(early))
                    right.sensors[k][at, row, at] = 1.0
                    yield number, away, rows.sensitivity(right).states[: len(self.factors)]


PRIOR_ODDS: Final = 0.05
"""Of errors that last, before anything is measured."""
FIRST_TIMES: Final = (3.0, 15.0)
"""Correlation times, in intervals, from which the likelihood is climbed."""
LEAST_SCORE: Final = 2.0
"""Standard deviations of a score below which errors that last are not fitted, but where they may be all that disturbances seem."""
LEAST_DISTURBED: Final = 0.01
"""Share of disturbances in a measurement's variance, below which lasting errors in their place move estimates by little."""
NOTHING: Final = -40.0
"""ln of a variance that is none."""


@dataclass(frozen=True)
class CorrelatedErrors:
    """Errors that last, as likely as they are together with disturbances.

    Attributes
    ----------
    white, lasting : dict[str, float]
        Standard deviations by noise option, in its unit.
    time : float
        Of correlation, s.
    densities : dict[str, float]
        Identified together with them.
    probability : float
        Of them.
    advantage : float
        Fall of -2 ln likelihood.
    inflation : float
        Of the variance of the state component that they touch most, mean over epochs, were they there.
    widening : (k, n, n) float array
        What covariance factors F of the first epochs' states are multiplied by to hold with these errors too.
    last_roots : (3, n, n) float array
        What covariance factors F after the last of these epochs are multiplied by to be those of errors with these, at
        `NODES` of what is not known of their levels.
    """

    white: dict[str, float]
    lasting: dict[str, float]
    densities: dict[str, float]
    time: float
    probability: float
    advantage: float
    inflation: float
    widening: Float[np.ndarray, "k n n"]
    last_roots: Float[np.ndarray, "3 n n"]

    @property
    def expected_nees(self) -> float:
        """Of that component, per degree of freedom."""
        return 1 + self.probability * (self.inflation - 1)


class ExplainedLevels(NamedTuple):
    """Likeliest levels with correlated errors and with white ones, and what separates them."""

    levels: LikelyLevels
    white: LikelyLevels
    information: Float[np.ndarray, "f f"]
    probability: float


def correlated_errors(
    rows: LinearRows, model: NoiseModel, stated: Collection[str] = ()
) -> list[CorrelatedErrors]:
    """Errors that last in a solved problem without landmarks, the likeliest first.

    None where there are none to speak of, or the problem does not determine them.

    Parameters
    ----------
    stated : Collection[str]
        Names of levels that are known. Of these densities are taken as they are.
    """
    sensors = rows.problem.motion.sensors
    if rows.problem.observations is not None or any(len(np.unique(s.epoch)) < len(s.epoch) for s in sensors):
        return []
    if not any(each.sensors for each in model.components):
        return []
    try:
        with np.errstate(all="ignore"):
            return _compare_models(rows, model, stated)
    except NUMERICAL_ERRORS as error:
        numerical(error)
        return []


def _compare_models(rows: LinearRows, model: NoiseModel, stated: Collection[str]) -> list[CorrelatedErrors]:
    motion = LinearMotion.of(rows, model)
    unknown = np.array([name not in stated for name in model.densities], dtype=bool)
    climb = LikelihoodClimb(motion)
    (white,) = climb.highest([_white(motion, unknown)])
    disturbed = motion.disturbed(white.levels)
    undisturbed = not rows.problem.layout.translates and bool(unknown.all()) and disturbed > LEAST_DISTURBED
    if not undisturbed and climb.scores(white).max(initial=0.0) < LEAST_SCORE:
        return []
    every = climb.highest(
        [*_correlated(motion, white), *(_undisturbed(motion, white) if undisturbed else ())]
    )
    errors = ExplainedErrors(rows, model)
    likely = [(each, _probability(_evidence(motion, white, each))) for each in _choose_likeliest(every)]
    found = [
        _describe_levels(errors, ExplainedLevels(each, white, climb.information(each), p))
        for each, p in likely
        if p > MOST_WRONG
    ]
    return sorted(found, key=lambda each: -each.probability)


def _choose_likeliest(every: list[LikelyLevels]) -> list[LikelyLevels]:
    """Of all that were climbed to with the same levels free the likeliest."""
    kinds = {len(each.free): each for each in sorted(every, key=lambda each: each.log_likelihood)}
    return list(kinds.values())


def _probability(evidence: float) -> float:
    """Of an explanation by -2 ln of the other's evidence over its own."""
    return float(1 / (1 + np.exp(-0.5 * min(evidence, 500.0)) / PRIOR_ODDS))


def _evidence(motion: LinearMotion, white: LikelyLevels, other: LikelyLevels) -> float:
    """-2 ln of the white explanation's evidence over another's, one number more being free."""
    more = len(other.free) - len(white.free) - 1
    return 2 * (other.log_likelihood - white.log_likelihood) - more * float(np.log(len(motion.values)))


def _white(motion: LinearMotion, unknown: Bool[np.ndarray, " d"]) -> LikelyLevels:
    count = len(motion.slots)
    levels = np.zeros(motion.levels)
    levels[count : 2 * count] = NOTHING
    free = np.array([*range(count), *(2 * count + np.flatnonzero(unknown))])
    return LikelyLevels(levels, free, -np.inf)


def _correlated(motion: LinearMotion, white: LikelyLevels) -> list[LikelyLevels]:
    """Half of the white error, and disturbances that are a few times smaller."""
    count, found = len(motion.slots), []
    for time in FIRST_TIMES:
        levels = white.levels.copy()
        levels[count : 2 * count] = -0.7
        levels[:count] = np.maximum(levels[:count], -6.0) - 0.7
        levels[white.free[count:]] -= 1.5
        levels[-1] = np.log(time * np.median(motion.interval))
        free = np.array([*range(2 * count), *white.free[count:], motion.levels - 1])
        found.append(LikelyLevels(levels, free, -np.inf))
    return found


def _undisturbed(motion: LinearMotion, white: LikelyLevels) -> list[LikelyLevels]:
    count, free = len(motion.slots), np.array([*range(2 * len(motion.slots)), motion.levels - 1])
    found = []
    for each in _correlated(motion, white):
        levels = each.levels.copy()
        levels[count : 2 * count] = 2.0
        levels[2 * count : -1] = LEVEL_RANGE[0]
        found.append(LikelyLevels(levels, free, -np.inf))
    return found


def _describe_levels(errors: ExplainedErrors, explained: ExplainedLevels) -> CorrelatedErrors:
    best, model = explained.levels, errors.model
    count, names = len(model.components), [c.name for c in model.components]
    half = np.exp(best.levels / 2)
    values = np.array([component.value for component in model.components])
    densities = model.values(np.concatenate([np.zeros(count), best.levels[2 * count : -1]]))[count:]
    return CorrelatedErrors(
        dict(zip(names, (values * half[:count]).tolist(), strict=True)),
        dict(zip(names, (values * half[count : 2 * count]).tolist(), strict=True)),
        dict(zip(model.densities, densities, strict=True)),
        float(np.exp(best.levels[-1])),
        explained.probability,
        2 * (best.log_likelihood - explained.white.log_likelihood),
        errors.inflation(best.levels),
        errors.widening(best, explained.information, explained.probability),
        errors.last_roots(best, explained.information),
    )


POINT: Final = 3
"""Parameters that are a landmark's place, first among them."""


@dataclass(frozen=True)
class ObservationCorrelation:
    """From observation to observation.

    Attributes
    ----------
    value : float
        Correlation.
    score : float
        Its standard deviations above zero.
    """

    value: float
    score: float

    @property
    def inflation(self) -> float:
        """Of the variance of slow states."""
        value = min(max(self.value, 0.0), 0.99)
        return (1 + value) / (1 - value)


def observation_correlation(rows: LinearRows) -> ObservationCorrelation | None:
    """Of all landmarks together, unknown ones or of a known map.

    None where there are none, or each is seen once.
    """
    left, products, squares, count = rows.left, 0.0, np.zeros(2), 0
    found: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    fit = rows.normal.eliminated
    if fit is not None and left.observations is not None:
        observations, used = fit.observations, fit.used
        found.append((observations.landmark[used], observations.epoch[used], left.observations[used, :, 0]))
    for sensor, rest in zip(rows.problem.motion.sensors, left.sensors, strict=True):
        if len(np.unique(sensor.epoch)) < len(sensor.epoch) and sensor.parameters.shape[1] >= POINT:
            landmark = _numbers_of_points(sensor.parameters[:, :POINT])
            counted = np.any([own != 0 for own in rest[:, :, 0].T], axis=0)
            found.append((landmark[counted], sensor.epoch[counted], rest[counted, :, 0]))
    for landmark, epoch, rest in found:
        before, after = _neighbours(landmark, epoch)
        one, other = rest[before], rest[after]
        products += float(np.vdot(one, other))
        squares += [np.vdot(one, one), np.vdot(other, other)]
        count += one.size
    if not (count and np.all(squares > 0)):
        return None
    value = products / float(np.sqrt(squares[0] * squares[1]))
    return ObservationCorrelation(value, value * float(np.sqrt(count)))


def _numbers_of_points(points: Float[np.ndarray, "r 3"]) -> Int[np.ndarray, " r"]:
    """The number of each row's point among all that differ, in ascending order."""
    # points that share their first coordinate are rare: to sort one column takes a fifth of the time
    _, first, number = np.unique(points[:, 0], return_index=True, return_inverse=True)
    if (points[first][number] == points).all():
        return number
    return np.unique(points, axis=0, return_inverse=True)[1].ravel()


def _neighbours(
    landmark: Int[np.ndarray, " n"], epoch: Int[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]]:
    """Pairs of observations of one landmark in neighbouring epochs."""
    order = np.lexsort((epoch, landmark))
    one, other = order[:-1], order[1:]
    near = (landmark[one] == landmark[other]) & (epoch[other] == epoch[one] + 1)
    return one[near], other[near]
