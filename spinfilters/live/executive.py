"""Live run: a filter answers every epoch, a smoother corrects its past.

Nothing is counted twice. A hand-over of time T holds all measurements up to T; the filter goes back to T, takes that state, and
does the epochs after T again. A smoother that begins anew takes the filter's belief of T as its prior and measurements after T.
"""

import gc
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from spinfilters.core.chi_square import chi_square_tail
from spinfilters.core.errors import NUMERICAL_ERRORS, InputError
from spinfilters.evaluation.filter_noise_tests import (
    EpochTester,
    FilterEpoch,
    NoiseTest,
    no_sums,
    summed_tests,
)
from spinfilters.filters.estimator import ProcessModel, UpdateReport
from spinfilters.filters.measurement_prediction import predict_ahead
from spinfilters.filters.timeline import Epoch, Timeline, rehearse
from spinfilters.io.disturbances import NAMES
from spinfilters.live.answer import Answer, LiveSummary
from spinfilters.live.filter_track import FilterTrack, HandOver, distance
from spinfilters.live.live_options import LiveOptions, LiveSetup
from spinfilters.live.smoother_process import Build, SmootherSupervisor, SmootherTask
from spinfilters.live.sources import ArrivedEpoch
from spinfilters.models.state_layout import Gaussian
from spinfilters.models.status import Verdict
from spinfilters.smoother.recursive_smoother import RecursiveSmoother
from spinfilters.verdict.checks import LARGEST_NIS, LARGEST_REJECTED
from spinfilters.verdict.filter_diagnostics import LARGEST_RATIO

WINDOW = 60
"""Measured epochs that are tested together, in addition to all since the filter was last trusted."""
FALSE_ALARM = 1e-9
"""Probability of a test's sum where all is well: it is looked at after every epoch of a run without an end."""


@dataclass(frozen=True)
class _Counts:
    """Counts of one or several epochs.

    NIS and its degrees of freedom, measurements left out, all of them.
    """

    nis: float
    dof: float
    left_out: int
    measured: int


class RunningVerdict:
    """Doubts about a filter that answers.

    Measurements that are left out do no harm once they are over. Innovations that the noise does not explain have changed the
    estimate, its constants too: that doubt stays until the filter continues a hand-over of the smoother that never was in doubt.

    Parameters
    ----------
    process : ProcessModel
        With the noise that the filter assumes.
    """

    def __init__(self, process: ProcessModel) -> None:
        self._process, self._tester = process, EpochTester(process)
        self._counts: deque[_Counts] = deque(maxlen=WINDOW)
        self._sums: deque[Float[np.ndarray, "t 4"]] = deque(maxlen=WINDOW)
        self._all = no_sums()
        self._lasting, self._passing = "", ""
        self._last_bad = -np.inf

    @property
    def reasons(self) -> list[str]:
        """Why the present estimate is in doubt."""
        return [reason for reason in (self._lasting, self._passing) if reason]

    @property
    def is_believed(self) -> bool:
        """Whether no doubt about the filter's own past remains."""
        return not self._lasting

    def take(self, epoch: FilterEpoch, reports: Sequence[UpdateReport], time: float) -> None:
        """Test an epoch (time s) with measurements."""
        self._counts.append(_counts(epoch, reports))
        with np.errstate(all="ignore"):
            try:
                sums = self._tester.take(epoch)
            except NUMERICAL_ERRORS:
                self._doubt("the filter's covariance could not be tested", time)
                return
        self._sums.append(sums)
        self._all += sums
        self._passing = _left_out(self._counts)
        found = _innovations(self._counts) or _noise(np.sum(self._sums, axis=0), len(self._sums))
        if found:
            self._doubt(found, time)
        elif not self._lasting and (slow := _noise(self._all, 0)):
            self._doubt(slow, time)

    def rebased(self, time: float, is_believed: bool) -> None:
        """Restart the tests after a rebase of the filter.

        The filter now begins from a time (s), by a smoother that is believed or not.
        """
        self._tester = EpochTester(self._process)
        if self._lasting and is_believed and time > self._last_bad:
            self._lasting, self._all = "", np.zeros_like(self._all)
            self._sums.clear()
            self._counts.clear()

    def _doubt(self, why: str, time: float) -> None:
        self._last_bad = time
        if not self._lasting:
            self._lasting = f"from t = {time:.3f} s on: {why}"


