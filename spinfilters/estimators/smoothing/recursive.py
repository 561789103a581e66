"""The sliding smoother as one estimator among others: driven frame by frame, kept in a checkpoint, and brought back from it."""

from bisect import bisect_left, bisect_right
from dataclasses import replace
from itertools import takewhile

import numpy as np
from jaxtyping import Float, Int

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import Estimator, Measurement, ProcessModel, Snapshot, UpdateReport
from spinfilters.estimators.first_frames import FirstStatePrior
from spinfilters.estimators.smoothing.carried import Carried
from spinfilters.estimators.smoothing.closed_form import Tried
from spinfilters.estimators.smoothing.sliding import SlidingSmoother
from spinfilters.estimators.smoothing.sliding_records import Memory, Retired, SlidingOptions, Taken
from spinfilters.estimators.smoothing.unknowns import Unknowns
from spinfilters.estimators.smoothing.window import Seen, Window
from spinfilters.estimators.timeline import Frame, Timeline
from spinfilters.models.landmark_sensor import LandmarkSensor
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.layout import StateLayout

_SEEN = ("frame", "landmark", "sensor", "values", "parameters")
_RETIRED = ("time", "mean", "factor")


class RecursiveSmoother(Estimator):
    """A sliding smoother that knows its timeline: all measurements of a frame are taken in with the first of them.

    Parameters
    ----------
    prior: of the first frame's state.   timeline: all frames that it will be given.
    """

    name = "smoother"

    def __init__(
        self, process: ProcessModel, prior: FirstStatePrior, options: SlidingOptions, timeline: Timeline
    ) -> None:
        super().__init__(process)
        self._prior, self._options, self._timeline = prior, options, timeline
        self.sliding = SlidingSmoother(process, prior, options, tied=True)
        self.retired: list[Retired] = []
        self.begun: list[Taken] = []
        """What `begin` did, epoch by epoch."""
        self._time, self._belief = timeline[0].time, Gaussian(self.layout, prior.mean, np.diag(prior.std))

    def start(self, belief: Gaussian) -> None:
        """Begin from a belief of the first frame's state, whose standard deviations are the prior's."""
        prior = FirstStatePrior(belief.mean, np.linalg.norm(belief.factor, axis=1))
        self.__init__(self.process, prior, self._options, self._timeline)

    def begin(
        self,
        trajectory: Float[np.ndarray, "k m"],
        ids: Int[np.ndarray, " L"],
        points: Float[np.ndarray, "L 3"],
    ) -> list[Taken]:
        """Take in the first k frames at once, as `SlidingSmoother.begin`."""
        first = self._timeline[: len(trajectory)]
        self.begun = self.sliding.begin(first, trajectory, ids, points)
        self._time, self._belief = first[-1].time, self.sliding.belief
        return self.begun

    @property
    def belief(self) -> Gaussian:
        """Of the newest frame, given all up to it."""
        return self._belief

    def predict(self, dt: float) -> None:
        """Go dt > 0 seconds ahead; the next frame says what was measured there."""
        later = bisect_right(self._timeline, self._time, key=_time_of)
        if later == len(self._timeline) or not dt > 0:
            raise InputError(f"no frame follows t = {self._time} s; give the smoother its whole timeline")
        self._time = self._timeline[later].time

    def update(self, measurement: Measurement) -> UpdateReport:
        """Take in the frame that the measurement belongs to, if that has not been done."""
        frames = self.sliding.window.frames
        if frames and frames[-1].time >= self._time:
            return UpdateReport(nis=0.0, dof=0, accepted=0, rejected=0)
        taken = self.sliding.add(self._timeline[bisect_left(self._timeline, self._time, key=_time_of)])
        self.retired += taken.retired
        self._belief = self.sliding.belief
        return UpdateReport(nis=0.0, dof=0, accepted=taken.accepted, rejected=taken.rejected)

    def smoothed(self) -> list[Retired]:
        """Every frame so far, those in the window iterated until nothing moves."""
        self.sliding.settle()
        return [*self.retired, *self.sliding.smoothed()]

    def snapshot(self) -> Snapshot:
        """Copies of everything that the future of the estimate depends on."""
        window, memory = self.sliding.window, self.sliding.memory
        arrays = {f"seen_{name}": getattr(window.seen, name).copy() for name in _SEEN}
        arrays |= {
            name: np.array([getattr(row, name) for row in self.retired]) for name in _RETIRED if self.retired
        }
        if window.carried is not None:
            c = window.carried
            arrays |= {"first": c.first, "root": c.root, "right": c.right, "lost": np.array(c.lost)}
        flags = [memory.prior_alive, memory.strange, memory.determined, memory.tried.next]
        return arrays | {
            "window_time": np.array([frame.time for frame in window.frames]),
            "trajectory": window.trajectory.copy(),
            "ids": window.ids.copy(),
            "points": window.points.copy(),
            "flags": np.array(flags, dtype=float),
            "belief_mean": self._belief.mean.copy(),
            "belief_factor": self._belief.factor.copy(),
        }

    def restore(self, snapshot: Snapshot) -> None:
        """Go on from a snapshot of a smoother over the same timeline."""
        times = set(snapshot["window_time"].tolist())
        frames = tuple(frame for frame in self._timeline if frame.time in times)
        if len(frames) != len(times):
            raise InputError("the snapshot's frames are not those of this timeline; give the same data set")
        window = Window(
            frames,
            snapshot["trajectory"],
            Seen(*(snapshot[f"seen_{name}"] for name in _SEEN)),
            _sensors(self._timeline, frames[-1].time),
            snapshot["ids"],
            snapshot["points"],
        )
        alive, strange, determined, due = snapshot["flags"]
        memory = Memory(bool(alive), bool(strange), int(determined), Tried(float(due)))
        self.sliding.resume(replace(window, carried=_carried(self.layout, snapshot)), memory)
        self._time = frames[-1].time
        self._belief = Gaussian(self.layout, snapshot["belief_mean"], snapshot["belief_factor"])
        kept = [snapshot[name] for name in _RETIRED if name in snapshot]
        self.retired = [Retired(float(t), m, f) for t, m, f in zip(*kept, strict=True)]


def _time_of(frame: Frame) -> float:
    return frame.time


def _carried(layout: StateLayout, snapshot: Snapshot) -> Carried | None:
    if "root" not in snapshot:
        return None
    first = snapshot["first"]
    unknowns = Unknowns(layout, len(first), tied=True)
    return Carried(unknowns, first, snapshot["root"], snapshot["right"], float(snapshot["lost"]))


def _sensors(timeline: Timeline, until: float) -> tuple[LandmarkSensor, ...]:
    """Sensors of landmarks in the order in which they first spoke."""
    found: list[LandmarkSensor] = []
    for frame in takewhile(lambda frame: frame.time <= until, timeline):
        for m in frame.measurements:
            new = m.ids is not None and len(m.ids) and not any(known is m.model for known in found)
            if new and isinstance(m.model, LandmarkSensor):
                found.append(m.model)
    return tuple(found)
