"""GTSAM epoch by epoch: everything solved again, ISAM2, and fixed lag.

Nothing of the trial enters but its landmarks' ids: the first state is the prior's mean, a new frame is predicted from the latest,
and new landmarks stand where their first observation puts them. Frames are built before the clock starts; what is timed are GTSAM's
calls, the reading of the latest state among them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from jaxtyping import Float, Int

from experiments.benchmarks.gtsam_chart import (
    CENTRE,
    GtsamChart,
    constants_key,
    gtsam,
    landmark_key,
    pose_key,
    rates_key,
)
from experiments.benchmarks.gtsam_graph import MotionFactors, StereoFactors
from experiments.benchmarks.gtsam_peer import chart_of
from experiments.benchmarks.smoother_workload import PeerResult, Workload, whitened_cost
from experiments.benchmarks.stopwatch import now

RELINEARISE: Final = 0.1
"""Step of a variable beyond which ISAM2 linearises it anew: GTSAM's default."""


@dataclass(frozen=True)
class NewFrame:
    """Additions of an epoch to the factor graph.

    Factors, first values of its own variables, and its landmarks with the keys of their present lives.
    """

    number: int
    factors: Any
    values: Any
    numbers: Int[np.ndarray, " s"]
    keys: list[int]


class Stream:
    """Frames of a workload one by one.

    Landmarks unseen for longer than ``memory`` frames come back as new variables.
    """

    def __init__(self, workload: Workload, memory: int | None = None) -> None:
        self.workload = workload
        self.chart: GtsamChart = chart_of(workload)
        self.motion = MotionFactors(workload, self.chart)
        self.key: dict[int, int] = {}
        self._stereo = StereoFactors(workload)
        self.memory = len(workload.timeline) if memory is None else memory
        self._last: dict[int, int] = {}
        self._lives: dict[int, int] = {}

    def frame(self, number: int, latest: Float[np.ndarray, " m"]) -> NewFrame:
        """The next frame, from the latest state: that of the frame before, or the prior's mean."""
        factors, values, timeline = gtsam.NonlinearFactorGraph(), gtsam.Values(), self.workload.timeline
        if number:
            latest = self.workload.process.step(latest, timeline[number].time - timeline[number - 1].time)
            factors.add(self.motion.step(number - 1))
        else:
            values.insert(constants_key(), self.chart.constants(latest))
            factors.add(self.motion.prior())
        self.chart.insert(values, number, latest)
        rows = np.flatnonzero(self.workload.observations.epoch == number)
        numbers, pixels = self.workload.observations.landmark[rows], self.workload.values[rows]
        fresh = self._renewed(number, numbers)
        keys = [self.key[j] for j in numbers.tolist()]
        pose = values.atPose3(pose_key(number))
        for key, new, measured in zip(keys, fresh, pixels, strict=True):
            factors.add(self._stereo.observation(number, key, measured))
            if new:
                values.insertPoint3(key, self._stereo.point(pose, measured))
        return NewFrame(number, factors, values, numbers, keys)

    def state(self, values: Any, frame: int) -> Float[np.ndarray, " m"]:
        """State of one epoch."""
        pose, rates = values.atPose3(pose_key(frame)), values.atVector(rates_key(frame))
        return self.chart.state(pose, rates, values.atVector(constants_key()))

    def _renewed(self, frame: int, numbers: Int[np.ndarray, " s"]) -> list[bool]:
        """Landmarks of an epoch that begin a life here."""
        fresh = []
        for j in numbers.tolist():
            last = self._last.get(j)
            fresh.append(last is None or frame - last > self.memory)
            if fresh[-1]:
                self._lives[j] = self._lives.get(j, -1) + 1
                self.key[j] = landmark_key(j, self._lives[j])
            self._last[j] = frame
        return fresh


