"""The smoother on a prepared data set: every frame's state given all measurements, the start's frames among them."""

from collections.abc import Callable
from contextlib import suppress

import numpy as np
from jaxtyping import Float, Int

from spinfilters.errors import NUMERICAL_ERRORS, InputError
from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.initialisation.initial_guess import trial_trajectory
from spinfilters.estimators.multiplicative_ekf import MultiplicativeEkf
from spinfilters.estimators.run import rehearse, run
from spinfilters.estimators.smoothing.batch import BatchSmoothing, smooth_recording
from spinfilters.estimators.smoothing.problem import Trial
from spinfilters.estimators.smoothing.recursive import RecursiveSmoother
from spinfilters.estimators.smoothing.sliding_records import Taken
from spinfilters.estimators.timeline import times_of
from spinfilters.state.layout import StateLayout
from spinfilters.state.status import EstimatorStatus, Verdict
from spinfilters.symbolic import working_seconds
from spinfilters.workflow.measured_motion import measured_motion
from spinfilters.workflow.preparation import Prepared
from spinfilters.workflow.settings import Settings

NAME = "smoother"
NO_FILTER = (
    "the filter that the smoother sets out from failed: it began from what the measurements say directly"
)
ANNEALED_ITERATIONS = 30
"""At most, from a trajectory that no filter has made."""

OnFrame = Callable[[int, int], None]
"""Called with frames done and frames in all."""


def sliding_smoother(prepared: Prepared, settings: Settings) -> RecursiveSmoother:
    """The smoother of tracks without a map; for sensors that tie nothing together see `smooth_at_once`."""
    timeline = prepared.timeline
    every = (measurement.model for frame in timeline for measurement in frame.measurements)
    options = settings.smoother.options(len(timeline))
    return RecursiveSmoother(prepared.process, options, tuple(dict.fromkeys(every)))


def begin_at_start(smoother: RecursiveSmoother, prepared: Prepared) -> list[Taken]:
    """Take in the frames of the start with what it found."""
    start = prepared.start
    first = Trial(start.mean, start.ids, start.points)
    return smoother.begin(start.prior, prepared.timeline[: len(first.trajectory)], first)


def smoothed_history(
    smoother: RecursiveSmoother, passed: EstimateHistory, prepared: Prepared
) -> EstimateHistory:
    """Every epoch given all measurements; ``passed`` are those behind the initialisation, as they came."""
    first = len(prepared.start.mean)
    rows, status = smoother.smoothed()[: first + len(passed.time)], passed.status
    for doubt in smoother.sliding.undetermined():
        status = status.degraded(doubt)
    factor = np.array([row.factor for row in rows])
    if not np.isfinite(factor).all():
        status = status.failed("; ".join(status.reasons) or "some directions are not determined")
    accepted, rejected = _counts(smoother, passed)
    nothing = np.zeros(len(rows))
    return EstimateHistory(
        name=NAME,
        layout=prepared.process.layout,
        time=np.array([frame.time for frame in prepared.timeline[: len(rows)]]),
        mean=np.array([row.mean for row in rows]),
        factor=factor,
        nis=nothing,
        dof=nothing.astype(int),
        log_likelihood=nothing,
        accepted=accepted,
        rejected=rejected,
        runtime=np.concatenate([np.zeros(first), passed.runtime]),
        status=status,
    )


def _counts(
    smoother: RecursiveSmoother, passed: EstimateHistory
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Observations of every epoch that count in the end and that do not; where epochs have left, as they were when they came."""
    first = np.array([(taken.accepted, taken.rejected) for taken in smoother.begun]).reshape(-1, 2)
    came = np.concatenate([first, np.stack([passed.accepted, passed.rejected], axis=1)])
    counts = smoother.sliding.counts()
    accepted, rejected = (came if counts is None else counts[: len(came)]).T
    return accepted.astype(int), rejected.astype(int)


def smooth_at_once(prepared: Prepared, settings: Settings, on_frame: OnFrame) -> EstimateHistory:
    """All at once, from where the filter of first order passes."""
    start, timeline = prepared.start, prepared.timeline
    first = len(start.mean)
    _rehearse_at_once(prepared, settings)
    begin = working_seconds()
    ekf = _started_ekf(prepared, settings)
    passed = run(ekf, prepared.start_end, timeline[first:], lambda k: on_frame(k + 1, len(timeline) - first))
    trajectory, status = np.concatenate([start.mean, passed.mean]), passed.status
    del passed  # its covariances are as large as those to come
    annealed = 0
    if status.verdict is Verdict.FAILED:
        with suppress(InputError, *NUMERICAL_ERRORS):
            trajectory = _measured_trajectory(prepared)
            annealed, status = ANNEALED_ITERATIONS, EstimatorStatus().degraded(NO_FILTER)
    frames = timeline[: len(trajectory)]
    found = smooth_recording(
        prepared.process, frames, trajectory, start.prior, settings.smoother.robust_kernel, annealed
    )
    if not found.solved.converged:
        status = status.degraded(f"the smoother did not settle in {found.solved.iterations} iterations")
    share = (working_seconds() - begin) / len(frames)
    return _batch_history(found, prepared.process.layout, status, (times_of(frames), share))


def _measured_trajectory(prepared: Prepared) -> Float[np.ndarray, "k m"]:
    """States that the measurements say directly, for a recording that no filter comes through."""
    layout, frames = prepared.process.layout, prepared.timeline
    return trial_trajectory(layout, frames, prepared.start.mean[-1], measured_motion(prepared))


def _rehearse_at_once(prepared: Prepared, settings: Settings) -> None:
    """What the frames of the start need to be smoothed, built before the clock runs."""
    start, timeline = prepared.start, prepared.timeline
    trajectory = start.mean
    rehearse(_started_ekf(prepared, settings), prepared.start_end, timeline[len(trajectory) :])
    with suppress(np.linalg.LinAlgError):
        kernel = settings.smoother.robust_kernel
        smooth_recording(prepared.process, timeline[: len(trajectory)], trajectory, start.prior, kernel)


def _started_ekf(prepared: Prepared, settings: Settings) -> MultiplicativeEkf:
    ekf = MultiplicativeEkf(prepared.process, settings.robust)
    ekf.start(prepared.start.belief)
    return ekf


def _batch_history(
    found: BatchSmoothing, layout: StateLayout, status: EstimatorStatus, clock: tuple[np.ndarray, float]
) -> EstimateHistory:
    """Of the smoothed frames; a filter that did not come through says so, in its status, for the smoother too."""
    time, share = clock
    count = len(time)
    for doubt in found.undetermined:
        status = status.degraded(doubt)
    if not np.isfinite(found.factor).all():
        status = status.failed("some directions are not determined")
    nothing = np.zeros(count)
    return EstimateHistory(
        name=NAME,
        layout=layout,
        time=time,
        mean=found.mean,
        factor=found.factor,
        nis=nothing,
        dof=nothing.astype(int),
        log_likelihood=nothing,
        accepted=found.accepted,
        rejected=found.rejected,
        runtime=np.full(count, share),
        status=status,
    )
