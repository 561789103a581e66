"""All checks of the verdict: what a check is, the evidence it is given, tests of an estimate by its own numbers, and their list."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

import numpy as np
from scipy.special import pdtrc

from spinfilters.core.chi_square import chi_square_tail
from spinfilters.evaluation.estimator_evaluation import Evaluation, not_failed
from spinfilters.filters.history import EstimateHistory
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.models.status import ALL, BODY, MOMENTS, NOTHING, OWN_STATUS, Finding, Holds

MOST_DIGITS: Final = 17
"""With which two different numbers are printed differently."""


class Needs(StrEnum):
    """Evidence that a check is computed from."""

    RECORDING = "the recording"
    INITIALISATION = "the first epochs, smoothed"
    ESTIMATE = "the estimate"
    FILTER = "a filter's own epochs"
    SMOOTHER = "the smoother of the same measurements"
    PEERS = "other estimators"
    RESIDUALS = "the residuals of the smoothed motion"


@dataclass(frozen=True)
class Failure:
    """What a failed test found.

    Attributes
    ----------
    numbers : Mapping[str, float or str]
        For the templates of the check.
    about : frozenset[str] or None
        Quantities that do not hold; None leaves those of the check.
    """

    numbers: Mapping[str, float | str] = field(default_factory=dict)
    about: frozenset[str] | None = None


Test = Callable[["Evidence"], Iterable[Failure]]


@dataclass(frozen=True)
class Check:
    """One reason to doubt a result.

    Attributes
    ----------
    name : str
        As summary.json and the docs call it.
    about : frozenset[str]
        Quantities that do not hold where it fails, unless its finding names them.
    needs : Needs
        What it is computed from.
    asks : str
        The test in one sentence, with its limit.
    false_alarm : str
        Probability that it fails where nothing is wrong.
    sentence, cure : str
        Templates over the numbers of a finding.
    test : Test or None
        Outcomes of the evidence, none where all is well. None of a check that is made where its numbers arise, in readers,
        initialisation, estimators and the tests of models and noise; its findings come with the evidence.
    leaves : Holds
        What the quantities are then, doubtful or not determined.
    is_cause : bool
        Whether what it finds is certain and makes other checks fail: it is stated first, and their cures would hide it.
    """

    name: str
    about: frozenset[str]
    needs: Needs
    asks: str
    false_alarm: str
    sentence: str
    cure: str
    test: Test | None = None
    leaves: Holds = Holds.DOUBTFUL
    is_cause: bool = False

    @property
    def may_follow(self) -> bool:
        """Whether it may fail because of a cause alone: what estimates say, not what the recording itself shows."""
        speaks_of_estimate = bool(self.about) or self.leaves is Holds.NOT_DETERMINED
        return self.needs is not Needs.RECORDING and speaks_of_estimate

    def finding(
        self, numbers: Mapping[str, float | str], about: frozenset[str] | None = None, which: str = ""
    ) -> Finding:
        """Finding with these numbers.

        Parameters
        ----------
        numbers : Mapping[str, float or str]
            For the templates.
        about : frozenset[str] or None
            Quantities that do not hold; None leaves those of the check.
        which : str
            What was found, of a check that looks for several things.
        """
        name = f"{self.name}:{which}" if which else self.name
        return Finding(
            name, _fill_sentence(self.sentence, numbers), self.cure.format(**numbers), numbers, about
        )


def _fill_sentence(sentence: str, numbers: Mapping[str, float | str]) -> str:
    """A sentence with its numbers, of which those get more digits that would read like the limit which they miss."""
    limit = float(numbers.get("limit", "nan"))

    def apart(field: re.Match[str]) -> str:
        """A field with so many digits that its number is not printed as the limit."""
        value, digits = float(numbers[field[1]]), int(field[2])
        while value != limit and float(f"{value:.{digits}g}") == limit and digits < MOST_DIGITS:
            digits += 1
        return f"{{{field[1]}:.{digits}g}}"

    return re.sub(r"\{(\w+):\.(\d)g\}", apart, sentence).format(**numbers)


def base_name(finding: str) -> str:
    """Name of the check of a finding's name."""
    return finding.split(":", 1)[0]


