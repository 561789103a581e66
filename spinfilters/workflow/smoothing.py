"""The smoother on a prepared data set: every frame's state given all measurements, the start's frames among them."""

from collections.abc import Callable
from dataclasses import replace
from time import perf_counter

import numpy as np

from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.landmark_start.start import LandmarkStartReport
from spinfilters.estimators.multiplicative_ekf import MultiplicativeEkf
from spinfilters.estimators.run import run
from spinfilters.estimators.smoothing.batch import BatchSmoothing, smooth_recording
from spinfilters.estimators.smoothing.problem import Trial
from spinfilters.estimators.smoothing.recursive import RecursiveSmoother
from spinfilters.estimators.smoothing.sliding_records import Taken
from spinfilters.workflow.preparation import Prepared
from spinfilters.workflow.settings import Settings

NAME = "smoother"

OnFrame = Callable[[int, int], None]
"""Called with frames done and frames in all."""


def sliding_smoother(prepared: Prepared, settings: Settings) -> RecursiveSmoother | None:
    """The smoother of tracks without a map; None for sensors that tie nothing together, see `smooth_at_once`."""
    timeline = prepared.timeline
    if not isinstance(prepared.start, LandmarkStartReport):
        return None
    every = (measurement.model for frame in timeline for measurement in frame.measurements)
    options = settings.smoother.options(len(timeline))
    return RecursiveSmoother(prepared.process, options, tuple(dict.fromkeys(every)))


def begin_at_start(smoother: RecursiveSmoother, prepared: Prepared) -> list[Taken]:
    """Take in the frames of the start with what it found."""
    assert isinstance(prepared.start, LandmarkStartReport)
    start, found = prepared.start, prepared.start.landmarks
    first = Trial(start.frames.mean, found.ids, found.points)
    return smoother.begin(start.prior, prepared.timeline[: len(first.trajectory)], first)


def smoothed_history(
    smoother: RecursiveSmoother, passed: EstimateHistory, prepared: Prepared
) -> EstimateHistory:
    """Every frame given all measurements, with what each frame was worth when it came (``passed``, without the start's)."""
    first = len(prepared.start.frames.mean)
    rows, status = smoother.smoothed()[: first + len(passed.time)], passed.status
    for doubt in smoother.sliding.undetermined():
        status = status.degraded(doubt)
    factor = np.array([row.factor for row in rows])
    if not np.isfinite(factor).all():
        status = status.failed("; ".join(status.reasons) or "some directions are not determined")
    used = [sum(len(m.values) for m in frame.measurements) for frame in prepared.timeline[:first]]
    nothing = np.zeros(len(rows))
    before = np.zeros(first)
    return EstimateHistory(
        name=NAME,
        layout=prepared.process.layout,
        time=np.array([frame.time for frame in prepared.timeline[: len(rows)]]),
        mean=np.array([row.mean for row in rows]),
        factor=factor,
        nis=nothing,
        dof=nothing.astype(int),
        log_likelihood=nothing,
        accepted=np.concatenate([np.array(used), passed.accepted]).astype(int),
        rejected=np.concatenate([before, passed.rejected]).astype(int),
        runtime=np.concatenate([before, passed.runtime]),
        status=status,
    )


def smooth_at_once(prepared: Prepared, settings: Settings, on_frame: OnFrame) -> EstimateHistory:
    """All at once, from where the filter of first order passes."""
    start, timeline = prepared.start, prepared.timeline
    first = len(start.frames.mean)
    begin = perf_counter()
    ekf = MultiplicativeEkf(prepared.process, settings.robust)
    ekf.start(start.belief)
    passed = run(ekf, prepared.start_end, timeline[first:], lambda k: on_frame(k + 1, len(timeline) - first))
    trajectory = np.concatenate([start.frames.mean, passed.mean])
    frames = timeline[: len(trajectory)]
    found = smooth_recording(
        prepared.process, frames, trajectory, start.prior, settings.smoother.robust_kernel
    )
    share = (perf_counter() - begin) / len(frames)
    return _batch_history(found, passed, (np.array([frame.time for frame in frames]), share))


def _batch_history(
    found: BatchSmoothing, passed: EstimateHistory, clock: tuple[np.ndarray, float]
) -> EstimateHistory:
    """Of the smoothed frames; a filter that did not come through says so for the smoother too."""
    time, share = clock
    status, count = passed.status, len(time)
    for doubt in found.undetermined:
        status = status.degraded(doubt)
    if not np.isfinite(found.factor).all():
        status = status.failed("some directions are not determined")
    nothing = np.zeros(count)
    return replace(
        passed,
        name=NAME,
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
