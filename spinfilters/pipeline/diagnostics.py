"""Diagnostic rules: each is one sentence with its numbers."""

from collections.abc import Sequence

import numpy as np
from scipy.special import pdtrc

from spinfilters.estimators.history import EstimateHistory
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.pipeline.initialisation_length import DETERMINED_STD, moments_std_of
from spinfilters.pipeline.setup import Setup
from spinfilters.sensors.sensor import sensor_of
from spinfilters.state.status import EstimatorStatus, Verdict

RICHER = "give a longer recording, a richer motion or a larger initialisation.share"
"""What helps filters that began from too little."""
LARGEST_MOMENT_STD = 0.1
"""Of a principal moment relative to the largest: beyond it the body's shape is not known."""
CLEAR_OF_ZERO = 3.0
"""Standard deviations of the smallest moment above zero: below, the ratio k2 to the next has no upper bound."""
LARGEST_NIS = 2.5
"""NIS per degree of freedom above which measurement or process noise is clearly understated."""
LARGEST_REJECTED = 0.2
"""Share of measurements left out, beyond which whatever makes them cannot be trusted."""
FALSE_ALARM = 1e-6
"""Probability that a recording whose noise is what it is said to be, of any length, is doubted for what gates refused."""
LARGEST_GAP = 10.0
"""Between two epochs, in median intervals: beyond it the estimate in between is a prediction."""
DISAGREEMENT_STD, DISAGREEMENT = 4.0, 0.01
"""Two estimators on the same measurements disagree beyond both of these."""


def shared_diagnostics(setup: Setup) -> list[str]:
    """Reasons that concern every estimator of a run."""
    reasons = [*setup.initial.status.reasons, *setup.dataset.doubts]
    noise = setup.gyro_noise
    if noise is not None and not noise.is_of_flight:
        reasons.append(
            f"the motion explains the gyro only to {100 * noise.relative_error:.1f} % of the rate: not a free flight"
        )
    for stream in setup.dataset.log.streams:
        reasons += sensor_of(stream.sensor).diagnostics(stream)
    return reasons


def filter_diagnostics(setup: Setup) -> list[str]:
    """Reasons that concern filters alone: a smoother revises its first epochs."""
    if setup.initial.has_failed:
        return []
    std, count = moments_std_of(setup.initial), len(setup.initial.mean)
    if not std <= DETERMINED_STD:
        return [
            f"the first {count} epochs leave the moments uncertain by {std:.2f}: what follows is over-confident; {RICHER}"
        ]
    return []


def with_verdict(
    evaluation: Evaluation, diagnostics: Sequence[str], others: Sequence[Evaluation], false_alarm: float
) -> EstimatorStatus:
    """The run's own status with every further reason for doubt; see `EstimatorEntry.false_alarm_probability`."""
    status = evaluation.history.status
    if not np.isfinite(evaluation.body.principal_moments_std).all() and status.verdict is not Verdict.FAILED:
        status = status.failed("the moments of inertia at the end are not finite")
    own = _own_diagnostics(evaluation, false_alarm)
    for reason in dict.fromkeys([*diagnostics, *own, *_disagreements(evaluation, others)]):
        status = status.degraded(reason)
    return status


def _own_diagnostics(evaluation: Evaluation, false_alarm: float) -> list[str]:
    reasons, body, history = [], evaluation.body, evaluation.history
    worst = float(np.max(body.principal_moments_std))
    if worst > LARGEST_MOMENT_STD:
        reasons.append(
            f"the moments of inertia are not determined: standard deviation {worst:.2g} of the largest"
        )
    smallest, std = float(body.principal_moments[0]), float(body.principal_moments_std[0])
    if worst <= LARGEST_MOMENT_STD and smallest < CLEAR_OF_ZERO * std:
        reasons.append(
            f"the smallest moment of inertia, {smallest:.2g} ± {std:.2g} of the largest, may be zero: the body is a needle, "
            "and its ratio k2 may be any larger number"
        )
    ratio = evaluation.nis_ratio
    if ratio is not None and ratio > LARGEST_NIS:
        reasons.append(
            f"innovations are {ratio:.1f} times as large (squared) as the noise explains: raise process.force_psd, "
            "process.torque_psd or the sensor's standard deviation in a config file"
        )
    return [*reasons, *_left_out(history, false_alarm)]


def _left_out(history: EstimateHistory, false_alarm: float) -> list[str]:
    """Doubts about measurements that were not there or not believed."""
    reasons = [*rejection_diagnostics(history), *_empty_epochs(history, false_alarm)]
    gaps = np.diff(history.time)
    if gaps.size and gaps.max() > LARGEST_GAP * np.median(gaps):
        reasons.append(
            f"nothing was measured for {gaps.max():.3g} s after t = {history.time[gaps.argmax()]:.3f} s"
        )
    return reasons


def rejection_diagnostics(history: EstimateHistory) -> list[str]:
    """Doubt where more measurements are left out than can be trusted to be wrong alone."""
    all_rejected, all_accepted = history.rejected[history.own], history.accepted[history.own]
    rejected, total = int(all_rejected.sum()), int((all_rejected + all_accepted).sum())
    if not total or rejected <= LARGEST_REJECTED * total:
        return []
    return [f"{rejected} of {total} measurements could not be used or were not believed"]


def _empty_epochs(history: EstimateHistory, false_alarm: float) -> list[str]:
    """Doubts about epochs without any inlier.

    More of them, or more in a row, than false alarms account for.
    An epoch of m independent values is refused as a whole with probability p^m. The number of such epochs is compared with a
    Poisson number of that expectation; r in a row at one of n places have at most the probability n q^r, with q the mean of p^m.
    """
    measured = history.accepted + history.rejected
    empty = (history.accepted == 0) & (measured > 0)
    count, epochs = int(np.count_nonzero(empty)), int(np.count_nonzero(measured))
    if not count:
        return []
    expected = float(np.sum(false_alarm ** measured[measured > 0]))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], empty, [False]])))
    longest = int((edges[1::2] - edges[::2]).max())
    smallest_batch = min(1.0, epochs * (expected / epochs) ** longest)
    if min(float(pdtrc(count - 1, expected)), smallest_batch) >= FALSE_ALARM:
        return []
    return [
        f"{count} of {len(history.time[history.own])} epochs told nothing, {longest} in a row ({expected:.2g} by chance): all of "
        "them were refused, or they only repeated the epoch before"
    ]


def _disagreements(evaluation: Evaluation, others: Sequence[Evaluation]) -> list[str]:
    """Disagreements with every other estimator that has not failed."""
    reasons = []
    for other in others:
        if other.name == evaluation.name or other.history.status.verdict is Verdict.FAILED:
            continue
        gap = np.abs(evaluation.body.principal_moments - other.body.principal_moments)[:2]
        std = np.hypot(evaluation.body.principal_moments_std, other.body.principal_moments_std)[:2]
        if np.any((gap > DISAGREEMENT_STD * std) & (gap > DISAGREEMENT)):
            reasons.append(f"its moments differ from those of {other.name} by up to {gap.max():.3f}")
    return reasons
