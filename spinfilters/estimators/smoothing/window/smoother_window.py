"""Arrays of the epochs of a window with their measurements."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.estimators.estimator import Measurement, ProcessModel
from spinfilters.estimators.smoothing.factors.landmark_observations import LandmarkObservations, SensorGroup
from spinfilters.estimators.smoothing.factors.marginalization_prior import MarginalizationPrior
from spinfilters.estimators.smoothing.factors.motion_factors import motion_of
from spinfilters.estimators.smoothing.problem.least_squares import Problem
from spinfilters.estimators.smoothing.state_prior import StatePrior
from spinfilters.estimators.timeline import Epoch
from spinfilters.models.landmark_sensor import LandmarkSensor


@dataclass(frozen=True)
class WindowObservations:
    """Observations that still count, in the order of time.

    Attributes
    ----------
    epoch: (N,) number in the window.   landmark: (N,) number among the window's.   sensor: (N,) number of the sensor.   values:
    (N, v).   parameters: (N, p), without the landmark's point.
    """

    epoch: Int[np.ndarray, " N"]
    landmark: Int[np.ndarray, " N"]
    sensor: Int[np.ndarray, " N"]
    values: Float[np.ndarray, "N v"]
    parameters: Float[np.ndarray, "N p"]

    def chosen(self, rows: Bool[np.ndarray, " N"]) -> "WindowObservations":
        """Chosen observations."""
        taken = np.flatnonzero(rows)
        return WindowObservations(*(array.take(taken, axis=0) for array in vars(self).values()))

    def plus(self, other: "WindowObservations") -> "WindowObservations":
        """Others behind them."""
        if not len(self.epoch):
            return other
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return WindowObservations(*(np.concatenate(pair) for pair in pairs))


@dataclass(frozen=True)
class Window:
    """Frames, their states, and landmarks.

    A landmark whose observations have been used up is a new one when it is seen again: the old one's position is not
    forgotten, it has
    become part of what is carried.

    Attributes
    ----------
    epochs: k of them, with what was measured beside landmarks.   trajectory: (k, m).   seen: their observations.
    models: sensors of landmarks, by number.
    ids: (L,) of the landmarks, each once.   points: (L, 3) m, frame g.   marginal_prior: what is left of those that have gone.
    """

    epochs: tuple[Epoch, ...]
    trajectory: Float[np.ndarray, "k m"]
    seen: WindowObservations
    models: tuple[LandmarkSensor, ...]
    ids: Int[np.ndarray, " L"]
    points: Float[np.ndarray, "L 3"]
    marginal_prior: MarginalizationPrior | None = None

    @classmethod
    def empty(cls, mean_dim: int) -> "Window":
        """A window without an epoch."""
        none = np.zeros(0, dtype=int)
        seen = WindowObservations(none, none, none, np.zeros((0, 3)), np.zeros((0, 6)))
        return cls((), np.zeros((0, mean_dim)), seen, (), none, np.zeros((0, 3)))

    @cached_property
    def observations(self) -> LandmarkObservations:
        """Observations in the order of elimination: landmark after landmark."""
        s, many = self.seen, len(self.ids) > np.iinfo(np.uint16).max
        order = np.argsort(s.landmark if many else s.landmark.astype(np.uint16), kind="stable")
        groups, every = [], np.arange(len(order))
        for number, model in enumerate(self.models):
            rows = every if len(self.models) == 1 else np.flatnonzero(s.sensor[order] == number)
            at = order[rows]
            groups.append(SensorGroup(model, rows, s.values.take(at, axis=0), s.parameters.take(at, axis=0)))
        counts = np.bincount(s.epoch, minlength=len(self.epochs))
        place = np.zeros(len(order), dtype=int)
        chosen = tuple(group for group in groups if len(group.rows))
        return LandmarkObservations(s.epoch[order], s.landmark[order], place, counts, len(self.ids), chosen)

    def problem(self, process: ProcessModel, prior: StatePrior | None, has_landmarks: bool) -> Problem:
        """The least-squares problem of the window."""
        known = self.marginal_prior is not None and self.marginal_prior.knows_constants
        first = self.marginal_prior.first[0] if self.marginal_prior is not None and known else None
        motion = replace(motion_of(process, self.epochs, has_landmarks), prior=prior, first=first)
        return Problem(motion, self.observations if has_landmarks else None, self.marginal_prior)

    def last_seen(self) -> Int[np.ndarray, " L"]:
        """The last epoch in which each landmark has an observation that counts."""
        last = np.full(len(self.ids), -1)
        np.maximum.at(last, self.seen.landmark, self.seen.epoch)
        return last

    def opened(self, time: float, state: Float[np.ndarray, " m"]) -> "Window":
        """Window with one more epoch (s) at an initial guess, without measurements."""
        trajectory = np.concatenate([self.trajectory, state[None]])
        return replace(self, epochs=(*self.epochs, Epoch(time, ())), trajectory=trajectory)

    def extended(self, m: Measurement) -> "Window":
        """Window with one more measurement in the latest epoch, its new landmarks initialised."""
        if m.ids is None:
            latest = self.epochs[-1]
            latest = Epoch(latest.time, (*latest.measurements, m))
            return replace(self, epochs=(*self.epochs[:-1], latest))
        if not len(m.ids):
            return self
        sensor = m.model.landmark_sensor
        assert sensor is not None
        return _with_observations(self, sensor, m.ids, m)

    def placed(self, ids: Int[np.ndarray, " k"], points: Float[np.ndarray, "k 3"]) -> "Window":
        """Window with the landmarks of these ids at these points (m, frame g)."""
        at, moved = _numbers(self.ids, ids), self.points.copy()
        moved[at[at >= 0]] = points[at >= 0]
        return replace(self, points=moved)

    def latest_at(self, pose: Float[np.ndarray, " 7"]) -> "Window":
        """The window with the latest epoch at a pose (t m, q_ig).

        Landmarks that no other epoch observed move with it.
        """
        seen, latest = self.seen, len(self.epochs) - 1
        trajectory, points = self.trajectory.copy(), self.points.copy()
        trajectory[-1, :7] = pose
        only = np.ones(len(self.ids), dtype=bool)
        only[seen.landmark[seen.epoch < latest]] = False
        for number, model in enumerate(self.models):
            rows = np.flatnonzero((seen.epoch == latest) & (seen.sensor == number) & only[seen.landmark])
            parameters = np.concatenate([np.zeros((len(rows), 3)), seen.parameters[rows]], axis=1)
            made = model.new_landmarks(trajectory[-1], parameters, seen.values[rows])
            points[seen.landmark[rows]] = made.points
        return replace(self, trajectory=trajectory, points=points)

    def without(self, landmarks: Bool[np.ndarray, " L"]) -> "Window":
        """The window without some landmarks and their observations."""
        number = np.cumsum(~landmarks) - 1
        seen = self.seen.chosen(~landmarks[self.seen.landmark])
        seen = replace(seen, landmark=number[seen.landmark])
        return replace(self, seen=seen, ids=self.ids[~landmarks], points=self.points[~landmarks])

    def shifted(self, count: int, marginal_prior: MarginalizationPrior) -> "Window":
        """Window without the oldest epochs, which must hold no observations."""
        seen = replace(self.seen, epoch=self.seen.epoch - count)
        epochs, trajectory = self.epochs[count:], self.trajectory[count:]
        return replace(self, epochs=epochs, trajectory=trajectory, seen=seen, marginal_prior=marginal_prior)


def _with_observations(
    window: Window, model: LandmarkSensor, ids: Int[np.ndarray, " k"], measured: Measurement
) -> Window:
    """The window with one sensor's observations in the latest epoch.

    Those that tell no landmark and are not of a known one are left out.
    """
    values, parameters = measured.values, measured.parameters
    models = window.models if any(known is model for known in window.models) else (*window.models, model)
    number = next(k for k, known in enumerate(models) if known is model)
    landmark = _numbers(window.ids, ids)
    fresh, every, points = np.flatnonzero(landmark < 0), window.ids, window.points
    if len(fresh):
        made = model.new_landmarks(window.trajectory[-1], parameters[fresh], values[fresh])
        good = np.flatnonzero(made.determined & np.isfinite(made.points).all(axis=1))
        good = good[np.sort(np.unique(ids[fresh[good]], return_index=True)[1])]
        landmark[fresh[good]] = len(every) + np.arange(len(good))
        every = np.concatenate([every, ids[fresh[good]]])
        points = np.concatenate([points, made.points[good]])
    use = np.flatnonzero(landmark >= 0)
    epoch, sensor = np.full(len(use), len(window.epochs) - 1), np.full(len(use), number)
    here = WindowObservations(epoch, landmark[use], sensor, values[use], parameters[use, 3:])
    return replace(window, models=models, ids=every, points=points, seen=window.seen.plus(here))


def _numbers(known: Int[np.ndarray, " L"], ids: Int[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
    """Index of each id among the known ones, or -1."""
    if not len(known):
        return np.full(len(ids), -1)
    order = np.argsort(known, kind="stable")  # ids in runs that ascend, which a stable sort is quick with
    at = order[np.minimum(np.searchsorted(known.take(order), ids), len(order) - 1)]
    return np.where(known[at] == ids, at, -1)
