"""The executive: the filter answers every epoch at once, the smoother puts it on a better past when it is ready.

Nothing is counted twice. A hand-over of time T holds all measurements up to T; the filter goes back to T, takes that state, and
does the epochs after T again. A smoother that begins anew takes the filter's belief of T as its prior and measurements after T.
"""

import gc
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.errors import NUMERICAL_ERRORS, InputError
from spinfilters.estimators.estimator import Estimator, Measurement, ProcessModel, UpdateReport
from spinfilters.estimators.filters.belief_prediction import predict_ahead
from spinfilters.estimators.filters.multiplicative_filter import MultiplicativeFilter
from spinfilters.estimators.landmarks.landmark_map import LandmarkOptions
from spinfilters.estimators.run import rehearse
from spinfilters.estimators.smoothing.window.recursive_smoother import RecursiveSmoother
from spinfilters.estimators.smoothing.window.smoother_records import SmootherOptions
from spinfilters.estimators.timeline import Epoch, Timeline
from spinfilters.live.answer import Answer
from spinfilters.live.filter_track import FilterTrack
from spinfilters.live.line_format import ArrivedEpoch
from spinfilters.live.rebase import HandOver, distance, rebase
from spinfilters.live.smoother_worker import Build, SmootherTask
from spinfilters.live.summary import LiveSummary
from spinfilters.live.supervisor import SmootherSupervisor, SupervisionOptions
from spinfilters.models.measurement import MeasurementModel
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.status import Verdict

FAR = 4.0
"""Squared distance per component between hand-over and filter, both covariances added, above which the smoother has diverged."""
REFUSALS = 3
"""Hand-overs in a row that are refused, after which the smoother begins anew from the filter."""
JUMPS = 3
"""Epochs in a row beyond the largest gap, after which the gap is believed."""

REHEARSED_DOUBLINGS = 7
"""Of the interval: gaps of up to 64 epochs are as quick as any."""

Bind = Callable[[MeasurementStream], Measurement]
"""What makes a measurement of one sensor's rows of an epoch."""


@dataclass(frozen=True)
class LiveOptions:
    """How a live run goes.

    Attributes
    ----------
    deadline: s from an epoch's arrival to its answer.   ahead: s that every answer is predicted ahead, 0 for none.
    history: epochs that a hand-over or a late measurement may be old.   largest_gap: s between epochs that is believed at once.
    smoother: whether there is one.   landmarks: how those that the smoother hands over are held.
    memory: bytes of the smoother's address space, 0 for no limit.
    """

    deadline: float = 0.02
    ahead: float = 0.0
    history: int = 100
    largest_gap: float = 60.0
    smoother: bool = True
    supervision: SupervisionOptions = field(default_factory=SupervisionOptions)
    sliding: SmootherOptions = field(default_factory=SmootherOptions)
    landmarks: LandmarkOptions = field(default_factory=LandmarkOptions)
    memory: int = 0


@dataclass(frozen=True)
class LiveSetup:
    """What a live run begins from.

    Attributes
    ----------
    filter: started at ``time`` (s).   models: by sensor.   bind: rows to a measurement.
    first_smoother: the smoother of the initialisation, begun, and its own time then; None to begin from the filter.
    rehearsal: epochs after the initialisation, where the data set has some.
    """

    process: ProcessModel
    filter: Estimator
    time: float
    models: dict[str, MeasurementModel]
    bind: Bind
    first_smoother: tuple[Build, float] | None = None
    rehearsal: Timeline = ()


