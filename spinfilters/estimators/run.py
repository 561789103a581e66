"""The only loop over time."""

from collections.abc import Callable
from itertools import pairwise
from time import perf_counter

import numpy as np

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import Estimator, UpdateReport
from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.timeline import Frame, Timeline
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.status import EstimatorStatus


def run(
    estimator: Estimator,
    belief: Gaussian,
    time: float,
    timeline: Timeline,
    on_frame: Callable[[int], None] | None = None,
) -> EstimateHistory:
    """Start an estimator from a belief at ``time`` (s) and take it through a timeline that begins then or later.

    A belief that stops being finite ends the run with the status ``failed``; Ctrl-C ends it as ``degraded``. Either way what
    was estimated up to there is returned.

    Parameters
    ----------
    on_frame: called with each frame's index after it is done.

    Raises
    ------
    InputError: when the timeline is empty, or does not run forwards from ``time``.
    """
    _check(time, timeline)
    rows: list[tuple[Gaussian, list[UpdateReport], float]] = []
    status = EstimatorStatus()
    try:
        estimator.start(belief)
        for index, frame in enumerate(timeline):
            before = timeline[index - 1].time if index else time
            begin = perf_counter()
            reports = _advance(estimator, frame, frame.time - before)
            rows.append((estimator.belief, reports, perf_counter() - begin))
            if not _finite(rows[-1][0]):
                rows.pop()
                status = status.failed(
                    f"the estimate stopped being finite at frame {index}, t = {frame.time:.3f} s"
                )
                break
            if on_frame is not None:
                on_frame(index)
    except np.linalg.LinAlgError as error:
        status = status.failed(f"the covariance could not be factorised at frame {len(rows)} ({error})")
    except KeyboardInterrupt:
        status = status.degraded(f"interrupted after {len(rows)} of {len(timeline)} frames")
    return _history(estimator, timeline, rows, status)


def _check(time: float, timeline: Timeline) -> None:
    if not timeline:
        raise InputError(
            "no frame is left after the start; give a longer recording or a shorter start (start.frames)"
        )
    if timeline[0].time < time:
        raise InputError(f"the first frame, t = {timeline[0].time} s, lies before the belief, t = {time} s")
    for before, after in pairwise(timeline):
        if not after.time > before.time:
            raise InputError(
                f"time goes from {before.time} s to {after.time} s; frames must be in the order of time"
            )


def _advance(estimator: Estimator, frame: Frame, dt: float) -> list[UpdateReport]:
    if dt > 0:
        estimator.predict(dt)
    return [estimator.update(measurement) for measurement in frame.measurements]


def _finite(belief: Gaussian) -> bool:
    return bool(np.isfinite(belief.mean).all() and np.isfinite(belief.factor).all())


def _history(
    estimator: Estimator,
    timeline: Timeline,
    rows: list[tuple[Gaussian, list[UpdateReport], float]],
    status: EstimatorStatus,
) -> EstimateHistory:
    n, m = estimator.layout.error_dim, estimator.layout.mean_dim
    reports = [report for _, report, _ in rows]
    return EstimateHistory(
        name=estimator.name,
        layout=estimator.layout,
        time=np.array([frame.time for frame in timeline[: len(rows)]]),
        mean=np.array([belief.mean for belief, _, _ in rows]).reshape(-1, m),
        factor=np.array([belief.factor for belief, _, _ in rows]).reshape(-1, n, n),
        nis=np.array([sum(r.nis for r in report) for report in reports], dtype=float),
        dof=np.array([sum(r.dof for r in report) for report in reports], dtype=int),
        log_likelihood=np.array([sum(r.log_likelihood for r in report) for report in reports], dtype=float),
        accepted=np.array([sum(r.accepted for r in report) for report in reports], dtype=int),
        rejected=np.array([sum(r.rejected for r in report) for report in reports], dtype=int),
        runtime=np.array([seconds for _, _, seconds in rows], dtype=float),
        status=status,
    )
