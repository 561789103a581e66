"""Errors of measurements that are correlated in time, beside disturbances of the motion.

Three explanations of one linearised motion are compared by their marginal likelihood, levels at their most likely values:

    white         white errors and disturbances,
    correlated    these, and errors that last for a time tau (`linear_likelihood`),
    undisturbed   errors white and lasting, and no disturbances.

A disturbance lets rates wander for ever, an error that lasts comes back: a recording of many tau tells them apart. A shorter one
need not, so that what matters is the probability of lasting errors times what they do. With prior odds, and ln(epochs) for each
number that an explanation has more (Schwarz 1978), p is the probability of lasting errors; estimates that were made for white ones
have then the covariance P J' C J P in place of P, C that of the whitened measurements.
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.errors import NUMERICAL_ERRORS, numerical
from spinfilters.estimators.identification.noise_model import NoiseModel
from spinfilters.estimators.model_errors.explained_errors import MOST_WRONG, ExplainedErrors
from spinfilters.estimators.model_errors.likely_levels import LEVEL_RANGE, LikelihoodClimb, LikelyLevels
from spinfilters.estimators.model_errors.linear_likelihood import LinearMotion
from spinfilters.estimators.model_errors.linear_rows import LinearRows

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
    """Errors that last, as likely as they are beside disturbances.

    Attributes
    ----------
    white, lasting: standard deviations by noise option, in its unit.   time: of correlation, s.   densities: beside them.
    probability: of them.   advantage: fall of -2 ln likelihood.
    inflation: of the variance of the state component that they touch most, mean over epochs, were they there.
    widening: what covariance factors F of the first epochs' states are multiplied by to hold with these errors too.
    """

    white: dict[str, float]
    lasting: dict[str, float]
    densities: dict[str, float]
    time: float
    probability: float
    advantage: float
    inflation: float
    widening: Float[np.ndarray, "k n n"]

    @property
    def expected_nees(self) -> float:
        """Of that component, per degree of freedom."""
        return 1 + self.probability * (self.inflation - 1)


class ExplainedLevels(NamedTuple):
    """Likeliest levels with correlated errors and with white ones, and what tells them apart."""

    levels: LikelyLevels
    white: LikelyLevels
    information: Float[np.ndarray, "f f"]
    probability: float


def correlated_errors(
    rows: LinearRows, model: NoiseModel, stated: Collection[str] = ()
) -> list[CorrelatedErrors]:
    """Errors that last in a solved problem without landmarks, the likeliest first.

    None where there are none to speak of, or the problem does not tell.

    Parameters
    ----------
    stated: names of levels that are known. Of these densities are taken as they are.
    """
    sensors = rows.problem.motion.sensors
    if rows.problem.observations is not None or any(len(np.unique(s.epoch)) < len(s.epoch) for s in sensors):
        return []
    if not any(each.sensors for each in model.components):
        return []
    try:
        with np.errstate(all="ignore"):
            return _compared(rows, model, stated)
    except NUMERICAL_ERRORS as error:
        numerical(error)
        return []


def _compared(rows: LinearRows, model: NoiseModel, stated: Collection[str]) -> list[CorrelatedErrors]:
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
    likely = [(each, _probability(_evidence(motion, white, each))) for each in _likeliest(every)]
    found = [
        _told(errors, ExplainedLevels(each, white, climb.information(each), p))
        for each, p in likely
        if p > MOST_WRONG
    ]
    return sorted(found, key=lambda each: -each.probability)


def _likeliest(every: list[LikelyLevels]) -> list[LikelyLevels]:
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


def _told(errors: ExplainedErrors, explained: ExplainedLevels) -> CorrelatedErrors:
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
    )
