"""The only loop over time."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from spinfilters.errors import NUMERICAL_ERRORS, InputError
from spinfilters.estimators.estimator import Estimator, UpdateReport
from spinfilters.estimators.history import EstimateHistory, GrowingHistory
from spinfilters.estimators.timeline import Frame, Timeline
from spinfilters.logs.input_file import reason
from spinfilters.models.rotation_steps import IntegrationError
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.status import EstimatorStatus
from spinfilters.symbolic import working_seconds

REHEARSED = 3
"""Frames of a rehearsal: the third is predicted and updated from what the second left."""

NO_FRAME_LEFT = "no frame is left after the start; give a longer recording or a shorter start (start.frames)"


def run(
    estimator: Estimator,
    time: float,
    timeline: Timeline,
    on_frame: Callable[[int], None] | None = None,
    rows: GrowingHistory | None = None,
) -> EstimateHistory:
    """Take an estimator, started or restored at ``time`` (s), through a timeline that begins then or later.

    A belief or likelihood that stops being finite, or numbers that a library cannot go on with (`NUMERICAL_ERRORS`), end the run
    with the status ``failed``; Ctrl-C ends it as ``degraded``.
    Either way what was estimated up to there is returned.

    Parameters
    ----------
    on_frame: called with each frame's index after it is done; estimator and rows then belong together.
    rows: frames done before, up to ``time``; those of the timeline are added to it.

    Raises
    ------
    InputError: when the timeline is empty and no frame was done before, or when it does not run forwards from ``time``.
    """
    rows = GrowingHistory(estimator.layout, time) if rows is None else rows
    _check(time, timeline, rows)
    total, status = len(rows) + len(timeline), EstimatorStatus()
    rows.reserve(total)
    try:
        for index, frame in enumerate(timeline):
            begin = working_seconds()
            reports = advance(estimator, frame, frame.time - rows.time)
            belief = estimator.belief
            if not finite(belief, reports):
                where = f"frame {len(rows)}, t = {frame.time:.3f} s"
                status = status.failed(f"the estimate stopped being finite at {where}")
                break
            rows.append(frame.time, belief, reports, working_seconds() - begin)
            if on_frame is not None:
                on_frame(index)
    except IntegrationError as error:
        status = status.failed(f"the motion could not be integrated to frame {len(rows)}: {error}")
    except np.linalg.LinAlgError as error:
        status = status.failed(f"the covariance could not be factorised at frame {len(rows)} ({error})")
    except NUMERICAL_ERRORS as error:
        status = status.failed(f"frame {len(rows)} could not be computed ({reason(error)})")
    except KeyboardInterrupt:
        status = status.degraded(f"interrupted after {len(rows)} of {total} frames")
    return rows.ended(estimator.name, status)


def rehearse(estimator: Estimator, time: float, timeline: Timeline) -> None:
    """Take an estimator through its first frames for what it computes with to be built before a clock runs.

    Functions belong to layouts, sensors and process models, so that another estimator of the same ones finds them built.

    Parameters
    ----------
    estimator: started at ``time`` (s); of no use afterwards.
    """
    try:
        for frame in timeline[:REHEARSED]:
            finite(estimator.belief, advance(estimator, frame, frame.time - time))
            time = frame.time
    except np.linalg.LinAlgError:  # which its run will meet, and report
        return


def advance(estimator: Estimator, frame: Frame, dt: float) -> list[UpdateReport]:
    """Move an estimator ``dt`` >= 0 seconds ahead to a frame and take in its measurements, in their order."""
    if dt > 0:
        estimator.predict(dt)
    return estimator.update_all(frame.measurements)


def finite(belief: Gaussian, reports: list[UpdateReport]) -> bool:
    """Whether everything that an update leaves behind is finite."""
    sums = sum(report.nis + report.log_likelihood for report in reports)
    return bool(np.isfinite(sums) and np.isfinite(belief.mean).all() and np.isfinite(belief.factor).all())


def _check(time: float, timeline: Timeline, rows: GrowingHistory) -> None:
    if not timeline and not len(rows):
        raise InputError(NO_FRAME_LEFT)
    if rows.time != time:
        raise InputError(f"the frames done before end at {rows.time} s; go on from there, not from {time} s")
    if timeline and not timeline[0].time >= time:
        raise InputError(f"the first frame, t = {timeline[0].time} s, lies before the belief, t = {time} s")
    for before, after in pairwise(timeline):
        if not after.time > before.time:
            raise InputError(
                f"time goes from {before.time} s to {after.time} s; frames must be in the order of time"
            )
