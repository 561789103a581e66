"""Tests of an estimate by its own numbers, and beside other estimators."""

from collections.abc import Iterator
from typing import Final

import numpy as np
from scipy.special import pdtrc

from spinfilters.estimators.history import EstimateHistory
from spinfilters.verdict.check import Failure
from spinfilters.verdict.evidence import Evidence

LARGEST_MOMENT_STD: Final = 0.1
"""Of a principal moment relative to the largest: beyond it the body's shape is not known."""
CLEAR_OF_ZERO: Final = 3.0
"""Standard deviations of the smallest moment above zero: below, the ratio k2 to the next has no upper bound."""
LARGEST_NIS: Final = 2.5
"""NIS per degree of freedom above which measurement or process noise is clearly understated."""
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
    """A smallest moment that its standard deviation does not tell from zero."""
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


def measurements_left_out(evidence: Evidence) -> Iterator[Failure]:
    """A large share of measurements that were refused, where the recording is not doubted for it already."""
    numbers = rejected_share(evidence.evaluation.history)
    if numbers is not None and not any(each.check == LEFT_OUT for each in evidence.found):
        yield Failure(numbers)


def rejected_share(history: EstimateHistory) -> dict[str, float | str] | None:
    """Numbers of measurements that an estimator refused at its own epochs; None up to `LARGEST_REJECTED`."""
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
