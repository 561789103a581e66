"""Number of epochs of an initialisation.

Until a filter that goes on from them is as good as the smoother.
A filter linearises once. While a motion is hardly known, what that leaves out is as large as what it knows, and without
disturbances it is never forgotten: on flips and on noisy poses filters ended off by tens of their standard deviations, although the
moments had been known to a tenth. So the length is chosen by what is sought: a filter is carried over as many epochs again, and
beside it stands the smoother of the same measurements, which linearises until it has converged. They differ by the filter's
linearisation alone.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from spinfilters.errors import NUMERICAL_ERRORS
from spinfilters.estimators.estimator import ProcessModel
from spinfilters.estimators.filters.multiplicative_ekf import MultiplicativeEkf
from spinfilters.estimators.initialisation.initial_estimate import InitialEstimate
from spinfilters.estimators.initialisation.options import InitialisationOptions
from spinfilters.estimators.robust.gate_weights import RobustOptions
from spinfilters.estimators.run import run
from spinfilters.estimators.smoothing.factors.sensor_rows import without_refused
from spinfilters.estimators.timeline import Timeline
from spinfilters.evaluation.body import body_estimate
from spinfilters.linear_algebra.normalised_square import normalised_square
from spinfilters.state.blocks.rigid_body import RATE
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.status import Verdict

DETERMINED_STD = 0.12
"""Of a principal moment relative to the largest: what the first epochs must reach for filters to go on from them. On simulated
motions all starts below it were consistent, and half of those above it led to NEES of twice the degrees of freedom and more."""
LINEAR_STD, LINEAR_RATE_STD = 0.08, 0.02
"""Of the mass distribution (log second moments) and of the body rate relative to it, below which hardly anything is bent and no
filter is tried: simulated motions that went astray had begun beyond 0.1 or, with noisy sensors, beyond 0.04."""
LARGEST_DEPARTURE = 0.7
"""Of a filter from the smoother, in the length of the whole error in standard deviations: simulated filters below it kept a NEES of
their degrees of freedom to the end, and most of those beyond it did not."""
MOST_EPOCHS = 480
"""Up to which more seconds are looked at than `InitialisationOptions.duration`, where the motion is not known by then."""
BEYOND_SHARE, LARGEST_SHARE = 4 / 3, 0.8
"""Times its share of the recording, and of a recording, that an initialisation may have where filters cannot go on from less. On
the thesis' motion in noisy poses 60 % leaves moments uncertain by 0.12 to 0.3, and filters are off by up to 60 deviations; of 80 %
they are consistent."""

Make = Callable[[InitialisationOptions], InitialEstimate]
"""Makes an initialisation of a recording; nothing of landmarks after its last epoch is looked at."""


def moments_std_of(start: InitialEstimate) -> float:
    """Largest standard deviation of a principal moment after the initialisation.

    Relative to the largest moment.
    """
    return float(np.max(body_estimate(start.belief, intervals=False).principal_moments_std))


def long_enough_initialisation(
    process: ProcessModel, timeline: Timeline, make: Make, options: InitialisationOptions
) -> InitialEstimate:
    """An initialisation long enough for filters.

    The number of epochs is doubled until they can go on from it, or it has its share of the recording.

    Raises
    ------
    What ``make`` raises of the shortest start.
    """
    found = _checked(process, timeline, make, options)
    while not _is_enough(found):
        longer = _longer(options, timeline)
        if longer.count(timeline) == options.count(timeline):
            break
        options = longer
        try:
            found = _checked(process, timeline, make, options)
        except NUMERICAL_ERRORS:  # more epochs lead nowhere; the fewer did
            break
    return found


def beyond_share(
    process: ProcessModel,
    timeline: Timeline,
    make: Make,
    options: InitialisationOptions,
    found: InitialEstimate,
) -> InitialEstimate | None:
    """An initialisation of a third more epochs than its share.

    None where filters can go on from that of the share, or these determine the moments no better.

    Parameters
    ----------
    found: the long enough initialisation with these options.
    """
    count = len(timeline)
    wider = min(BEYOND_SHARE * options.share, LARGEST_SHARE)
    if len(found.mean) < round(options.share * count) or wider <= options.share or _is_enough(found):
        return None
    span = timeline[-1].time - timeline[0].time
    longer = replace(options, epochs=count, share=wider, duration=max(span, options.duration))
    try:
        beyond = _checked(process, timeline, make, longer)
    except NUMERICAL_ERRORS:
        return None
    return beyond if _is_better(beyond, found) else None


def _is_better(beyond: InitialEstimate, found: InitialEstimate) -> bool:
    """Whether filters go on better from more epochs."""
    if moments_std_of(beyond) > DETERMINED_STD:
        return False
    return moments_std_of(found) > DETERMINED_STD or beyond.departure < found.departure


def departure_of(
    process: ProcessModel, timeline: Timeline, start: InitialEstimate, later: InitialEstimate
) -> float:
    """Distance of a filter from the smoother in the smoother's standard deviations.

    The filter has no gate: it takes in what the smoother does. A gross error that the smoother refuses is no linearisation's.

    Parameters
    ----------
    later: of more epochs; the filter goes on from ``start`` to its last. Infinite where the filter fails.
    """
    first, last = len(start.mean), len(later.mean)
    ungated = MultiplicativeEkf(process, RobustOptions(gate_probability=1.0))
    ungated.start(start.belief)
    taken_in = without_refused(timeline[:last], later.refused)
    history = run(ungated, timeline[first - 1].time, taken_in[first:])
    if history.status.verdict is Verdict.FAILED:
        return np.inf
    return _length(later.belief, history.mean[-1])


def _is_enough(found: InitialEstimate) -> bool:
    return moments_std_of(found) <= DETERMINED_STD and found.departure <= LARGEST_DEPARTURE


def _longer(options: InitialisationOptions, timeline: Timeline) -> InitialisationOptions:
    """Twice the epochs, and where the seconds were the limit twice those, up to `MOST_EPOCHS`."""
    longer = replace(options, epochs=2 * options.epochs)
    if longer.count(timeline) > options.count(timeline) or options.count(timeline) >= MOST_EPOCHS:
        return longer
    return replace(longer, duration=2 * options.duration)


def _checked(
    process: ProcessModel, timeline: Timeline, make: Make, options: InitialisationOptions
) -> InitialEstimate:
    """An initialisation with the check of doubtful moments.

    A filter goes on from it where its moments would be enough and are not beyond doubt. With landmarks nothing is compared:
    which observations are believed differs between filter and smoother.
    """
    start = make(options)
    determined = is_bent(start.belief) and moments_std_of(start) <= DETERMINED_STD
    count = len(start.mean)
    if not determined or start.has_landmarks or count == len(timeline):
        return start
    span = timeline[min(2 * count, len(timeline)) - 1].time - timeline[0].time
    ahead = replace(options, epochs=2 * count, share=1.0, duration=max(span, options.duration))
    try:
        later = make(ahead)
    except NUMERICAL_ERRORS:
        return start
    return replace(start, departure=departure_of(process, timeline, start, later))


def _length(belief: Gaussian, mean: np.ndarray) -> float:
    away = belief.layout.local(belief.mean, mean)
    return float(np.sqrt(normalised_square(away[np.newaxis], belief.factor[np.newaxis])[0]))


def is_bent(belief: Gaussian) -> bool:
    """Whether a belief is wide enough for a filter's linearisation to count."""
    layout, rate = belief.layout, belief.mean[belief.layout.mean_slice(RATE.name)]
    masses, rates = (np.linalg.norm(belief.factor[layout.slice(b)], 2) for b in "sw")
    return bool(masses > LINEAR_STD or rates > LINEAR_RATE_STD * np.linalg.norm(rate))