@dataclass(frozen=True)
class Evidence:
    """All that the verdict on one estimate rests on.

    Attributes
    ----------
    evaluation : Evaluation
        The estimate, with covariances that hold with errors that may be correlated.
    others : Sequence[Evaluation]
        Other estimators of the same measurements that have not failed.
    gate_false_alarm : float
        Probability that a measurement is refused whose noise is as stated.
    found : Sequence[Finding]
        Failed checks of the recording, its initialisation, its noise and its models.
    centre_prior_std : float
        Standard deviation of the centre of mass before anything was measured, m; infinite where it is not known.
    expected_nis : float
        Least NIS per degree of freedom that the noise is meant to give; below one where it is wide on purpose.
    streams : Sequence[MeasurementStream]
        What the estimate was made from, one of each sensor.
    """

    evaluation: Evaluation
    others: Sequence[Evaluation] = ()
    gate_false_alarm: float = 0.0
    found: Sequence[Finding] = field(default_factory=tuple)
    centre_prior_std: float = float("inf")
    expected_nis: float = 1.0
    streams: Sequence[MeasurementStream] = ()

    @property
    def peers(self) -> list[Evaluation]:
        """Other estimators than this one that have not failed."""
        return [each for each in not_failed(self.others) if each.name != self.evaluation.name]

    @property
    def present(self) -> frozenset[Needs]:
        """Kinds of evidence that are present, from which tests of an estimate can be computed.

        A smoother of the same measurements and residuals are tested where they arise, and come as findings.
        """
        own = {Needs.RECORDING, Needs.ESTIMATE}
        if self.evaluation.nis_ratio is not None:
            own.add(Needs.FILTER)
        if self.peers:
            own.add(Needs.PEERS)
        return frozenset(own)


LARGEST_MOMENT_STD: Final = 0.1
"""Of a principal moment relative to the largest: beyond it the body's shape is not known."""
CLEAR_OF_ZERO: Final = 3.0
"""Standard deviations of the smallest moment above zero: below, the ratio k2 to the next has no upper bound."""
LARGEST_NIS: Final = 2.5
"""NIS per degree of freedom above which measurement or process noise is clearly understated."""
SMALLEST_NIS: Final = 1 / LARGEST_NIS
"""Of the NIS that is expected, below which the noise is clearly overstated."""
LARGEST_REJECTED: Final = 0.2
"""Share of measurements left out, beyond which whatever makes them cannot be trusted."""
LEFT_OUT: Final = "measurements-left-out"
"""Check of measurements that were refused, of a recording or of one estimator."""
FALSE_ALARM: Final = 1e-6
"""Probability that a recording whose noise is what it is said to be, of any length, is doubted for what gates refused."""
LARGEST_GAP: Final = 10.0
"""Between two epochs, in median intervals: beyond it the estimate in between is a prediction."""
DISAGREEMENT_STD: Final = 4.0
DISAGREEMENT: Final = 0.01
"""Two estimators on the same measurements disagree beyond both of these."""


def moments_undetermined(evidence: Evidence) -> Iterator[Failure]:
    """Moments whose standard deviation leaves the body's shape unknown."""
    worst = float(np.max(evidence.evaluation.body.principal_moments_std))
    if worst > LARGEST_MOMENT_STD:
        yield Failure({"std": worst, "limit": LARGEST_MOMENT_STD})


def moment_may_be_zero(evidence: Evidence) -> Iterator[Failure]:
    """A smallest moment that its standard deviation does not distinguish from zero."""
    body = evidence.evaluation.body
    smallest, std = float(body.principal_moments[0]), float(body.principal_moments_std[0])
    known = float(np.max(body.principal_moments_std)) <= LARGEST_MOMENT_STD
    if known and smallest < CLEAR_OF_ZERO * std:
        yield Failure({"moment": smallest, "std": std})


def innovations_too_large(evidence: Evidence) -> Iterator[Failure]:
    """Innovations beyond what the noise explains."""
    ratio = evidence.evaluation.nis_ratio
    if ratio is not None and ratio > LARGEST_NIS:
        yield Failure({"ratio": ratio, "times": float(np.sqrt(ratio))})


NOISE_CHECKS: Final = frozenset({"stated-noise", "row-noise", "filter-noise", "filter-disturbance"})
"""Checks that say which level of noise is wrong."""


