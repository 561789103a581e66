"""The smoother on a prepared data set: every frame's state given all measurements, the start's frames among them."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.landmark_start.start import LandmarkStartReport
from spinfilters.estimators.multiplicative_ekf import MultiplicativeEkf
from spinfilters.estimators.run import run
from spinfilters.estimators.smoothing.batch import BatchSmoothing, smooth_recording
from spinfilters.estimators.smoothing.sliding import Retired, SlidingSmoother, Taken
from spinfilters.state.status import EstimatorStatus
from spinfilters.workflow.preparation import Prepared
from spinfilters.workflow.settings import Settings

NAME = "smoother"

OnFrame = Callable[[int, int], None]
"""Called with frames done and frames in all."""


@dataclass(frozen=True)
class Smoothed:
    """History of a smoother, and the landmarks (k, 3) m in g that it ended with, if it held any."""

    history: EstimateHistory
    points: Float[np.ndarray, "k 3"] | None


@dataclass
class _Progress:
    """Frames so far: what each took in and how long it took, and states that are final."""

    taken: list[Taken] = field(default_factory=list)
    runtime: list[float] = field(default_factory=list)
    final: list[Retired] = field(default_factory=list)


def run_smoother(prepared: Prepared, settings: Settings, on_frame: OnFrame) -> Smoothed:
    """Smooth; Ctrl-C keeps the frames that are done."""
    if isinstance(prepared.start, LandmarkStartReport):
        return _slide(prepared, prepared.start, settings, on_frame)
    return Smoothed(_batch(prepared, settings, on_frame), None)


def _slide(prepared: Prepared, start: LandmarkStartReport, settings: Settings, on_frame: OnFrame) -> Smoothed:
    """Frame after frame, from the frames of the start on."""
    timeline, first = prepared.timeline, len(start.frames.mean)
    options = settings.smoother.options(len(timeline))
    smoother = SlidingSmoother(prepared.process, start.prior, options, tied=True)
    done, status = _Progress(), EstimatorStatus()
    begin = perf_counter()
    landmarks = start.landmarks
    done.taken += smoother.begin(timeline[:first], start.frames.mean, landmarks.ids, landmarks.points)
    done.runtime += [0.0] * (first - 1) + [perf_counter() - begin]
    try:
        for frame in timeline[first:]:
            begin = perf_counter()
            taken = smoother.add(frame)
            done.taken.append(taken)
            done.final += taken.retired
            done.runtime.append(perf_counter() - begin)
            on_frame(len(done.taken) - first, len(timeline) - first)
    except KeyboardInterrupt:
        status = status.degraded(f"interrupted after {len(done.taken)} of {len(timeline)} frames")
    rows = [*done.final, *smoother.smoothed()]
    for doubt in smoother.undetermined():
        status = status.degraded(doubt)
    return Smoothed(_history(prepared, rows, done, status), smoother.window.points)


def _history(
    prepared: Prepared, rows: list[Retired], done: _Progress, status: EstimatorStatus
) -> EstimateHistory:
    """As many frames as were taken in whole."""
    count = min(len(rows), len(done.runtime))
    factor = np.array([row.factor for row in rows[:count]])
    if not np.isfinite(factor).all():
        status = status.failed("some directions are not determined: " + "; ".join(status.reasons))
    nothing = np.zeros(count)
    return EstimateHistory(
        name=NAME,
        layout=prepared.process.layout,
        time=np.array([row.time for row in rows[:count]]),
        mean=np.array([row.mean for row in rows[:count]]),
        factor=factor,
        nis=nothing,
        dof=nothing.astype(int),
        log_likelihood=nothing,
        accepted=np.array([taken.accepted for taken in done.taken[:count]]),
        rejected=np.array([taken.rejected for taken in done.taken[:count]]),
        runtime=np.array(done.runtime[:count]),
        status=status,
    )


def _batch(prepared: Prepared, settings: Settings, on_frame: OnFrame) -> EstimateHistory:
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
