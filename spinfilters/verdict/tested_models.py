"""Score tests of a recording, and what a verdict says of them: findings, and wider covariances for correlated errors."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.filters.history import EstimateHistory
from spinfilters.inference.identified_noise import Unstated, noise_model
from spinfilters.inference.setup import Setup
from spinfilters.io.sensor_format import sensor_format
from spinfilters.models.state_mixture import ErrorMixture
from spinfilters.models.status import ALL, Finding
from spinfilters.verdict.checks import finding
from spinfilters.verdict.judge import unmoved_quantities
from spinfilters.verdict.model_errors.alternatives import CONTACT_AT_BEGIN, Alternative
from spinfilters.verdict.model_errors.correlated_errors import (
    NODE_WEIGHTS,
    CorrelatedErrors,
    correlated_errors,
    observation_correlation,
)
from spinfilters.verdict.model_errors.linear_rows import LinearRows
from spinfilters.verdict.model_errors.score_tests import TELLING, Effect, ScoreTest
from spinfilters.verdict.recording_tests import Slip, WrongUnit

LIKELY: Final = 0.8
"""Probability of errors that are a doubt; less likely ones are covered by deviations."""
LARGEST_NEES: Final = 2.0
"""Expected per degree of freedom, beyond which errors that are likely are a doubt."""
LARGEST_SCORE: Final = 5.0
"""Standard deviations beyond which landmarks' residuals are correlated by no chance."""


@dataclass(frozen=True)
class PossibleCorrelation:
    """Errors of a recording's measurements that are correlated, or may be.

    Attributes
    ----------
    doubts : tuple[Finding, ...]
        Findings of those that are likely.
    widening : (k, e, e) float array or None
        B of the first epochs, by which F B is a covariance factor that holds with them; None where F is one.
    undecided : Finding or None
        A finding of errors that only may be correlated.
    score_inflation : float
        By which errors of landmarks' observations that last enlarge scores, beyond what is stated of them; 1 where they are
        white.
    explanations : tuple[CorrelatedErrors, ...]
        By errors that last, the one that deviations are widened for first.
    """

    doubts: tuple[Finding, ...] = ()
    widening: Float[np.ndarray, "k e e"] | None = None
    undecided: Finding | None = None
    score_inflation: float = 1.0
    explanations: tuple[CorrelatedErrors, ...] = ()

    @cached_property
    def mixture(self) -> ErrorMixture | None:
        """Errors after the last tested epoch, white or as in each explanation at its odds, in units of the stated factor F.

        Factors R are those of F^-1 A F^-T, the identity first; None where errors are surely white.
        """
        if not self.explanations:
            return None
        size = self.explanations[0].last_roots.shape[-1]
        sure = [min(each.probability, MOST_SURE) for each in self.explanations]
        odds = [probability / (1 - probability) for probability in sure]
        weights = np.concatenate([[1.0], *(each * NODE_WEIGHTS for each in odds)])
        roots = [np.eye(size)[np.newaxis], *(each.last_roots for each in self.explanations)]
        return ErrorMixture(weights / weights.sum(), np.concatenate(roots))


NO_CORRELATION: Final = PossibleCorrelation()
MOST_SURE: Final = 1 - 1e-12
"""Probability of an explanation beyond which its odds are the same; rounding makes some 1."""


def possible_correlation(
    setup: Setup, rows: LinearRows | None, stated: Collection[str]
) -> PossibleCorrelation:
    """Errors that the estimates take for white ones in addition to disturbances.

    None of a gyro whose error is known to be correlated.

    Parameters
    ----------
    rows : LinearRows or None
        Of a smoothed motion; None where there are none.
    stated : Collection[str]
        Names of levels that are not identified.
    """
    if rows is None or setup.gyro_noise is not None:
        return NO_CORRELATION
    levels = Unstated.of_all(setup.log, setup.process.noise)
    model = noise_model(rows.problem, setup.noise, levels)
    seen = observation_correlation(rows)
    if seen is not None and seen.score > LARGEST_SCORE:
        left = seen.inflation / _stated_inflation(setup)
        if left > LARGEST_NEES:
            numbers = {"correlation": seen.value, "score": seen.score, "inflation": left}
            return PossibleCorrelation((finding("correlated-observations", numbers),), score_inflation=left)
        if seen.inflation > LARGEST_NEES:
            return NO_CORRELATION
    found = [] if model is None else correlated_errors(rows, model, stated)
    if not found:
        return NO_CORRELATION
    likely = [each for each in found if each.probability > LIKELY and each.expected_nees > LARGEST_NEES]
    doubts = tuple(
        finding(
            "correlated-errors",
            {
                "time": each.time,
                "sizes": _sizes(each),
                "advantage": each.advantage,
                "inflation": each.inflation,
            },
        )
        for each in likely[:1]
    )
    widest, *others = sorted(found, key=lambda each: -float(np.square(each.widening).sum()))
    undecided = finding("correlation-undecided", {"time": widest.time, "sizes": _sizes(widest)})
    return PossibleCorrelation(doubts, widest.widening, undecided, explanations=(widest, *others))