def _counts(epoch: FilterEpoch, reports: Sequence[UpdateReport]) -> _Counts:
    """Counts of an epoch's update.

    Landmarks that were made anew because they were not where the map had them count as left out.
    """
    anew = sum(
        int(np.isin(report.map_change.removed, report.map_change.added).sum())
        for report in reports
        if report.map_change is not None
    )
    rejected = sum(report.rejected for report in reports)
    measured = rejected + sum(report.accepted for report in reports)
    return _Counts(epoch.nis, epoch.dof, rejected + anew, measured)


def _left_out(counts: Sequence[_Counts]) -> str:
    left_out, measured = sum(each.left_out for each in counts), sum(each.measured for each in counts)
    if left_out <= LARGEST_REJECTED * measured:
        return ""
    return f"{left_out} of {measured} measurements of the last {len(counts)} epochs could not be used or were rejected"


def _innovations(counts: Sequence[_Counts]) -> str:
    nis, dof = sum(each.nis for each in counts), sum(each.dof for each in counts)
    if nis <= LARGEST_NIS * dof or chi_square_tail(nis, dof) > FALSE_ALARM:
        return ""
    return f"innovations of {len(counts)} epochs are {nis / dof:.3g} times as large (squared) as the noise explains"


def _noise(sums: Float[np.ndarray, "t 4"], epochs: int) -> str:
    """About the level that the data contradict most."""
    by_chance = {name: (chance(test), test) for name, test in summed_tests(sums).noise.items()}
    if not by_chance:
        return ""
    name, (probability, test) = min(by_chance.items(), key=lambda item: item[1][0])
    if probability > FALSE_ALARM or test.ratio <= LARGEST_RATIO:
        return ""
    what = f"disturbances of the {name}" if name in NAMES else "errors of measurements"
    when = f"the last {epochs} epochs" if epochs else "all epochs"
    return f"{what} in {when} are {np.sqrt(test.ratio):.2g} times as large as their noise explains"


def chance(test: NoiseTest) -> float:
    """Tail probability of a sum of squares.

    It is that of the scaled chi-square distribution with its mean and variance.
    """
    if not (test.variance > 0 and test.expected > 0):
        return 1.0
    scale = test.variance / (2 * test.expected)
    return float(chi_square_tail(test.seen / scale, test.expected / scale))


REMEMBERED, FEWEST = 50, 5
"""Intervals that determine the usual one, and how many of them it takes."""
GAP, JUMP = 3.0, 30.0
"""In usual intervals: a gap is counted, a jump must be confirmed."""


class GapRule:
    """Rule for epochs far ahead: accepted once a second epoch confirms their time.

    Parameters
    ----------
    largest : float
        Seconds ahead that are believed at once, at most.
    """

    def __init__(self, largest: float) -> None:
        self._largest, self._intervals = largest, list[float]()
        self._held: ArrivedEpoch | None = None

    def jump(self, arrived: ArrivedEpoch, now: float) -> tuple[bool, ArrivedEpoch | None]:
        """Whether an epoch is held back, and the held one that it confirms."""
        before, self._held = self._held, None
        limit = min(self._largest, JUMP * self._usual_interval)
        if arrived.time - now <= limit:
            return False, None
        if before is not None and 0 < arrived.time - before.time <= limit:
            return False, before
        self._held = arrived
        return True, None

    def passed(self, interval: float) -> bool:
        """Remember an interval (s); whether it is a gap."""
        gap = interval > GAP * self._usual_interval
        self._intervals = [*self._intervals, interval][-REMEMBERED:]
        return gap

    @property
    def _usual_interval(self) -> float:
        return float(np.median(self._intervals)) if len(self._intervals) >= FEWEST else np.inf


FAR = 4.0
"""Squared distance per component between hand-over and filter, both covariances added, above which the smoother has diverged."""
REFUSALS = 3
"""Hand-overs in a row that are refused, after which the smoother begins anew from the filter."""
REHEARSED_DOUBLINGS = 7
"""Of the interval: gaps of up to 64 epochs are as quick as any; what longer ones need takes seconds to build."""
CATCHING_UP = 0.004
"""Seconds, about, that a filter put on a hand-over catches up before the next epoch is looked for."""


Keep = Callable[[ArrivedEpoch], None]
"""Called with every epoch that the filter has taken."""


