"""Window of a sliding smoother: arrays of its epochs, and the policies of what stays in it."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.errors import InputError
from spinfilters.filters.estimator import Measurement, ProcessModel
from spinfilters.filters.timeline import Epoch
from spinfilters.models.measurement import LandmarkSensor
from spinfilters.models.state_layout import StateLayout
from spinfilters.smoother.landmark_factors import (
    LandmarkObservations,
    SensorGroup,
    order_of_landmarks,
    places_among,
)
from spinfilters.smoother.motion_factors import motion_of
from spinfilters.smoother.priors import MarginalizationPrior, StatePrior
from spinfilters.smoother.problem import Problem

DETERMINED = 0.03
"""Standard deviation of the mass distribution (logarithm of second moments) above which no epoch leaves a window: a linear model of
the inertia made while it is hardly known would be kept for ever."""
LONGEST_STARTUP = 120
"""Epochs after which even an undetermined inertia must leave: a body in pure spin never determines it."""

SHARE, LARGEST_BATCH = 5, 16
"""A fifth of a window leaves together, so that its epochs share a decomposition; so many at most, also of a window that was longer
while it started up."""

SPARE = 2
"""Times as many observations as a window has, for which room is made: appending copies each but few times."""
SMALLEST_LANDMARK_BATCH = 100
"""Landmarks that are frozen at once, at least: each time costs a decomposition."""


class WindowPolicy(ABC):
    """Policy of what leaves a window after an epoch was added.

    Attributes
    ----------
    determined : float
        Standard deviation of the mass distribution above which no epoch leaves.
    """

    determined: float

    @abstractmethod
    def marginalized_landmarks(self, window: "Window", layout: StateLayout) -> Bool[np.ndarray, " L"]:
        """Landmarks to marginalize."""

    @abstractmethod
    def batch_size(self, epochs: int, mass_std: float) -> int:
        """Number of oldest epochs to marginalize, of so many."""


@dataclass(frozen=True)
class FullSmoothing(WindowPolicy):
    """Window policy of full smoothing: nothing leaves."""

    determined: float = DETERMINED

    def marginalized_landmarks(self, window: "Window", layout: StateLayout) -> Bool[np.ndarray, " L"]:
        """None."""
        return np.zeros(len(window.ids), dtype=bool)

    def batch_size(self, epochs: int, mass_std: float) -> int:
        """None."""
        return 0


@dataclass(frozen=True)
class LandmarkMarginalization(WindowPolicy):
    """Marginalize landmarks that were unobserved for some revolutions.

    The dynamics of every epoch stay, up to a largest window.

    Attributes
    ----------
    revolutions : float
        Of the body, since a landmark was last seen.
    epochs : int
        That stay, at least.
    """

    revolutions: float = 8.0
    epochs: int = 180
    determined: float = DETERMINED

    def __post_init__(self) -> None:
        if not self.revolutions > 0:
            raise InputError(f"revolutions is {self.revolutions}; give a positive number")
        _require_a_step(self.epochs)

    def marginalized_landmarks(self, window: "Window", layout: StateLayout) -> Bool[np.ndarray, " L"]:
        """Landmarks unobserved for so many revolutions, once they are enough."""
        if not len(window.epochs):
            return np.zeros(len(window.ids), dtype=bool)
        time = np.array([epoch.time for epoch in window.epochs])
        turn = _turns(window.trajectory[:, layout.mean_slice("w")], time)
        last = window.last_seen()
        gone = (last >= 0) & (turn[-1] - turn[last] > self.revolutions)
        return gone if np.count_nonzero(gone) >= SMALLEST_LANDMARK_BATCH else np.zeros_like(gone)

    def batch_size(self, epochs: int, mass_std: float) -> int:
        """Epochs beyond the window, once enough have gathered."""
        return _batch_size(self, self.epochs, epochs, mass_std)


@dataclass(frozen=True)
class FixedLag(WindowPolicy):
    """The latest epochs; older ones are marginalized, some together, once the inertia is determined.

    Attributes
    ----------
    epochs : int
        That stay, at least.
    """

    epochs: int = 20
    determined: float = DETERMINED

    def __post_init__(self) -> None:
        _require_a_step(self.epochs)

    def marginalized_landmarks(self, window: "Window", layout: StateLayout) -> Bool[np.ndarray, " L"]:
        """No landmarks but those of marginalized epochs."""
        return np.zeros(len(window.ids), dtype=bool)

    def batch_size(self, epochs: int, mass_std: float) -> int:
        """Epochs beyond the window, once enough have gathered."""
        return _batch_size(self, self.epochs, epochs, mass_std)


def _batch_size(policy: WindowPolicy, kept: int, epochs: int, mass_std: float) -> int:
    """Number of epochs to remove at once, 0 until enough are due; more are kept while the inertia is undetermined."""
    over = epochs - (kept if mass_std <= policy.determined else max(kept, LONGEST_STARTUP))
    return min(over, LARGEST_BATCH) if over >= smallest_batch(kept) else 0


def smallest_batch(kept: int) -> int:
    """Number of excess epochs gathered before marginalization."""
    return min(LARGEST_BATCH, max(1, kept // SHARE))


def _turns(rates: Float[np.ndarray, "k 3"], time: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Revolutions since the first epoch."""
    speed = np.linalg.norm(rates, axis=1)
    steps = np.diff(time) * (speed[1:] + speed[:-1]) / 2
    return np.concatenate([[0.0], np.cumsum(steps)]) / (2 * np.pi)