def _stated_inflation(setup: Setup) -> float:
    """Factor by which the variances of landmarks' observations are stated to be larger for errors that they have in common."""
    formats = [sensor_format(stream.sensor) for stream in setup.log.streams]
    names = {option.name for form in formats if form.has_landmarks for option in form.noise}
    return max((by for name, by in setup.inflation.items() if name in names), default=1.0)


def _sizes(found: CorrelatedErrors) -> str:
    return ", ".join(f"{name} {value:.2g}" for name, value in found.lasting.items())


FALSE_ALARM: Final = 1e-2
"""Probability that a model error is named where all models are right: of all tests together (Bonferroni)."""
LEAST_EFFECT, LEAST_EFFECT_BESIDE_SLOW_NOISE = Effect(2.0, 1.0), Effect(4.0, 2.0)
"""Deviations by which removing an error moves a state, at one epoch or over all. One that moves all by less, and does not
contradict the stated noise, is left to the uncertainty: with the errors that noise makes it stays below four. Slow errors of a
gyro, and such as tracks of images have in common, look like small ones of many models, unless these are beyond what they feign."""
HARMFUL: Final = 4.0
"""Deviations, as a verdict states them, by which removing an error moves a state at one epoch, from which it alone makes estimates
wrong."""
SINGLE_FALSE_ALARM: Final = 2e-3
"""Probability that one is named where there is none: silence costs more than doubt. Not with a correlated gyro's slow errors, nor
of jumps, which are far beyond chance where they matter."""
LEAST_LEVEL: Final = 0.2
"""Fall of ln variance of an identified noise level by removing an error, from which that is not left to the uncertainty: the levels
share the residuals, so that one with an error in it leaves others, and with them the deviations, too small."""
NAMED: Final = 2
"""Errors that a verdict names at most, each with those that look alike."""
ALIKE: Final = 0.95
"""Correlation of what two errors explain of the residuals, from which the data do not show which of them it is."""
SLOW: Final = ALIKE**2
"""Share of what an error explains that slow changes explain as well, from which a spin about one axis does not show which it is."""
SLOW_CHANGE: Final = "slow-change"
"""Name of such errors."""
MAP_ERROR: Final = "map-error"
"""Name of errors that a map of the body explains which poses were registered to."""
COMPARABLE, LEAST_SURPRISE = 0.4, 0.05
"""Share of what the likeliest error explains, and p-value, from which an error of an inspector's poses is possible too."""
MOST_ALIKE: Final = 3
"""Errors named as one."""


@dataclass(frozen=True)
class LaterBegin:
    """A time from which measurements are one motion, where those from the begin on are not.

    Attributes
    ----------
    time : float
        s.
    fit, later_fit : float
        Rms of the whitened residuals of the initialisation from the begin on, and from this time on.
    """

    time: float
    fit: float
    later_fit: float


