"""The only loop over time."""

from collections.abc import Callable

import numpy as np

from spinfilters.data.input_file import reason
from spinfilters.errors import NUMERICAL_ERRORS, InputError, numerical
from spinfilters.estimators.estimator import Estimator, UpdateReport
from spinfilters.estimators.history import EstimateHistory, GrowingHistory
from spinfilters.estimators.timeline import Epoch, Timeline, times_of
from spinfilters.models.rotation_integrator import IntegrationError
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.status import EstimatorStatus
from spinfilters.symbolic.working_time import working_seconds

REHEARSED = 3
"""Epochs of a rehearsal: the third is predicted and updated from what the second left."""

NO_EPOCH_LEFT = (
    "no epoch is left after the start; give a longer recording or a shorter start (initialisation.epochs)"
)


def run(
    estimator: Estimator,
    time: float,
    timeline: Timeline,
    on_epoch: Callable[[int], None] | None = None,
    rows: GrowingHistory | None = None,
) -> EstimateHistory:
    """Take an estimator through a timeline.

    It is started or restored at ``time`` (s); the timeline begins then or later.
    A belief or likelihood that stops being finite, or numbers that a library cannot go on with (`NUMERICAL_ERRORS`), end the run
    with the status ``failed``; what was estimated up to there is returned. Ctrl-C passes through: what part of a run is worth,
    `run_interruptible` knows.

    Parameters
    ----------
    on_epoch: called with each epoch's index after it is done; estimator and rows then belong together.
    rows: epochs done before, up to ``time``; those of the timeline are added to it.

    Raises
    ------
    InputError: when the timeline is empty and no epoch was done before, or when it does not run forwards from ``time``.
    """
    rows = GrowingHistory(estimator.layout, time) if rows is None else rows
    _check(time, timeline, rows)
    status = EstimatorStatus()
    rows.reserve(len(rows) + len(timeline))
    try:
        for index, epoch in enumerate(timeline):
            if not _taken(estimator, epoch, rows):
                where = f"epoch {len(rows)}, t = {epoch.time:.3f} s"
                status = status.failed(f"the estimate stopped being finite at {where}")
                break
            if on_epoch is not None:
                on_epoch(index)
    except IntegrationError as error:
        status = status.failed(f"the motion could not be integrated to epoch {len(rows)}: {error}")
    except np.linalg.LinAlgError as error:
        status = status.failed(f"the covariance could not be factorised at epoch {len(rows)} ({error})")
    except NUMERICAL_ERRORS as error:
        status = status.failed(f"epoch {len(rows)} could not be computed ({reason(numerical(error))})")
    return rows.ended(estimator.name, status)


def run_interruptible(
    estimator: Estimator,
    time: float,
    timeline: Timeline,
    on_epoch: Callable[[int], None],
    rows: GrowingHistory,
) -> EstimateHistory:
    """Run for a user who wants what was estimated up to Ctrl-C.

    Parameters and errors as `run`. Ctrl-C ends it as ``degraded``, with fewer epochs: its caller looks for that.
    """
    total = len(rows) + len(timeline)
    try:
        return run(estimator, time, timeline, on_epoch, rows)
    except KeyboardInterrupt:
        status = EstimatorStatus().degraded(f"interrupted after {len(rows)} of {total} epochs", "interrupted")
        return rows.ended(estimator.name, status)


def _taken(estimator: Estimator, epoch: Epoch, rows: GrowingHistory) -> bool:
    """Take in an epoch and append the belief; False where it is not finite."""
    begin = working_seconds()
    reports = advance(estimator, epoch, epoch.time - rows.time)
    belief = estimator.belief
    if not finite(belief, reports):
        return False
    rows.append(epoch.time, belief, reports, working_seconds() - begin)
    return True


def rehearse(estimator: Estimator, time: float, timeline: Timeline) -> None:
    """Take an estimator through its first epochs beforehand.

    What it computes with is built before a clock runs.
    Functions belong to layouts, sensors and process models, so that another estimator of the same ones finds them built.

    Parameters
    ----------
    estimator: started at ``time`` (s); of no use afterwards.
    """
    try:
        for epoch in timeline[:REHEARSED]:
            finite(estimator.belief, advance(estimator, epoch, epoch.time - time))
            time = epoch.time
    except np.linalg.LinAlgError:  # which its run will meet, and report
        return


def advance(estimator: Estimator, epoch: Epoch, dt: float) -> list[UpdateReport]:
    """Advance an estimator to an epoch and update it.

    ``dt`` >= 0 seconds ahead; measurements in their order.
    """
    if dt > 0:
        estimator.predict(dt)
    return estimator.update_all(epoch.measurements)


def finite(belief: Gaussian, reports: list[UpdateReport]) -> bool:
    """Whether everything that an update leaves behind is finite."""
    sums = sum(report.nis + report.log_likelihood for report in reports)
    return bool(np.isfinite(sums) and np.isfinite(belief.mean).all() and np.isfinite(belief.factor).all())


def _check(time: float, timeline: Timeline, rows: GrowingHistory) -> None:
    if not timeline and not len(rows):
        raise InputError(NO_EPOCH_LEFT)
    if rows.time != time:
        raise InputError(f"the epochs done before end at {rows.time} s; go on from there, not from {time} s")
    times = times_of(timeline)
    if len(times) and not times[0] >= time:
        raise InputError(f"the first epoch, t = {times[0]} s, lies before the belief, t = {time} s")
    bad = np.flatnonzero(~(times[1:] > times[:-1]))
    if bad.size:
        raise InputError(
            f"time goes from {times[bad[0]]} s to {times[bad[0] + 1]} s; epochs must be in the order of time"
        )