def _require_a_step(epochs: int) -> None:
    if epochs < 2:
        raise InputError(f"a window of {epochs} epochs holds no step; give at least 2")


@dataclass(frozen=True)
class WindowObservations:
    """Observations that still count, in the order of time.

    Attributes
    ----------
    epoch : ndarray of int, shape (N,)
        Number in the window.
    landmark : ndarray of int, shape (N,)
        Number among the window's.
    sensor : ndarray of int, shape (N,)
        Number of the sensor.
    values : ndarray of float, shape (N, v)
        Measured values.
    parameters : ndarray of float, shape (N, p)
        Without the landmark's point.
    """

    epoch: Int[np.ndarray, " N"]
    landmark: Int[np.ndarray, " N"]
    sensor: Int[np.ndarray, " N"]
    values: Float[np.ndarray, "N v"]
    parameters: Float[np.ndarray, "N p"]
    _growing: "_GrowingColumns | None" = field(default=None, init=False, repr=False, compare=False)
    """Where these are the first rows, if more can be appended."""

    @property
    def columns(self) -> tuple[np.ndarray, ...]:
        """Epochs, landmarks, sensors, values and parameters."""
        return self.epoch, self.landmark, self.sensor, self.values, self.parameters

    def chosen(self, rows: Bool[np.ndarray, " N"]) -> "WindowObservations":
        """Chosen observations."""
        taken = np.flatnonzero(rows)
        return WindowObservations(*(array.take(taken, axis=0) for array in self.columns))

    def plus(self, other: "WindowObservations") -> "WindowObservations":
        """Others after them."""
        count, more = len(self.epoch), len(other.epoch)
        if not count:
            return other
        growing = self._growing
        if growing is None or not growing.has_room(count, more):
            growing = _GrowingColumns(self.columns, SPARE * (count + more))
        growing.append(other.columns)
        found = WindowObservations(*growing.first(count + more))
        object.__setattr__(found, "_growing", growing)
        return found


class _GrowingColumns:
    """Columns with room for more rows, which are appended behind those that are already in use and never change.

    Parameters
    ----------
    columns : tuple[np.ndarray, ...]
        The first rows.
    room : int
        Rows at most.
    """

    def __init__(self, columns: tuple[np.ndarray, ...], room: int) -> None:
        self._columns = [np.empty((room, *column.shape[1:]), column.dtype) for column in columns]
        self._used = 0
        self.append(columns)

    def has_room(self, used: int, more: int) -> bool:
        """Whether so many rows are in use, so that nobody else has appended any, and more have room."""
        return used == self._used and used + more <= len(self._columns[0])

    def append(self, columns: tuple[np.ndarray, ...]) -> None:
        """Append rows."""
        begin, self._used = self._used, self._used + len(columns[0])
        for own, column in zip(self._columns, columns, strict=True):
            own[begin : self._used] = column

    def first(self, count: int) -> list[np.ndarray]:
        """The first rows of every column."""
        return [column[:count] for column in self._columns]