@dataclass(frozen=True)
class TestedModels:
    """Score tests of a recording.

    Attributes
    ----------
    tests : tuple[ScoreTest, ...]
        The most explaining first.
    contradicted : bool
        Whether residuals contradict the noise levels stated of the recording.
    trouble : str
        Why there are no tests of a motion that was estimated; empty where there are.
    units : tuple[WrongUnit, ...]
        That are probably others.
    std : (k, n) float array or None
        Stated deviations of the states that were tested, or None where they are unknown.
    correlated : PossibleCorrelation
        Errors of the measurements that are, or may be, correlated in time.
    solved : LinearRows or None
        What was tested, while it is.
    score_inflation : float or None
        By which errors may enlarge a score that are known to be correlated and for which a noise level stands; infinite
        where it is not known, None where there are none.
    slips : tuple[Slip, ...]
        Of front ends, with which residuals show no other cause.
    has_inspector : bool
        Whether poses of a moving camera are given, of which some cures speak.
    clock_drift : (K, n) float array or None
        Error of all epochs' states by one deviation of a drift of the clock, where that is to be counted.
    stated_std : (k, n) float array or None
        Deviations that the verdict states: ``std`` with what errors of the calibration and that drift may add; None of ``std``.
    known_calibration : frozenset[str]
        Names of the calibration's deviations that are stated.
    possible_contacts : tuple[(k, n) float array, ...]
        Error of the tested epochs' states by a contact at an end whose measurements were refused, where it may be one.
    later_begin : LaterBegin or None
        Where the first epochs belong to no motion, from when on they do.
    """

    tests: tuple[ScoreTest, ...] = ()
    contradicted: bool = False
    trouble: str = ""
    units: tuple[WrongUnit, ...] = ()
    std: Float[np.ndarray, "k n"] | None = None
    correlated: PossibleCorrelation = NO_CORRELATION
    solved: LinearRows | None = None
    score_inflation: float | None = None
    slips: tuple[Slip, ...] = ()
    has_inspector: bool = False
    clock_drift: Float[np.ndarray, "K n"] | None = None
    stated_std: Float[np.ndarray, "k n"] | None = None
    known_calibration: frozenset[str] = frozenset()
    possible_contacts: tuple[Float[np.ndarray, "k n"], ...] = ()
    later_begin: LaterBegin | None = None

    def test_of(self, error: Alternative) -> ScoreTest | None:
        """The test of an error; None where it was not tested."""
        return next((each for each in self.tests if each.error.name == error.name), None)

    def with_test(self, test: ScoreTest) -> "TestedModels":
        """These with another test of one error, the most explaining first."""
        others = [each for each in self.tests if each.error.name != test.error.name]
        return replace(self, tests=tuple(sorted((*others, test), key=lambda each: -each.merit)))

    @cached_property
    def classes(self) -> tuple[tuple[ScoreTest, ...], ...]:
        """Classes of alike model errors that a verdict names.

        The likeliest beyond chance that matter to the estimates, with those that look alike.
        None with a slip of a front end, which looks like a touch, a jump and more.
        """
        if self.slips:
            return ()
        possible = [each for each in self.beyond_chance if each.is_possible]
        left = [each for each in possible if not (self._is_slow(each) or self._is_of_map(each))]
        likely: list[tuple[ScoreTest, ...]] = []
        while left and len(likely) < NAMED:
            first, *others = left
            alike = [each for each in others if first.likeness(each) > ALIKE]
            likely.append((first, *alike[: MOST_ALIKE - 1]))
            left = [each for each in others if each not in alike]
        # what moves no estimate is no doubt by itself; with one it may be what the other error was taken for
        return tuple(likely) if any(self._counts(each) for own in likely for each in own) else ()

    @cached_property
    def slow(self) -> ScoreTest | None:
        """The likeliest of errors that a spin about one axis does not distinguish, if any; none with a slip."""
        if self.slips:
            return None
        return next((each for each in self.beyond_chance if each.slow > SLOW and self._counts(each)), None)

    @cached_property
    def of_map(self) -> ScoreTest | None:
        """The likeliest error that errors of a map explain as well, if any; none with a slip or a cause."""
        if self.slips or self.classes:
            return None
        return next(
            (each for each in self.beyond_chance if self._is_of_map(each) and self._counts(each)), None
        )

    @property
    def is_suspect(self) -> bool:
        """Whether any error is improbable enough, or the noise contradicted, to look closer."""
        return self.contradicted or bool(self.trouble) or any(each.is_telling for each in self.tests)

    @cached_property
    def beyond_chance(self) -> tuple[ScoreTest, ...]:
        """Tests too improbable without the error."""
        return tuple(each for each in self.tests if self._is_beyond_chance(each))

    @property
    def unexplained(self) -> list[str]:
        """Doubt where only an impossible error would explain the residuals."""
        found = [each for each in self.beyond_chance if not each.is_possible and self._counts(each)]
        if not found or self.classes or self.slips or self.slow is not None or self.of_map is not None:
            return []
        return [
            f"the residuals are beyond chance (chi-square {found[0].statistic:.0f}), and no tested error explains "
            "them: look for jumps (a touch, a joint at its stop, wrong measurements)"
        ]

    def _is_slow(self, test: ScoreTest) -> bool:
        """Whether slow changes explain as much, or what they leave is within chance."""
        is_within_chance = self.slow is not None and test.p_value_beside_slow >= self.largest_p_value
        return test.slow > SLOW or is_within_chance

    def _is_of_map(self, test: ScoreTest) -> bool:
        """Whether what errors of a map leave is within chance."""
        return test.p_value_beside_map >= self.largest_p_value

    def _counts(self, test: ScoreTest) -> bool:
        return self.contradicted or self._moves_estimates(test)

    @property
    def largest_p_value(self) -> float:
        """Largest p-value at which a test is beyond chance."""
        return FALSE_ALARM / max(len(self.tests), 1)

    def _is_beyond_chance(self, test: ScoreTest) -> bool:
        """Whether as much is too improbable without the error.

        Residuals beyond the stated noise are certain: they leave the question which error is drawn anew at every epoch, that of the
        measurements or one of the few others that are.
        """
        most = max(self.largest_p_value, SINGLE_FALSE_ALARM if self._is_named_sooner(test) else 0.0)
        if self.contradicted and test.error.by_epoch:
            most = max(most, FALSE_ALARM / sum(each.error.by_epoch for each in self.tests))
        return test.p_value < most and self._is_beyond_lasting_errors(test, most)

    def _is_named_sooner(self, test: ScoreTest) -> bool:
        """Whether silence about an error costs more than doubt: it alone would make estimates wrong, and nothing says it is small.

        One that the stated deviations cover makes none wrong; of one whose size was measured and stated a test is one of many.
        """
        std, error = (self.std if self.stated_std is None else self.stated_std), test.error
        if std is None or error.deviation in self.known_calibration or error.trials > 1:
            return False
        return test.effect(std).largest >= HARMFUL and not self.beside_slow_noise

    def _is_beyond_lasting_errors(self, test: ScoreTest, most: float) -> bool:
        """Whether a score is too large for errors of landmarks' observations that last.

        They weigh on slow states like white ones of a larger variance, and feign small errors of many models, above all such as
        all rows have in common: a turned right camera.
        """
        inflation = self.correlated.score_inflation
        return inflation <= 1 or test.p_value_of_inflated(inflation) < most

    @property
    def named(self) -> tuple[ScoreTest, ...]:
        """Score tests in the verdict, the likeliest first."""
        return tuple(each for own in self.classes for each in own)

    def _moves_estimates(self, test: ScoreTest) -> bool:
        """Whether an error moves estimates, or noise levels, and is beyond chance.

        At the tested noise levels, too, less surely where these share the residuals: what only lets levels fall may be slow noise.
        """
        if self.std is None:
            return True
        effect = test.effect(self.std)
        least = LEAST_EFFECT_BESIDE_SLOW_NOISE if self._may_be_slow_noise(test) else LEAST_EFFECT
        moves = effect.largest >= least.largest or effect.rms >= least.rms
        chance = self.largest_p_value if self.beside_slow_noise else TELLING
        return (moves or test.level >= LEAST_LEVEL) and test.score_p_value < chance

    @property
    def beside_slow_noise(self) -> bool:
        """Whether a noise level represents an error that is known to be correlated."""
        return self.score_inflation is not None

    def _may_be_slow_noise(self, test: ScoreTest) -> bool:
        """Whether a score is not improbable of errors that last longer than they seem."""
        most = self.score_inflation
        return most is not None and test.p_value_of_inflated(most) >= SINGLE_FALSE_ALARM

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the model errors in the verdict, the likeliest first; alike ones are joined ("drag/torque")."""
        found = ("/".join(each.error.name for each in own) for own in self.classes)
        slow = () if self.slow is None else (SLOW_CHANGE,)
        slips = {each.name: None for each in self.slips}
        of_map = () if self.of_map is None else (MAP_ERROR,)
        begin = () if self.later_begin is None else (CONTACT_AT_BEGIN.name,)
        return (*(each.name for each in self.units), *slips, *begin, *slow, *of_map, *found)

    @property
    def comparable(self) -> list[ScoreTest]:
        """Errors of an inspector's poses that explain a comparable share, but are not named.

        What is considered of such errors is expected of a recording, so that less than what is beyond chance counts.
        """
        named = self.named
        return [
            each
            for each in self.tests
            if each.error.is_of_poses
            and each not in named
            and each.p_value < LEAST_SURPRISE
            and self.share(each) >= COMPARABLE
        ]

    def share(self, test: ScoreTest) -> float:
        """Share that an error explains of what the likeliest explains; 1 where nothing is explained.

        Both are falls of -2 ln likelihood, corrected for the number of free parameters (`ScoreTest.merit`).
        """
        best = max((each.merit for own in self.classes for each in own), default=0.0)
        return float(np.clip(test.merit / best, 0.0, 1.0)) if best > 0 else 1.0

    @property
    def causes(self) -> str:
        """The likeliest cause with its cure, and in a second sentence what else is possible, by the share that it explains.

        Only where there are `classes`.
        A score is evidence for a cause, not proof of it: an error that is not on the list may look like one that is.
        """
        first, *others = self.named
        cure = first.error.cure_before(self.has_inspector)
        sentence = f"the residuals are most like {_sized(first)}: {cure}"
        possible = [
            f"{each.error.phrase} (explains {self.share(each):.0%} as much)"
            for each in (*others, *self.comparable)
        ]
        return f"{sentence}. Also possible: {', '.join(possible)}" if possible else sentence


NOT_TESTED: Final = TestedModels()


def slow_phrase(test: ScoreTest) -> str:
    """Slow changes of a spin about one axis, of which the likeliest explanation is given."""
    return (
        f"the rates change slowly by more than the noise explains (chi-square {test.statistic:.0f}): a spin about one axis cannot "
        "distinguish a torque (air, contact), a drifting gyro bias and parts that move inside"
    )


def map_phrase(test: ScoreTest) -> str:
    """Errors of a map that poses were registered to; what these explain is evidence for no other cause, so that none is named."""
    return (
        f"the residuals are beyond chance (chi-square {test.statistic:.0f}): errors of the map that poses were registered to, "
        f"alike in alike views, explain {test.map_share:.0%} of it and leave no more than chance"
    )


def _sized(test: ScoreTest) -> str:
    """An error with its size and its statistic."""
    size = f"{test.magnitude:.2g} +- {test.magnitude_std:.1g} {test.error.unit}"
    return f"{test.error.phrase} ({size}, chi-square {test.statistic:.0f})"


def model_findings(models: TestedModels, tested: EstimateHistory | None) -> list[Finding]:
    """Findings of the tests of a recording's models.

    Parameters
    ----------
    tested : EstimateHistory or None
        Estimate about which the models were tested.
    """
    about = _find_moved_quantities(models, tested)
    found = [finding("front-end-slip", {"text": each.sentence, "cure": each.cure}) for each in models.slips]
    if models.later_begin is not None:
        found.append(finding("first-epochs", models.later_begin.__dict__))
    found += models.correlated.doubts
    found += [
        finding("wrong-unit", {"text": unit.sentence, "cure": unit.cure}, unit.about, unit.name)
        for unit in models.units
    ]
    if models.slow is not None:
        numbers = {"text": slow_phrase(models.slow), **_numbers(models.slow)}
        found.append(finding("slow-change", numbers, about))
    if models.of_map is not None:
        found.append(
            finding(MAP_ERROR, {"text": map_phrase(models.of_map), **_numbers(models.of_map)}, about)
        )
    found += [finding("unexplained-residuals", {"text": text}) for text in models.unexplained]
    if models.trouble:
        found.append(finding("models-not-tested", {"text": models.trouble}))
    if models.classes:
        names = "+".join("/".join(each.error.name for each in own) for own in models.classes)
        numbers = {"text": models.causes, **_numbers(models.classes[0][0])}
        found.append(finding("model-error", numbers, about, names))
    return found


def _numbers(test: ScoreTest) -> dict[str, float | str]:
    """Statistic and probability of a score test."""
    return {"chi_square": test.statistic, "p_value": test.p_value}


def _find_moved_quantities(models: TestedModels, tested: EstimateHistory | None) -> frozenset[str]:
    """Quantities that removing any of the errors moves which are beyond chance.

    All where that is not known, or where more than what the errors explain is wrong with the residuals.
    """
    if tested is None:
        return ALL
    # errors beyond chance, named or not, and those that look like the named ones; each once
    suspects = {id(each): each for each in (*models.named, *models.beyond_chance)}
    if not suspects:
        return ALL
    unmoved = ALL
    for each in suspects.values():
        unmoved &= unmoved_quantities(tested, each)
    return ALL - unmoved
