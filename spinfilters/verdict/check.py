"""One check of the verdict, the evidence that it is given, and the tests of an estimate by its own numbers, with their limits."""

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
from spinfilters.models.status import Finding, Holds

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