@dataclass(frozen=True)
class Window:
    """Frames, their states, and landmarks.

    A landmark whose observations have been used up is a new one when it is seen again: the old one's position is not
    forgotten, it has
    become part of what is carried.

    Attributes
    ----------
    epochs : tuple[Epoch, ...]
        The k epochs, with their landmark-free measurements.
    trajectory : ndarray of float, shape (k, m)
        State of each epoch.
    seen : WindowObservations
        Their observations.
    models : tuple[LandmarkSensor, ...]
        Sensors of landmarks, by number.
    ids : ndarray of int, shape (L,)
        Ids of the landmarks, each once.
    points : ndarray of float, shape (L, 3)
        Landmark points, m, frame g.
    marginal_prior : MarginalizationPrior or None
        Marginalization prior of the epochs and landmarks that were removed.
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
        s = self.seen
        # stable: of one landmark the observations stay in the order of epochs
        order = order_of_landmarks(s.landmark, len(self.ids))
        groups, every = [], np.arange(len(order))
        for number, model in enumerate(self.models):
            # rows: places of the sensor's observations in that order; at: where they stand in the window
            alone = len(self.models) == 1
            rows = every if alone else np.flatnonzero(s.sensor[order] == number)
            at = order if alone else order[rows]
            groups.append(SensorGroup(model, rows, s.values.take(at, axis=0), s.parameters.take(at, axis=0)))
        counts = np.bincount(s.epoch, minlength=len(self.epochs))
        place = np.zeros(len(order), dtype=int)
        chosen = tuple(group for group in groups if len(group.rows))
        epoch, landmark = s.epoch.take(order), s.landmark.take(order)
        return LandmarkObservations(epoch, landmark, place, counts, len(self.ids), chosen)

    def problem(self, process: ProcessModel, prior: StatePrior | None, has_landmarks: bool) -> Problem:
        """The least-squares problem of the window."""
        known = self.marginal_prior is not None and self.marginal_prior.knows_constants
        first = self.marginal_prior.first[0] if self.marginal_prior is not None and known else None
        motion = motion_of(process, self.epochs, has_landmarks, prior, first)
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
        at, moved = places_among(self.ids, ids), self.points.copy()
        moved[at[at >= 0]] = points[at >= 0]
        return replace(self, points=moved)

    def latest_at(self, pose: Float[np.ndarray, " 7"]) -> "Window":
        """The window with its latest epoch at another pose (t m, q_ig), and with it the landmarks that it alone observed."""
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
    """The window with one sensor's observations in the latest epoch, without those that neither determine nor know a landmark."""
    values, parameters = measured.values, measured.parameters
    models = window.models if any(known is model for known in window.models) else (*window.models, model)
    number = next(k for k, known in enumerate(models) if known is model)
    # number of every observation's landmark in the window, -1 of one that is not there
    landmark = places_among(window.ids, ids)
    fresh, every, points = np.flatnonzero(landmark < 0), window.ids, window.points
    if len(fresh):
        made = model.new_landmarks(window.trajectory[-1], parameters[fresh], values[fresh])
        good = np.flatnonzero(made.determined & np.isfinite(made.points).all(axis=1))
        # of several observations of one new landmark the first makes it; new numbers follow those of the window
        good = good[np.sort(np.unique(ids[fresh[good]], return_index=True)[1])]
        landmark[fresh[good]] = len(every) + np.arange(len(good))
        every = np.concatenate([every, ids[fresh[good]]])
        points = np.concatenate([points, made.points[good]])
    use = np.flatnonzero(landmark >= 0)
    epoch, sensor = np.full(len(use), len(window.epochs) - 1), np.full(len(use), number)
    here = WindowObservations(epoch, landmark[use], sensor, values[use], parameters[use, 3:])
    return replace(window, models=models, ids=every, points=points, seen=window.seen.plus(here))
