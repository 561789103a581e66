"""The frames of a window with all that was measured in them, as arrays that grow at one end and shrink at the other."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.estimators.estimator import Measurement, ProcessModel
from spinfilters.estimators.smoothing.carried import Carried
from spinfilters.estimators.smoothing.motion import StatePrior, motion_of
from spinfilters.estimators.smoothing.problem import Problem
from spinfilters.estimators.smoothing.sightings import SensorGroup, Sightings
from spinfilters.estimators.timeline import Frame
from spinfilters.models.landmark_sensor import LandmarkSensor


@dataclass(frozen=True)
class Seen:
    """Sightings that still count, in the order of time.

    Attributes
    ----------
    frame: (N,) number in the window.   landmark: (N,) number among the window's.   sensor: (N,) number of the sensor.   values:
    (N, v).   parameters: (N, p), without the landmark's point.
    """

    frame: Int[np.ndarray, " N"]
    landmark: Int[np.ndarray, " N"]
    sensor: Int[np.ndarray, " N"]
    values: Float[np.ndarray, "N v"]
    parameters: Float[np.ndarray, "N p"]

    def chosen(self, rows: Bool[np.ndarray, " N"]) -> "Seen":
        """Some of them."""
        taken = np.flatnonzero(rows)
        return Seen(*(array.take(taken, axis=0) for array in vars(self).values()))

    def plus(self, other: "Seen") -> "Seen":
        """Others behind them."""
        if not len(self.frame):
            return other
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return Seen(*(np.concatenate(pair) for pair in pairs))


@dataclass(frozen=True)
class Window:
    """Frames, their states, and landmarks.

    A landmark whose sightings have been used up is a new one when it is seen again: the old one's position is not forgotten, it has
    become part of what is carried.

    Attributes
    ----------
    frames: k of them, with what was measured beside landmarks.   trajectory: (k, m).   seen: their sightings.
    models: sensors of landmarks, by number.
    ids: (L,) of the landmarks, each once.   points: (L, 3) m, frame g.   carried: what is left of those that have gone.
    """

    frames: tuple[Frame, ...]
    trajectory: Float[np.ndarray, "k m"]
    seen: Seen
    models: tuple[LandmarkSensor, ...]
    ids: Int[np.ndarray, " L"]
    points: Float[np.ndarray, "L 3"]
    carried: Carried | None = None

    @classmethod
    def empty(cls, mean_dim: int) -> "Window":
        """Without a frame."""
        none = np.zeros(0, dtype=int)
        seen = Seen(none, none, none, np.zeros((0, 3)), np.zeros((0, 6)))
        return cls((), np.zeros((0, mean_dim)), seen, (), none, np.zeros((0, 3)))

    @cached_property
    def sightings(self) -> Sightings:
        """As the elimination wants them: landmark after landmark."""
        s, many = self.seen, len(self.ids) > np.iinfo(np.uint16).max
        order = np.argsort(s.landmark if many else s.landmark.astype(np.uint16), kind="stable")
        groups, every = [], np.arange(len(order))
        for number, model in enumerate(self.models):
            rows = every if len(self.models) == 1 else np.flatnonzero(s.sensor[order] == number)
            at = order[rows]
            groups.append(SensorGroup(model, rows, s.values.take(at, axis=0), s.parameters.take(at, axis=0)))
        counts = np.bincount(s.frame, minlength=len(self.frames))
        place = np.zeros(len(order), dtype=int)
        chosen = tuple(group for group in groups if len(group.rows))
        return Sightings(s.frame[order], s.landmark[order], place, counts, len(self.ids), chosen)

    def problem(self, process: ProcessModel, prior: StatePrior | None, tied: bool) -> Problem:
        """The least-squares problem of the window."""
        known = self.carried is not None and self.carried.knows_constants
        first = self.carried.first[0] if self.carried is not None and known else None
        motion = replace(motion_of(process, self.frames, tied), prior=prior, first=first)
        return Problem(motion, self.sightings if tied else None, self.carried)

    def last_seen(self) -> Int[np.ndarray, " L"]:
        """The last frame in which each landmark has a sighting that counts."""
        last = np.full(len(self.ids), -1)
        np.maximum.at(last, self.seen.landmark, self.seen.frame)
        return last

    def opened(self, time: float, state: Float[np.ndarray, " m"]) -> "Window":
        """With one more frame (s) at a first guess of its state, in which nothing is measured yet."""
        trajectory = np.concatenate([self.trajectory, state[None]])
        return replace(self, frames=(*self.frames, Frame(time, ())), trajectory=trajectory)

    def extended(self, m: Measurement) -> "Window":
        """With one more measurement in the newest frame; landmarks that are new begin where this frame puts them."""
        if m.ids is None:
            newest = self.frames[-1]
            newest = Frame(newest.time, (*newest.measurements, m))
            return replace(self, frames=(*self.frames[:-1], newest))
        if not len(m.ids):
            return self
        assert isinstance(m.model, LandmarkSensor)
        return _with_sightings(self, m.model, (m.ids, m.values, m.parameters))

    def placed(self, ids: Int[np.ndarray, " k"], points: Float[np.ndarray, "k 3"]) -> "Window":
        """With those of its landmarks that have these ids at these points (m, frame g)."""
        at, moved = _numbers(self.ids, ids), self.points.copy()
        moved[at[at >= 0]] = points[at >= 0]
        return replace(self, points=moved)

    def latest_at(self, pose: Float[np.ndarray, " 7"]) -> "Window":
        """With the newest frame at a pose (t m, q_ig), and with it the landmarks that no other frame saw."""
        seen, newest = self.seen, len(self.frames) - 1
        trajectory, points = self.trajectory.copy(), self.points.copy()
        trajectory[-1, :7] = pose
        only = np.ones(len(self.ids), dtype=bool)
        only[seen.landmark[seen.frame < newest]] = False
        for number, model in enumerate(self.models):
            rows = np.flatnonzero((seen.frame == newest) & (seen.sensor == number) & only[seen.landmark])
            parameters = np.concatenate([np.zeros((len(rows), 3)), seen.parameters[rows]], axis=1)
            made = model.new_landmarks(trajectory[-1], parameters, seen.values[rows])
            points[seen.landmark[rows]] = made.points
        return replace(self, trajectory=trajectory, points=points)

    def without(self, landmarks: Bool[np.ndarray, " L"]) -> "Window":
        """Without some landmarks and their sightings."""
        number = np.cumsum(~landmarks) - 1
        seen = self.seen.chosen(~landmarks[self.seen.landmark])
        seen = replace(seen, landmark=number[seen.landmark])
        return replace(self, seen=seen, ids=self.ids[~landmarks], points=self.points[~landmarks])

    def shifted(self, count: int, carried: Carried) -> "Window":
        """Without the oldest frames, of which no sighting may be left."""
        seen = replace(self.seen, frame=self.seen.frame - count)
        frames, trajectory = self.frames[count:], self.trajectory[count:]
        return replace(self, frames=frames, trajectory=trajectory, seen=seen, carried=carried)


def _with_sightings(
    window: Window, model: LandmarkSensor, measured: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> Window:
    """With one sensor's sightings in the newest frame; those that tell no landmark and are not of a known one are left out."""
    ids, values, parameters = measured
    if not any(known is model for known in window.models):
        window = replace(window, models=(*window.models, model))
    landmark = _numbers(window.ids, ids)
    fresh = np.flatnonzero(landmark < 0)
    if len(fresh):
        made = model.new_landmarks(window.trajectory[-1], parameters[fresh], values[fresh])
        good = np.flatnonzero(made.determined & np.isfinite(made.points).all(axis=1))
        good = good[np.sort(np.unique(ids[fresh[good]], return_index=True)[1])]
        landmark[fresh[good]] = len(window.ids) + np.arange(len(good))
        window = replace(
            window,
            ids=np.concatenate([window.ids, ids[fresh[good]]]),
            points=np.concatenate([window.points, made.points[good]]),
        )
    use = np.flatnonzero(landmark >= 0)
    frame = np.full(len(use), len(window.frames) - 1)
    sensor = np.full(len(use), next(k for k, known in enumerate(window.models) if known is model))
    here = Seen(frame, landmark[use], sensor, values[use], parameters[use, 3:])
    return replace(window, seen=window.seen.plus(here))


def _numbers(known: Int[np.ndarray, " L"], ids: Int[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
    """Which of the known ids each is, or -1."""
    if not len(known):
        return np.full(len(ids), -1)
    order = np.argsort(known, kind="stable")  # ids in runs that ascend, which a stable sort is quick with
    at = order[np.minimum(np.searchsorted(known.take(order), ids), len(order) - 1)]
    return np.where(known[at] == ids, at, -1)