def innovations_too_small(evidence: Evidence) -> Iterator[Failure]:
    """Innovations far within what the noise explains, beyond chance, where no check names the level that is wrong."""
    history, ratio = evidence.evaluation.history, evidence.evaluation.nis_ratio
    if ratio is None or not ratio < SMALLEST_NIS * evidence.expected_nis:
        return
    dof, expected = float(history.dof.sum()), evidence.expected_nis
    chance = 1.0 - float(chi_square_tail(ratio * dof / expected, dof))
    if chance < FALSE_ALARM and not any(base_name(each.check) in NOISE_CHECKS for each in evidence.found):
        yield Failure({"ratio": ratio, "times": float(np.sqrt(1 / max(ratio, np.finfo(float).tiny)))})


def measurements_left_out(evidence: Evidence) -> Iterator[Failure]:
    """A large share of measurements that were refused, where the recording is not doubted for it already."""
    numbers = rejected_share(evidence.evaluation.history)
    if numbers is not None and not any(each.check == LEFT_OUT for each in evidence.found):
        yield Failure(numbers)


def rejected_share(history: EstimateHistory) -> dict[str, float | str] | None:
    """Numbers of measurements of all sensors that an estimator refused at its own epochs; None up to `LARGEST_REJECTED`."""
    rejected = int(history.rejected[history.own].sum())
    total = rejected + int(history.accepted[history.own].sum())
    if not total or rejected <= LARGEST_REJECTED * total:
        return None
    return {"rejected": rejected, "total": total, "percent": 100.0 * rejected / total}


def epochs_refused(evidence: Evidence) -> Iterator[Failure]:
    """Epochs without any inlier: more of them, or more in a row, than false alarms account for.

    An epoch of m independent values is refused as a whole with probability p^m. The number of such epochs is compared with a
    Poisson number of that expectation; r in a row at one of n places have at most the probability n q^r, with q the mean of p^m.
    """
    history, false_alarm = evidence.evaluation.history, evidence.gate_false_alarm
    measured = history.accepted + history.rejected
    empty = (history.accepted == 0) & (measured > 0)
    count, epochs = int(np.count_nonzero(empty)), int(np.count_nonzero(measured))
    if not count:
        return
    expected = float(np.sum(false_alarm ** measured[measured > 0]))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], empty, [False]])))
    longest = int((edges[1::2] - edges[::2]).max())
    smallest_batch = min(1.0, epochs * (expected / epochs) ** longest)
    if min(float(pdtrc(count - 1, expected)), smallest_batch) < FALSE_ALARM:
        of = len(history.time[history.own])
        yield Failure({"count": count, "epochs": of, "longest": longest, "expected": expected})


def gap(evidence: Evidence) -> Iterator[Failure]:
    """A stretch in which nothing was measured."""
    time = evidence.evaluation.history.time
    gaps = np.diff(time)
    if gaps.size and gaps.max() > LARGEST_GAP * np.median(gaps):
        yield Failure({"seconds": float(gaps.max()), "begin": float(time[gaps.argmax()])})


def estimators_disagree(evidence: Evidence) -> Iterator[Failure]:
    """Moments that differ from those of every other estimator that has not failed."""
    evaluation = evidence.evaluation
    for other in evidence.peers:
        away = np.abs(evaluation.body.principal_moments - other.body.principal_moments)[:2]
        std = np.hypot(evaluation.body.principal_moments_std, other.body.principal_moments_std)[:2]
        if np.any((away > DISAGREEMENT_STD * std) & (away > DISAGREEMENT)):
            yield Failure({"other": other.name, "difference": float(away.max())})


MOST_MOMENTUM: Final = 0.2
"""Relative change of the angular momentum of measured rates, from which no free body before a camera at rest is likely."""
CERTAIN: Final = "none: what it finds is a fact"
LIMIT: Final = "none by chance: a limit of usefulness"
MORE: Final = "give a longer recording, a richer motion or a larger initialisation.share"
STATE_ANOTHER: Final = "state another, or leave it out to have it identified"