@dataclass(frozen=True)
class FrameByFrame:
    """A solver that takes one frame after the other.

    It tells all it knows, or the variables with some keys.
    """

    name: str
    take: Callable[[NewFrame], None]
    whole: Callable[[], Any]
    some: Callable[[list[int]], Any]


def resolved_every_frame(workload: Workload) -> PeerResult:
    """Levenberg-Marquardt over all epochs so far after every epoch.

    The damping is GTSAM's default, the start where it was.
    """
    stream, graph, known = Stream(workload), gtsam.NonlinearFactorGraph(), [gtsam.Values()]

    def take(new: NewFrame) -> None:
        """Take in a frame."""
        graph.push_back(new.factors)
        known[0].insert(new.values)
        known[0] = gtsam.LevenbergMarquardtOptimizer(graph, known[0]).optimize()

    name = "GTSAM LM after every frame"
    return _through(stream, FrameByFrame(name, take, lambda: known[0], lambda _: known[0]))


def isam2(workload: Workload, threshold: float = RELINEARISE) -> PeerResult:
    """ISAM2 with one update per frame, checking at every update what to linearise anew."""
    stream, solver = Stream(workload), gtsam.ISAM2(_isam2_parameters(threshold))

    def take(new: NewFrame) -> None:
        """Take in a frame."""
        solver.update(new.factors, new.values)

    estimate = solver.calculateEstimate
    return _through(stream, FrameByFrame(f"GTSAM ISAM2, {threshold:g}", take, estimate, estimate))


def fixed_lag(workload: Workload, lag: int, threshold: float = RELINEARISE) -> PeerResult:
    """IncrementalFixedLagSmoother over the last ``lag`` frames; landmarks leave with the last frame that saw them.

    Its trajectory holds each frame as it was estimated last, with the constants of the end, and of a landmark's lives the last: its
    cost says nothing, for a window drifts, and a landmark that comes back does so elsewhere.
    """
    stream = Stream(workload, lag)
    solver = gtsam.IncrementalFixedLagSmoother(float(lag), _isam2_parameters(threshold))

    def take(new: NewFrame) -> None:
        """Take in a frame."""
        keys = [constants_key(), pose_key(new.number), rates_key(new.number), *new.keys]
        solver.update(new.factors, new.values, dict.fromkeys(keys, float(new.number)))

    estimate = solver.calculateEstimate
    return _through(stream, FrameByFrame(f"GTSAM fixed lag of {lag}", take, estimate, estimate))


def _isam2_parameters(threshold: float) -> Any:
    parameters = gtsam.ISAM2Params()
    parameters.setRelinearizeThreshold(threshold)
    parameters.relinearizeSkip = 1
    return parameters


def _through(stream: Stream, solver: FrameByFrame) -> PeerResult:
    """Every frame of a stream through a solver."""
    workload, latest, seconds = stream.workload, stream.workload.prior.mean, 0.0
    count = len(workload.timeline)
    trajectory, points = np.tile(latest, (count, 1)), workload.trial.points.copy()
    for k in range(count):
        new = stream.frame(k, latest)
        begin = now()
        solver.take(new)
        values = solver.some([pose_key(k), rates_key(k), constants_key()])
        seconds += now() - begin
        latest = stream.state(values, k)
        if k + 1 == count or stream.memory < count:
            _keep(stream, solver.whole(), k, trajectory, points)
    trajectory[:, CENTRE.start :] = latest[CENTRE.start :]
    cost = whitened_cost(workload, trajectory, points)
    return PeerResult(solver.name, trajectory, points, cost, seconds, stream.motion.clock.seconds)


def _keep(
    stream: Stream,
    values: Any,
    latest: int,
    trajectory: Float[np.ndarray, "k m"],
    points: Float[np.ndarray, "L 3"],
) -> None:
    """Write down what is still estimated of frames and landmarks."""
    for k in range(max(0, latest - stream.memory), latest + 1):
        trajectory[k] = stream.state(values, k)
    for number, key in stream.key.items():
        if values.exists(key):
            points[number] = values.atPoint3(key)