class Executive:
    """A live run.

    Attributes
    ----------
    track
        The filter.
    supervisor
        The smoother's process.
    summary
        What is counted.
    """

    def __init__(self, setup: LiveSetup, options: LiveOptions, keep: Keep = lambda _: None) -> None:
        self._setup, self._options, self._keep = setup, options, keep
        self.track = FilterTrack(setup.filter, setup.time, options.history)
        self.supervisor = SmootherSupervisor(setup.process.layout, setup.models, options.supervision)
        self.summary = LiveSummary(options.deadline)
        self._refused, self._gaps = 0, GapRule(options.largest_gap)
        self._waiting: HandOver | None = None
        self._stands_on_smoother = False
        self._verdict = RunningVerdict(setup.process)
        self._smoother_believed = True
        self._rebasing_to = setup.time

    def rehearse(self, epochs: Timeline) -> None:
        """Compile and load what answers need before the clock starts; the filter's state is restored afterwards."""
        estimator = self.track.estimator
        before = estimator.snapshot()
        rehearse(estimator, self.track.time, epochs)
        ahead = self._options.ahead
        if ahead > 0 and self._predict_belief(estimator.belief, ahead) is None:
            raise InputError(
                f"--predict {ahead:g}: at this rate the prediction has no meaning so far ahead; give less"
            )
        if len(epochs):
            self._rehearse_gaps(epochs[0].time - self.track.time)
        estimator.restore(before)
        gc.collect()
        gc.freeze()  # what has been built stays: a collection that looks through it takes longer than an answer

    def _rehearse_gaps(self, interval: float) -> None:
        """Rehearse steps across gaps.

        More substeps are another function, which must not be built when a gap ends.
        """
        steps = interval * 2.0 ** np.arange(REHEARSED_DOUBLINGS)
        for step in steps[(steps > 0) & (steps <= self._options.largest_gap)].tolist():
            try:
                self._setup.process.linearise(self.track.belief.mean, step)
            except NUMERICAL_ERRORS:
                return

    def run(self, epochs: Iterator[ArrivedEpoch | None]) -> Iterator[Answer]:
        """Answers in the order of arrival, the smoother served between them."""
        try:
            self.rehearse(self._setup.rehearsal)
            self._begin_smoother(first=True)
            for arrived in epochs:
                if arrived is not None:
                    yield from self._answer_epoch(arrived)
                self.serve()
        finally:
            self.supervisor.close()
            self.summary.events.update(self.supervisor.events)

    def serve(self) -> None:
        """Apply the latest hand-over step by step, and keep a smoother running."""
        if not self._options.smoother:
            return
        found = self.supervisor.hand_overs()
        self._waiting = found[-1] if found else self._waiting
        if self.track.is_rebasing:
            self._catch_up()
        elif self._waiting is not None:
            given, self._waiting = self._waiting, None
            self._take_over(given)
        if self.supervisor.may_begin:
            self._begin_smoother(first=False)

    def _catch_up(self) -> None:
        end = time.monotonic() + CATCHING_UP
        while self.track.is_rebasing and time.monotonic() < end:
            if self.track.rebase_step():
                self.summary.events["hand-over"] += 1
                self._stands_on_smoother = True
                self._verdict.rebased(self._rebasing_to, self._smoother_believed)

    def _answer_epoch(self, arrived: ArrivedEpoch) -> Iterator[Answer]:
        """The answer to an epoch, if any; the epoch goes to the smoother's process first."""
        loss = self._loss(arrived.time)
        if loss is not None:
            self.summary.events[loss] += 1
            return
        jumped, believed = self._gaps.jump(arrived, self.track.time)
        if jumped:
            self.summary.events["jump of time"] += 1
            yield self._not_believed(arrived)
            return
        if believed is not None:
            frame = self._frame(believed)
            if self.track.take(frame) is not None:
                self._keep(believed)
            self.supervisor.send(frame)
        yield from self._answer_to(arrived)

    def _answer_to(self, arrived: ArrivedEpoch) -> Iterator[Answer]:
        """Answer to an epoch; none where it is not the latest."""
        began = time.thread_time()
        is_latest = arrived.time > self.track.time
        gap, before = arrived.time - self.track.time, self.track.belief
        frame = self._frame(arrived)
        reports = self.track.take(frame)
        if reports is not None and frame.measurements:
            self._keep(arrived)
        belief = self.track.belief
        if is_latest and reports:
            nis, dof = sum(report.nis for report in reports), sum(report.dof for report in reports)
            self._verdict.take(FilterEpoch(before, belief, gap, nis, dof), reports, arrived.time)
        if reports is None:
            self.summary.events["epoch left out, not finite"] += 1
        if not is_latest:
            self.summary.events["late, put in its place"] += 1
            return
        if self._gaps.passed(gap):
            self.summary.events["gap"] += 1
        answer = self._make_answer(arrived, belief, reports or [], len(frame.measurements))
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
        return None

    def _frame(self, arrived: ArrivedEpoch) -> Epoch:
        measurements = []
        for stream in arrived.streams:
            try:
                measurements.append(self._setup.bind(stream))
            except InputError:
                self.summary.events["unusable"] += 1
        return Epoch(arrived.time, tuple(measurements))

    def _make_answer(
        self, arrived: ArrivedEpoch, belief: Gaussian, reports: list[UpdateReport], count: int
    ) -> Answer:
        instant, status = arrived.time, self.track.estimator.status
        if self._options.smoother and self.supervisor.trouble:
            status = status.degraded(
                f"the filter continues without the smoother: {self.supervisor.trouble}", "no-smoother"
            )
        for reason in self._verdict.reasons:
            status = status.degraded(reason, "live")
        if count and not sum(report.accepted for report in reports):
            status = status.degraded("no measurement of this epoch was used", "epoch-unused")
        if instant > self.track.time:  # the epoch broke the filter: what it said before, carried on
            status = status.degraded(
                "this epoch would have made the estimate infinite and was left out", "steps-left-out"
            )
            belief = self._predict_belief(belief, instant - self.track.time) or belief
        ahead = None
        if self._options.ahead > 0:
            there = self._predict_belief(belief, self._options.ahead)
            ahead = None if there is None else (instant + self._options.ahead, there)
            status = (
                status.degraded("it cannot be predicted so far ahead", "prediction-range")
                if there is None
                else status
            )
        source = "smoother" if self._stands_on_smoother else "filter"
        used, left = sum(r.accepted for r in reports), sum(r.rejected for r in reports)
        return Answer(instant, belief, status, source, used, left, time.monotonic() - arrived.at, ahead)

    def _not_believed(self, arrived: ArrivedEpoch) -> Answer:
        """Answer to an epoch whose time may be wrong: the belief before it."""
        why = f"its time is {arrived.time - self.track.time:.3g} s ahead, which the next epoch must confirm"
        status, used = (
            self.track.estimator.status.degraded(why, "time-unconfirmed"),
            sum(map(len, arrived.streams)),
        )
        latency = time.monotonic() - arrived.at
        self.summary.latencies.append(latency)
        return Answer(arrived.time, self.track.belief, status, "filter", 0, used, latency)

    def _predict_belief(self, belief: Gaussian, seconds: float) -> Gaussian | None:
        """A belief so much later, None where that cannot be computed."""
        try:
            there = predict_ahead(self._setup.process, belief, np.array([seconds])).belief(0)
        except (*NUMERICAL_ERRORS, InputError):
            return None
        return there if np.isfinite(there.mean).all() and np.isfinite(there.covariance).all() else None

    def _take_over(self, given: HandOver) -> None:
        """Put the filter on the smoothed past, or refuse that."""
        events = self.summary.events
        if not self.track.has(given.time):
            events["hand-over too old"] += 1
            self.supervisor.end("smoother too slow", "it is older than the epochs that the filter keeps")
            return
        if given.verdict == Verdict.DEGRADED:  # it says itself that it is not to be relied upon yet
            events["hand-over not converged yet"] += 1
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
            self.track.begin_rebase(given.time, lambda filter_: filter_.rebase(given.belief))
            self._rebasing_to = given.time
        except (*NUMERICAL_ERRORS, InputError):
            events["hand-over refused, the filter cannot start from it"] += 1

    def _doubt(self, given: HandOver) -> str | None:
        if not given.is_finite:
            return "not finite"
        if given.verdict != Verdict.OK:
            return "failed"
        try:
            far = distance(self.track.belief_at(given.time), given.state)
        except NUMERICAL_ERRORS:
            return "not comparable"
        only_it_is_believed = self._smoother_believed and not self._verdict.is_believed
        return None if far <= FAR or only_it_is_believed else "far from the filter"

    def _begin_smoother(self, first: bool) -> None:
        if not self._options.smoother:
            return
        begun = self._setup.first_smoother
        if first and begun is not None:
            self.supervisor.begin(self._task(begun[0], begun[1], self._setup.time))
            return
        belief, setup, options = self.track.belief, self._setup, self._options.sliding

        def build() -> RecursiveSmoother:
            """The smoother from the filter's belief."""
            smoother = RecursiveSmoother(setup.process, options)
            smoother.start(belief)
            return smoother

        self._waiting, self._stands_on_smoother = None, False
        self._smoother_believed = self._verdict.is_believed
        self.supervisor.begin(self._task(build, 0.0, self.track.time))

    def _task(self, build: Build, own_time: float, instant: float) -> SmootherTask:
        """Task of the smoother, with as many modes as the filter."""
        modes, landmarks = self.track.estimator.mode_count, self._options.landmarks
        if modes:
            landmarks = replace(landmarks, modes=modes, explained=0.0)
        return SmootherTask(build, own_time, instant, landmarks, self._options.memory)