class Executive:
    """A live run.

    Attributes
    ----------
    track: the filter.   supervisor: the smoother's process.   summary: what is counted.
    """

    def __init__(self, setup: LiveSetup, options: LiveOptions) -> None:
        self._setup, self._options = setup, options
        self.track = FilterTrack(setup.filter, setup.time, options.history)
        self.supervisor = SmootherSupervisor(setup.process.layout, setup.models, options.supervision)
        self.summary = LiveSummary(options.deadline)
        self._refused = self._jumps = 0
        self._waiting: HandOver | None = None
        self._stands_on_smoother = False
        self._intervals: list[float] = []

    def rehearse(self, epochs: Timeline) -> None:
        """Build what answers are computed with, before a clock runs; the filter is left as it was."""
        estimator = self.track.estimator
        before = estimator.snapshot()
        rehearse(estimator, self.track.time, epochs)
        if self._options.ahead > 0:
            predict_ahead(self._setup.process, estimator.belief, np.array([self._options.ahead]))
        if len(epochs):
            self._rehearse_gaps(epochs[0].time - self.track.time)
        estimator.restore(before)
        gc.collect()
        gc.freeze()  # what has been built stays: a collection that looks through it takes longer than an answer

    def _rehearse_gaps(self, interval: float) -> None:
        """Steps across gaps: more substeps are another function, which must not be built when a gap ends."""
        steps = interval * 2.0 ** np.arange(REHEARSED_DOUBLINGS)
        for step in steps[(steps > 0) & (steps <= self._options.largest_gap)].tolist():
            try:
                self._setup.process.linearise(self.track.belief.mean, step)
            except NUMERICAL_ERRORS:
                return

    def run(self, epochs: Iterator[ArrivedEpoch | None]) -> Iterator[Answer]:
        """Answers in the order of arrival; the smoother is served between them, and its process ended in the end."""
        try:
            self.rehearse(self._setup.rehearsal)
            self._begin_smoother(first=True)
            for arrived in epochs:
                if arrived is not None:
                    yield from self._answers(arrived)
                self.serve()
        finally:
            self.supervisor.close()
            self.summary.events.update(self.supervisor.events)

    def serve(self) -> None:
        """Take in the latest hand-over, one epoch of it at a time, and see that there is a smoother."""
        if not self._options.smoother:
            return
        found = self.supervisor.hand_overs()
        self._waiting = found[-1] if found else self._waiting
        if self.track.is_rebasing:
            if self.track.rebase_step():
                self.summary.events["hand-over"] += 1
                self._stands_on_smoother = True
        elif self._waiting is not None:
            given, self._waiting = self._waiting, None
            self._take_over(given)
        if self.supervisor.may_begin:
            self._begin_smoother(first=False)

    def _answers(self, arrived: ArrivedEpoch) -> Iterator[Answer]:
        """The answer to an epoch, where it has one; what the smoother needs of it comes after that."""
        loss = self._loss(arrived.time)
        if loss is not None:
            self.summary.events[loss] += 1
            return
        began = time.thread_time()
        newest = arrived.time > self.track.time
        gap = arrived.time - self.track.time
        frame = self._frame(arrived)
        reports = self.track.take(frame)
        if reports is None:
            self.summary.events["epoch left out, not finite"] += 1
        if not newest:
            self.summary.events["late, put in its place"] += 1
            return
        self._count_gap(gap)
        answer = self._said(arrived, reports or [], len(frame.measurements))
        self.summary.latencies.append(answer.latency)
        self.summary.work.append(time.thread_time() - began)
        yield answer
        if reports is not None:
            self.supervisor.send(frame)

    def _loss(self, instant: float) -> str | None:
        """Why an epoch is not taken, None where it is."""
        if self.track.has(instant):
            return "epoch twice"
        if instant < self.track.oldest:
            return "too late"
        if instant - self.track.time > self._options.largest_gap and self._jumps + 1 < JUMPS:
            self._jumps += 1
            return "jump of time"
        self._jumps = 0
        return None

    def _frame(self, arrived: ArrivedEpoch) -> Epoch:
        measurements = []
        for stream in arrived.streams:
            try:
                measurements.append(self._setup.bind(stream))
            except InputError:
                self.summary.events["unusable"] += 1
        return Epoch(arrived.time, tuple(measurements))

    def _said(self, arrived: ArrivedEpoch, reports: list[UpdateReport], count: int) -> Answer:
        instant, belief, process = arrived.time, self.track.belief, self._setup.process
        status = self.track.estimator.status
        if self._options.smoother and self.supervisor.trouble:
            status = status.degraded(f"the filter goes on without the smoother: {self.supervisor.trouble}")
        if count and not sum(report.accepted for report in reports):
            status = status.degraded("no measurement of this epoch was used")
        if instant > self.track.time:  # the epoch broke the filter: what it said before, carried on
            status = status.degraded("this epoch would have made the estimate infinite and was left out")
            belief = self._carried(instant - self.track.time) or belief
        ahead = None
        if self._options.ahead > 0:
            there = predict_ahead(process, belief, np.array([self._options.ahead])).belief(0)
            ahead = (instant + self._options.ahead, there)
        source = "smoother" if self._stands_on_smoother else "filter"
        used, left = sum(r.accepted for r in reports), sum(r.rejected for r in reports)
        return Answer(instant, belief, status, source, used, left, time.monotonic() - arrived.at, ahead)

    def _carried(self, seconds: float) -> Gaussian | None:
        try:
            return predict_ahead(self._setup.process, self.track.belief, np.array([seconds])).belief(0)
        except (*NUMERICAL_ERRORS, InputError):
            return None

    def _take_over(self, given: HandOver) -> None:
        """Put the filter on the smoothed past, or refuse that."""
        events = self.summary.events
        if not self.track.has(given.time):
            events["hand-over too old"] += 1
            self.supervisor.end("smoother too slow", "it is further behind than the filter can go back")
            return
        if given.verdict == Verdict.DEGRADED:  # it says itself that it is not to be relied upon yet
            events["hand-over not settled yet"] += 1
            return
        why = self._doubt(given)
        if why is not None:
            events[f"hand-over refused, {why}"] += 1
            self._refused += 1
            if self._refused >= REFUSALS:
                self._refused = 0
                self.supervisor.end("smoother diverged", f"its results were refused: {why}")
            return
        self._refused = 0
        try:
            self.track.begin_rebase(given.time, lambda filter_: rebase(filter_, given))
        except (*NUMERICAL_ERRORS, InputError):
            events["hand-over refused, the filter cannot begin from it"] += 1

    def _doubt(self, given: HandOver) -> str | None:
        if not given.is_finite:
            return "not finite"
        if given.verdict != Verdict.OK:
            return "failed"
        try:
            far = distance(self.track.belief_at(given.time), given.state)
        except NUMERICAL_ERRORS:
            return "not comparable"
        return None if far <= FAR else "far from the filter"

    def _begin_smoother(self, first: bool) -> None:
        if not self._options.smoother:
            return
        begun = self._setup.first_smoother
        if first and begun is not None:
            self.supervisor.begin(self._task(begun[0], begun[1], self._setup.time))
            return
        belief, setup, options = self.track.belief, self._setup, self._options.sliding

        def build() -> RecursiveSmoother:
            smoother = RecursiveSmoother(setup.process, options)
            smoother.start(belief)
            return smoother

        self._waiting, self._stands_on_smoother = None, False
        self.supervisor.begin(self._task(build, 0.0, self.track.time))

    def _task(self, build: Build, own_time: float, instant: float) -> SmootherTask:
        """With as many modes as the filter has, so that it goes on with what it computes with already."""
        filter_, landmarks = self.track.estimator, self._options.landmarks
        if isinstance(filter_, MultiplicativeFilter) and filter_.mode_count:
            landmarks = replace(landmarks, modes=filter_.mode_count, explained=0.0)
        return SmootherTask(build, own_time, instant, landmarks, self._options.memory)

    def _count_gap(self, gap: float) -> None:
        """A gap is what is longer than three usual intervals."""
        usual = float(np.median(self._intervals[-50:])) if len(self._intervals) >= 5 else np.inf
        if gap > 3 * usual:
            self.summary.events["gap"] += 1
        self._intervals.append(gap)
        del self._intervals[:-50]