CHECKS: Final[tuple[Check, ...]] = (
    # ---- what an estimator says of itself
    Check(
        "not-finite", ALL, Needs.ESTIMATE, "Are all numbers finite, and can the motion be integrated?", CERTAIN,
        "the estimate stopped being finite, or could not be computed",
        "look for wrong measurements, units and noise in the data set, or choose another estimator",
        leaves=Holds.NOT_DETERMINED,
    ),
    Check(
        "interrupted", NOTHING, Needs.ESTIMATE, "Did the estimator take all epochs?", CERTAIN,
        "interrupted after some of the epochs", "continue with --resume",
    ),
    Check(
        "late-measurements", NOTHING, Needs.ESTIMATE, "Did all measurements come in time to be used?", CERTAIN,
        "some measurements came too late and were left out", "keep more epochs for late measurements",
    ),
    Check(
        "broken-measurements", ALL, Needs.ESTIMATE, "Did the estimate stay finite after every measurement?", CERTAIN,
        "measurements made the estimate infinite and were removed", "look for gross errors in what that sensor sends",
    ),
    Check(
        "fast-rotation", ALL, Needs.ESTIMATE, "Is each step of the embedded filter short enough for its integration?",
        CERTAIN, "the body turned too far for the substeps of a prediction", "generate the filter with more substeps",
    ),
    Check(
        "steps-left-out", ALL, Needs.ESTIMATE, "Did every step of the embedded filter stay finite?", CERTAIN,
        "steps would not have stayed finite and were left out", "look for gross errors in the measurements",
    ),
    Check(
        "smoother-unsettled", ALL, Needs.SMOOTHER, "Did the smoother's iterations converge?", CERTAIN,
        "the smoother did not converge", "raise smoother.iterations, or look for wrong measurements",
    ),
    Check(
        "filter-failed", ALL, Needs.SMOOTHER, "Did the filter finish that gives the smoother its initial guess?", CERTAIN,
        "the filter that gives the smoother its initial guess failed",
        "look for wrong measurements at the epoch where the filter fails",
    ),
    Check(
        "posterior-not-gaussian", BODY, Needs.SMOOTHER,
        "Does the Gaussian belief of the mass distribution, or do samples along its ridge represent its posterior? Pareto shape of "
        "the weights at most 0.7, of the Gaussian also mean NEES of the samples at most 2 per degree of freedom; tested where one "
        "direction has a deviation above 0.1", LIMIT,
        "the posterior of the moments is not Gaussian (Pareto shape {shape:.2g}, limit 0.7; NEES of its samples {nees:.2g}, "
        "limit 2), and samples along its ridge do not represent it (Pareto shape {samples:.2g})",
        "record a motion that wobbles",
    ),
    Check(
        "unobservable", NOTHING, Needs.SMOOTHER,
        "Is each component of the state known better than 0.7 of its prior deviation?", LIMIT,
        "the data do not determine some components of the state", "record a motion that wobbles",
        leaves=Holds.NOT_DETERMINED,
    ),
    Check(
        "calibration-uncounted", ALL, Needs.ESTIMATE, "Could deviations include the errors of the calibration?",
        CERTAIN, "the effect of calibration errors on the estimates could not be computed",
        "state the calibration as exact, or choose the smoother",
    ),
    Check(
        "inertia-not-yet", BODY, Needs.SMOOTHER, "Does the smoother already know the mass distribution?", LIMIT,
        "the inertia is not determined yet", "wait for more epochs, or for a motion that wobbles",
        leaves=Holds.NOT_DETERMINED,
    ),
    Check(
        "poor-fit", ALL, Needs.SMOOTHER, "Does the latest solution explain its observations within their noise?",
        "of the order of 1e-3 an epoch", "the motion found does not explain the observations within their noise",
        "wait for more epochs; if it remains, state a larger noise of the sensor",
    ),
    Check(
        "no-pose", ALL, Needs.SMOOTHER, "Do the latest epoch's observations agree on one pose?", CERTAIN,
        "the latest epoch's observations agree on no pose", "wait for the next epoch, or look for wrong associations",
    ),
    Check(
        "live", ALL, Needs.FILTER, "Running tests of a filter's latest epochs: NIS, rejected measurements, noise levels",
        "of the order of 1e-6 a window", "the filter's latest epochs contradict its model",
        "check what the sentence names: noise, clock and gross errors of the source",
    ),
    Check(
        "no-smoother", NOTHING, Needs.SMOOTHER, "Does the smoother run whose results a live filter takes over?", CERTAIN,
        "the filter continues without the smoother", "see why it ended; restart the live run to have it back",
    ),
    Check(
        "epoch-unused", ALL, Needs.FILTER, "Was any measurement of a live filter's latest epoch used?",
        "that of the gate, of every measurement of the epoch", "no measurement of this epoch was used",
        "wait for the next epoch",
    ),
    Check(
        "time-unconfirmed", ALL, Needs.RECORDING, "Does the next epoch confirm a jump of a live source's time stamps?", CERTAIN,
        "the epoch's time is far ahead of the one before", "wait for the next epoch, or check the clock of the source",
    ),
    Check(
        "prediction-range", NOTHING, Needs.ESTIMATE, "Can a live estimate be predicted as far ahead as asked?", CERTAIN,
        "it cannot be predicted so far ahead", "ask for a shorter prediction",
    ),
    Check(
        "live-disagrees", ALL, Needs.FILTER,
        "Is the last answer of a live run within 4 joint deviations of the estimate of its kept epochs?",
        "below 1e-4 a component",
        "the last answer is {deviations:.2g} joint deviations away from the estimate of the kept epochs",
        "rely on the estimate of the recording (spinfilters compare)",
    ),
    Check(
        OWN_STATUS, ALL, Needs.ESTIMATE, "Statement of an estimator or plug-in about itself", "as its author states",
        "the estimator doubts its result", "read its documentation",
    ),
    # ---- the recording and its initialisation
    Check(
        "not-initialised", ALL, Needs.INITIALISATION, "Could the first epochs be smoothed?", CERTAIN,
        "the first epochs could not be smoothed", "check the first epochs, or raise initialisation.share",
        leaves=Holds.NOT_DETERMINED,
    ),
    Check(
        "camera-may-move", ALL, Needs.INITIALISATION,
        "Where the smoother of the first epochs did not converge: does the angular momentum change "
        f"by at most {100 * MOST_MOMENTUM:.0f} %?",
        "none unless the initialisation did not converge",
        "the initialisation did not converge, and the angular momentum seems to change by {percent:.2g} %: the camera may have "
        "moved",
        "give its known poses (inspector.tum), or fix it",
    ),
    Check(
        "initialisation-unsettled", ALL, Needs.INITIALISATION, "Did the smoother of the first epochs converge?", CERTAIN,
        "the initialisation did not converge in its iterations", "raise initialisation.iterations or initialisation.share",
    ),
    Check(
        "data-set", ALL, Needs.RECORDING, "Does the reader or the front end trust its result from raw data?", CERTAIN,
        "the measurements derived from raw data are doubtful", "check the raw data, and the remarks of their reader",
        is_cause=True,
    ),
    Check(
        "sensor-data", ALL, Needs.RECORDING, "Are the values of each sensor within its range?", CERTAIN,
        "samples of a sensor are saturated", "choose a larger range of the sensor, or cut the recording",
    ),
    Check(
        "not-a-free-flight", ALL, Needs.RECORDING,
        "Does torque-free motion explain a gyro of unknown noise to 4 % of the rate?", LIMIT,
        "not a free flight: torque-free motion leaves {percent:.2g} % of the rate unexplained, at most "
        "{limit:.2g} % can be errors of the gyro",
        "cut the recording to the flight (--segment), or check axes, range and unit of the gyro",
    ),
    Check(
        "sparse-inspector-poses", ALL, Needs.RECORDING,
        "Are the inspector's poses dense enough for its path? Errors of interpolation at most the pixel noise over "
        "the root of the number of observations in an image",
        CERTAIN,
        "the inspector's poses are too sparse for its path: {interval:.3g} s apart, their interpolation is wrong by about "
        "{millimetres:.2g} mm and {rotation:.2g} rad, which is {pixels:.2g} px",
        "give poses at the stamps of the images, or more of them (inspector.tum)",
    ),
    Check(
        "repeated-inspector-poses", ALL, Needs.RECORDING,
        "Does a moving inspector's pose repeat exactly over 3 intervals, without coming to rest before?", CERTAIN,
        "inspector.tum repeats its pose from t = {begin:.3f} s to {end:.3f} s, but the camera moves just before or after",
        "give the poses of that time, or cut the recording there (--segment)",
    ),
    Check(
        "motion-shows-no-moments", BODY, Needs.FILTER,
        "Does the estimated body predict the epochs after the initialisation better than a sphere does? "
        "Twice the log likelihood ratio is at least 30",
        "below 1e-6 of motions that wobble",
        "the motion does not determine the moments of inertia: a sphere predicts {epochs} epochs as well "
        "(evidence {evidence:.2g}, at least {limit:.2g} is needed); {why}",
        "record a motion that wobbles",
        leaves=Holds.NOT_DETERMINED,
    ),
    # ---- errors of the models
    Check(
        "front-end-slip", ALL, Needs.RECORDING,
        "Does the attitude jump by more than 60 deg, 6 times its usual departure, with the same rate before and after?",
        "below 1e-6 of white errors of attitudes", "{text}", "{cure}",
        is_cause=True,
    ),
    Check(
        "first-epochs", ALL, Needs.INITIALISATION,
        "Where the first epochs do not settle on a motion: do they settle without the first 20 % of the recording?",
        "below 3 %: none of 106 right recordings of gyros, poses and tracks with a map, of experiments.what_holds, "
        "experiments.captured_throws and python -m experiments.named_causes --causes none",
        "the first epochs are not one motion with the later ones: they leave {fit:.2g} times their noise, those from "
        "t = {time:.3f} s on {later_fit:.2g} times, as after a contact in the first epochs",
        "begin the recording there (--segment {time:.3f}:)",
        is_cause=True,
    ),
    Check(
        "correlated-errors", ALL, Needs.RESIDUALS,
        "Are measurement errors correlated in time, rather than disturbances? Probability above 0.8 and an expected NEES above 2",
        "at most 0.2 of the cases in which it fails",
        "errors of the measurements are correlated over {time:.2g} s ({sizes}; -2 ln likelihood falls by {advantage:.2g}) and "
        "resemble disturbances; deviations allow for {inflation:.2g} times the variance",
        "take measurements further apart, or a longer recording",
    ),
    Check(
        "correlated-observations", ALL, Needs.RESIDUALS,
        "Are a landmark's residuals correlated from epoch to epoch? 5 deviations of chance and an expected NEES above 2", "3e-7",
        "errors of a landmark's observations are correlated ({correlation:.2g} from epoch to epoch, {score:.2g} deviations of "
        "chance): squared errors of the estimates may be {inflation:.2g} times the stated variances",
        "use images further apart, or state the covariances of the rows with covariance_inflation",
    ),
    Check(
        "correlation-undecided", BODY, Needs.RESIDUALS,
        "Are the moments known, both with correlated measurement errors and with disturbances?", LIMIT,
        "disturbances cannot be distinguished from errors of the measurements that are correlated over {time:.2g} s ({sizes}), and "
        "deviations allow for both",
        "state process.torque_psd if it is known, or give a longer recording",
        leaves=Holds.NOT_DETERMINED,
    ),
    Check(
        "wrong-unit", ALL, Needs.RECORDING,
        "Are intervals, rates, baselines and distances plausible, and do positions agree with attitudes as they are read?",
        CERTAIN, "{text}", "{cure}",
        is_cause=True,
    ),
    Check(
        "slow-change", ALL, Needs.RESIDUALS,
        "Do the rates of a spin about one axis change slowly by more than the noise explains? Score test, Bonferroni over the list",
        "1 % of recordings, with all other model errors", "{text}", "record a motion that wobbles, or state the gyro's drift",
    ),
    Check(
        "map-error", ALL, Needs.RESIDUALS,
        "Does an error of the list explain registered poses by more than errors of their map do? Score test with shifts and "
        "rotations of second degree in the direction of view",
        "1 % of recordings, with all other model errors", "{text}", "give more scans, so that the same views come back more often",
    ),
    Check(
        "unexplained-residuals", ALL, Needs.RESIDUALS,
        "Are residuals within chance, or explained by an error of the list?",
        "1 % of recordings, with all other model errors", "{text}", "",
    ),
    Check(
        "models-not-tested", ALL, Needs.RESIDUALS, "Could errors of the models be tested?", CERTAIN,
        "errors of the models could not be tested ({text})", "check the data set and its noise",
    ),
    Check(
        "smoothed-checks-left-out", ALL, Needs.ESTIMATE, "Were the models and the noise tested about the smoothed motion?", CERTAIN,
        "models and noise were tested only in the filters' own epochs (verdict = \"filter\")",
        "use all checks (--verdict full)",
    ),
    Check(
        "model-error", ALL, Needs.RESIDUALS,
        "Score test of each error of the list about the smoothed motion; those that affect an estimate are named",
        "1 % of recordings for all errors together, 0.2 % for one that moves a state by 4 deviations "
        "and that no stated calibration excludes; measured: python -m experiments.honesty",
        "{text}", "",
    ),
    # ---- levels of noise
    Check(
        "stated-noise", ALL, Needs.RESIDUALS,
        "Score tests of all stated levels at once: beyond 4 deviations of chance and a variance 1.5 times wrong",
        "6e-5 of each level", "{name} is {stated:.3g}, the data have {seen} ({score:.2g} deviations of chance)", "{cure}",
    ),
    Check(
        "row-noise", ALL, Needs.RESIDUALS,
        "The same for deviations stated in the rows of a sensor, or by several numbers together", "6e-5 of each level",
        "{name}: the data have {times:.3g} +- {std:.1g} times the deviations that {state}{inflated} "
        "({score:.2g} deviations of chance)",
        "state other ones, or leave them out to have them identified",
    ),
    Check(
        "identified-noise", ALL, Needs.RESIDUALS,
        "The same for levels identified from the first epochs; a variance four times too small fails beyond 3 deviations of chance",
        "3e-5 of each level, 1e-3 of a variance four times too small",
        "{name} was identified as {stated:.3g} from the first epochs, all data have {seen} ({score:.2g} deviations of chance)",
        "the first epochs are too few, the noise changes, or a model is wrong: use the smoother, state the level, raise "
        "initialisation.share, or cut the recording",
    ),
    Check(
        "noise-not-tested", ALL, Needs.RESIDUALS, "Could the noise levels be tested?", CERTAIN,
        "the noise could not be tested ({text})", "check the data set and its noise",
    ),
    Check(
        "vague-initialisation", ALL, Needs.FILTER,
        "If no smoother can judge the filter: do the first epochs determine the moments to 0.12 of the largest?", LIMIT,
        "the first {epochs} epochs leave the moments uncertain by {std:.2g}: the filter becomes over-confident", MORE,
    ),
    Check(
        "over-confident", ALL, Needs.SMOOTHER,
        "Is the expected NEES of a filter or a fixed lag, with the smoother as the truth, that of a consistent filter? "
        "Whole error and mass distribution, mean over its epochs and at the last",
        "1 % of consistent filters at most",
        "over-confident: its errors{which} {where} are {times:.2g} times its stated standard deviations (root mean square), "
        "judged by the smoother",
        f"use the smoother, or {MORE}",
    ),
    Check(
        "filter-noise", ALL, Needs.FILTER,
        "Chi-square of the part of a filter's innovations that no state explains: 5 deviations of chance and a variance "
        "1.5 times wrong",
        "6e-7", "the errors of the {name} have {times:.2g} times the {level} ({score:.2g} deviations of chance)", "{cure}",
    ),
    Check(
        "filter-disturbance", ALL, Needs.FILTER,
        "Chi-square of a filter's corrections along the disturbances: 5 deviations of chance and a density 1.5 times wrong",
        "6e-7",
        "disturbances have {times:.2g} times the {level} ({score:.2g} deviations of chance): process.{name} is {ratio:.2g} times "
        "{before}, or the model is wrong",
        "state process.{name}, or leave it out to have it identified",
    ),
    Check(
        "correlated-corrections", ALL, Needs.FILTER,
        "Are a filter's corrections of neighbouring epochs correlated? 5 deviations of chance and 0.15", "3e-7",
        "corrections of neighbouring epochs are correlated ({correlation:.2g}, {score:.2g} deviations of chance): an error of "
        "model, clock or calibration, or disturbances that are stated too small",
        "compare with --explain, or raise process.force_psd and process.torque_psd",
    ),
    # ---- the estimate itself
    Check(
        "moments-undetermined", frozenset({MOMENTS}), Needs.ESTIMATE,
        f"Is each moment's deviation at most {LARGEST_MOMENT_STD} of the largest moment?", LIMIT,
        "the moments of inertia are not determined: their standard deviation is {std:.2g} of the largest moment (limit "
        "{limit:.2g})",
        "record a motion that wobbles, or a longer one", moments_undetermined, Holds.NOT_DETERMINED,
    ),
    Check(
        "moment-may-be-zero", frozenset({MOMENTS}), Needs.ESTIMATE,
        f"Is the smallest moment {CLEAR_OF_ZERO:g} deviations above zero?", LIMIT,
        "the smallest moment of inertia, {moment:.2g} ± {std:.2g} of the largest, may be zero: the body is a needle, and its "
        "ratio k2 has no upper bound",
        "record a motion with more rotation about the long axis, or a longer one", moment_may_be_zero,
    ),
    Check(
        "innovations-too-large", ALL, Needs.FILTER, f"Is the NIS per degree of freedom at most {LARGEST_NIS}?",
        "below 1e-6 from 20 degrees of freedom on",
        "innovations are {times:.2g} times as large as the noise explains (NIS {ratio:.2g} per degree of freedom)",
        "raise process.force_psd, process.torque_psd or the sensor's standard deviation in a config file",
        innovations_too_large,
    ),
    Check(
        "innovations-too-small", NOTHING, Needs.FILTER,
        f"Is the NIS per degree of freedom at least {SMALLEST_NIS:g}, or that share of what correlated or inflated "
        "noise leaves of it?",
        f"{FALSE_ALARM:.0e}, below {SMALLEST_NIS:g} by chance",
        "the assumed noise is far larger than the measurements show: innovations are {times:.2g} times smaller than it explains "
        "(NIS {ratio:.2g} per degree of freedom), so deviations are too wide",
        "state a smaller noise of the sensor or of the disturbances in a config file, or leave it out to have it identified",
        innovations_too_small,
    ),
    Check(
        "measurements-left-out", ALL, Needs.ESTIMATE,
        f"Are at most {LARGEST_REJECTED:.0%} of the measurements rejected?", "below 1e-6",
        "{rejected} of {total} measurements ({percent:.2g} %) could not be used or were rejected",
        "look for gross errors, wrong associations or too small a stated noise", measurements_left_out,
    ),
    Check(
        "epochs-refused", ALL, Needs.ESTIMATE,
        "Are no more whole epochs rejected, in all or in a row, than false alarms of the gate explain?",
        f"{FALSE_ALARM:.0e} of recordings of any length",
        "{count} of {epochs} epochs gave no information, {longest} in a row ({expected:.2g} by chance): all their measurements "
        "were rejected, or only repeated the previous epoch",
        "cut the recording there, or look for gross errors and repeated images", epochs_refused,
    ),
    Check(
        "gap", NOTHING, Needs.RECORDING,
        f"Is no interval longer than {LARGEST_GAP:g} median intervals?", CERTAIN,
        "nothing was measured for {seconds:.3g} s after t = {begin:.3f} s: estimates in between are predictions",
        "cut the recording there if the body may have been touched", gap,
    ),
    Check(
        "estimators-disagree", BODY, Needs.PEERS,
        f"Do the moments of any two estimators agree within {DISAGREEMENT_STD:g} of both deviations, or "
        f"{DISAGREEMENT}?",
        "6e-5 of independent estimators, less of those of the same measurements",
        "its moments differ from those of {other} by up to {difference:.2g} of the largest",
        "use the one that is ok, the smoother rather than a filter", estimators_disagree,
    ),
)  # fmt: skip
"""Every check, by the order of its sentences in a verdict."""

BY_NAME: Final[Mapping[str, Check]] = {check.name: check for check in CHECKS}


def finding(
    check: str,
    numbers: Mapping[str, float | str],
    about: frozenset[str] | None = None,
    which: str = "",
) -> Finding:
    """Finding of a check of the list, by its name; see `Check.finding`.

    Raises
    ------
    KeyError
        No such check, or a number that its sentence needs is missing.
    """
    return BY_NAME[check].finding(numbers, about, which)


def check_of(found: Finding) -> Check:
    """The check that a finding failed; that of an estimator's own words for a name that is not in the list."""
    return BY_NAME.get(base_name(found.check), BY_NAME[OWN_STATUS])
