"""Interface of recursive estimators: their beliefs, with landmarks or without, measurements, and reports of updates."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.errors import InputError, ShapeError
from spinfilters.filters.square_root import triangular_factor
from spinfilters.models.batched_linearisation import StepsScan
from spinfilters.models.gauge import GAUGE_DIM, gauge_of_points, moved_points, state_in_g
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.rotation_integrator import (
    LinearisedLoops,
    LinearisedScan,
    LinearisedStep,
    LinearisedSteps,
    StepLoops,
)
from spinfilters.models.state_layout import Gaussian, StateLayout
from spinfilters.models.status import EstimatorStatus


@dataclass(frozen=True)
class Measurement:
    """Values of one sensor at one instant.

    Attributes
    ----------
    model : MeasurementModel
        The sensor.
    values : ndarray of float, shape (k, v)
        Measured values, k at least 0.
    parameters : ndarray of float, shape (k, p)
        What accompanies each value (landmark, calibration, noise).
    ids : ndarray of int, shape (k,) or None
        Landmarks that an estimator holds in its own state, each once; their points in ``parameters`` are then not read.
        None where the map is known, and for sensors without landmarks.
    """

    model: MeasurementModel
    values: Float[np.ndarray, "k v"]
    parameters: Float[np.ndarray, "k p"]
    ids: Int[np.ndarray, " k"] | None = None


@dataclass(frozen=True, eq=False)
class SensorTimeline:
    """All measurements of one sensor, and which of them belong to each epoch.

    Attributes
    ----------
    every : Measurement
        All values as if they were measured at once.
    first, end : ndarray of int, shape (k,)
        Epoch k holds the values from first to before end.
    """

    every: Measurement
    first: Int[np.ndarray, " k"]
    end: Int[np.ndarray, " k"]

    def measured(self, epoch: int) -> list[Measurement]:
        """The measurement of an epoch, none where the sensor measured nothing then."""
        every, rows = self.every, slice(int(self.first[epoch]), int(self.end[epoch]))
        if rows.start == rows.stop:
            return []
        ids = None if every.ids is None else every.ids[rows]
        return [Measurement(every.model, every.values[rows], every.parameters[rows], ids)]


@dataclass(frozen=True, eq=False)
class EpochRun:
    """Consecutive epochs.

    Attributes
    ----------
    dt : ndarray of float, shape (k,)
        Seconds from the epoch before to each; positive. In `Estimator.take_in_runs` the first may be zero: the belief holds at it.
    sensors : tuple[SensorTimeline, ...]
        In the order in which each epoch takes them in.
    """

    dt: Float[np.ndarray, " k"]
    sensors: tuple[SensorTimeline, ...]


@dataclass(frozen=True, eq=False)
class RunsTaken:
    """What the epochs of many runs left behind.

    Attributes
    ----------
    rows : dict[str, ndarray]
        mean (r, k, m), factor (r, k, n, n), and nis, log_likelihood, dof, accepted and rejected (r, k), as of
        `Estimator.take_in`.
    done : ndarray of int, shape (r,)
        How many epochs of each run were taken in; rows after them hold nothing.
    """

    rows: dict[str, np.ndarray]
    done: Int[np.ndarray, " r"]


COUNTS: Final = ("dof", "accepted", "rejected")
"""Arrays of a history that hold whole numbers."""
NO_IDS = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class MapChange:
    """Change of the landmarks in the state by an update: ids that it used, with their weights, added and removed."""

    used: Int[np.ndarray, " u"]
    weights: Float[np.ndarray, " u"]
    added: Int[np.ndarray, " a"]
    removed: Int[np.ndarray, " r"]


@dataclass(frozen=True)
class UpdateReport:
    """Innovation, degrees of freedom and outcome of an update.

    Attributes
    ----------
    nis : float
        Normalised innovation squared, chi-square distributed with ``dof`` degrees of freedom when the filter is consistent.
    dof : int
        Number of scalar measurements used.
    accepted, rejected : int
        Numbers of measurements used, the first of a landmark among them, and left out (point at or behind the camera, not
        finite, refused).
    log_likelihood : float
        Log likelihood of the values used, given everything before.
    map_change : MapChange or None
        Change of the map by an estimator with landmarks in its state, None otherwise.
    """

    nis: float
    dof: int
    accepted: int
    rejected: int
    log_likelihood: float = 0.0
    map_change: MapChange | None = None


class ProcessModel(Protocol):
    """Process model of a filter, as `spinfilters.models.process.TorqueFreeProcess`."""

    @property
    def layout(self) -> StateLayout:
        """Layout of the states."""
        ...

    def step(self, x: Float[np.ndarray, "*batch m"], dt: float) -> Float[np.ndarray, "*batch m"]:
        """States ``dt`` seconds later without disturbances, shape as ``x``."""
        ...

    def linearise(self, x: Float[np.ndarray, " m"], dt: float) -> LinearisedStep:
        """One step of ``dt`` seconds, linearised at ``x``."""
        ...

    def linearised_loops(self) -> LinearisedLoops | None:
        """Compiled loops of `linearise`; None where there are none."""
        ...

    @property
    def linearised_scan(self) -> LinearisedScan | None:
        """`linearise` of many points side by side; None where there is none."""
        ...

    def steps_scan(self) -> StepsScan | None:
        """Compiled scan of `linearise_steps`; None where there is none."""
        ...

    def step_loops(self) -> StepLoops | None:
        """Compiled loops of `step` for many points; None where there are none."""
        ...

    def linearise_steps(
        self,
        here: Float[np.ndarray, "s m"],
        there: Float[np.ndarray, "s m"],
        dt: Float[np.ndarray, " s"],
        about: Float[np.ndarray, "s m"] | None = None,
    ) -> LinearisedSteps:
        """Steps from ``here`` to ``there``, each linearised at ``here`` or ``about``."""
        ...


Snapshot = dict[str, np.ndarray]
"""An estimator's whole state as arrays of numbers: what a checkpoint file holds, and what a late measurement goes back to."""


class Estimator(ABC):
    """A recursive estimator: start, then predict and update in the order of time."""

    name: str

    def __init__(self, process: ProcessModel) -> None:
        self.process = process
        self.layout = process.layout

    @abstractmethod
    def start(self, belief: Gaussian) -> None:
        """Begin from a belief over the process' layout."""

    def rebase(self, belief: "Belief") -> None:
        """Restart from a smoothed belief of the present time, landmarks included.

        Landmarks that only the estimator holds are dropped: their measurements went into the smoother's state too, and
        the correlation of their errors is unknown.
        """
        self.start(belief.state)

    @property
    def mode_count(self) -> int:
        """Modes that the landmarks of its map share; 0 without a map."""
        return 0

    @property
    @abstractmethod
    def belief(self) -> Gaussian:
        """The present belief."""

    @property
    def status(self) -> EstimatorStatus:
        """Estimator's own verdict on its present belief; ok unless it has a check of its own."""
        return EstimatorStatus()

    @abstractmethod
    def predict(self, dt: float) -> None:
        """Move the belief dt > 0 seconds ahead."""

    @abstractmethod
    def update(self, measurement: Measurement) -> UpdateReport:
        """Update with one sensor's values at the present time."""

    def update_all(self, measurements: Sequence[Measurement]) -> list[UpdateReport]:
        """Update by all measurements of the present time, in their order.

        An estimator that solves a whole problem anew (a smoother) does so once for all of them.
        """
        return [self.update(measurement) for measurement in measurements]

    def take_in(self, epochs: EpochRun, rows: Mapping[str, np.ndarray]) -> int:
        """Predict and update through consecutive epochs in one call, to the numbers of single ones.

        Parameters
        ----------
        epochs : EpochRun
            From the present time on.
        rows : Mapping[str, ndarray]
            A row per epoch to be written: mean, factor, nis, log_likelihood, dof, accepted and rejected.

        Returns
        -------
        int
            How many epochs were taken in; the next one needs `predict` and `update`.
        """
        return 0

    def take_in_runs(
        self, epochs: EpochRun, mean: Float[np.ndarray, "r m"], factor: Float[np.ndarray, "r n n"]
    ) -> RunsTaken | None:
        """Take many runs of the same epochs in, each from a belief of its own, to the numbers of a run by itself.

        The estimator itself stays as it was started: its own belief is neither read nor replaced.

        Parameters
        ----------
        epochs : EpochRun
            Of the first run; its sensors hold the values of all runs, one run behind the other.
        mean, factor : ndarray
            The beliefs before, one of each run.

        Returns
        -------
        RunsTaken or None
            None where runs can only be made one by one.
        """
        return None

    def build_take_in(self, models: Sequence[MeasurementModel]) -> None:  # noqa: B027 - most estimators have none
        """Build what `take_in` computes with for sensors of these models, before a clock runs; nothing by default."""

    @abstractmethod
    def snapshot(self) -> Snapshot:
        """Copies of the whole internal state as named arrays."""

    @abstractmethod
    def restore(self, snapshot: Snapshot) -> None:
        """Continue from a `snapshot` of an estimator built alike, with the same numbers bit for bit."""


@dataclass(frozen=True)
class Updated:
    """A belief after an update, and what the update did."""

    belief: Gaussian
    report: UpdateReport


class RecursiveEstimator(Protocol):
    """Recursive estimator as functions of immutable beliefs.

    The same arguments give the same belief, bit for bit.
    """

    @property
    def name(self) -> str:
        """Name of the estimator in tables and files."""
        ...

    def predict(self, belief: Gaussian, dt: float) -> Gaussian:
        """The belief dt > 0 seconds later."""
        ...

    def update(self, belief: Gaussian, measurement: Measurement) -> Updated:
        """The belief given one sensor's values at its time."""
        ...


class LatestBelief(Estimator):
    """A recursive estimator with its latest belief: what runs, checkpoints and late measurements take."""

    def __init__(self, process: ProcessModel, recursive: RecursiveEstimator) -> None:
        super().__init__(process)
        self.name, self._recursive = recursive.name, recursive
        self._belief = Gaussian(
            self.layout, self.layout.origin(), np.full((self.layout.error_dim,) * 2, np.nan)
        )

    def start(self, belief: Gaussian) -> None:
        """Begin with a belief. InputError: blocks other than the process'."""
        if belief.layout != self.layout:
            raise InputError(
                f"belief has the blocks {belief.layout.blocks}, the process has {self.layout.blocks}"
            )
        self._belief = belief

    @property
    def belief(self) -> Gaussian:
        """Latest belief."""
        return self._belief

    def predict(self, dt: float) -> None:
        """Replace the belief by its prediction ``dt`` seconds ahead."""
        self._belief = self._recursive.predict(self._belief, dt)

    def update(self, measurement: Measurement) -> UpdateReport:
        """Replace the belief by its update, and report that."""
        updated = self._recursive.update(self._belief, measurement)
        self._belief = updated.belief
        return updated.report

    def snapshot(self) -> Snapshot:
        """Copies of the belief's mean and covariance factor."""
        return {"mean": self._belief.mean.copy(), "factor": self._belief.factor.copy()}

    def restore(self, snapshot: Snapshot) -> None:
        """Take mean and covariance factor from a `snapshot`."""
        self._belief = Gaussian(self.layout, snapshot["mean"].copy(), snapshot["factor"].copy())


@dataclass(frozen=True)
class LandmarkBelief:
    """Belief of a state, shared modes and landmarks.

    The error of landmark i is d_i = modes_i m + roots_i e_i, with r modes m that all landmarks share and an error e_i of its own.

    All of it refers to the map's frame, in which no rigid motion of all landmarks together is uncertain. Frame g of the state that
    is asked for differs by a small move (theta, rho), whose error stands in the factor too: nothing observed depends on it.

    Attributes
    ----------
    layout : StateLayout
        Layout of the state.
    mean : ndarray of float, shape (m,)
        Mean of the state.
    move : ndarray of float, shape (6,)
        Most probable move from the map's frame to g (`models.gauge`).
    ids : ndarray of int, shape (k,)
        Ids of the landmarks, each once.
    points : ndarray of float, shape (k, 3)
        Landmark points, m, in the map's frame.
    modes : ndarray of float, shape (k, 3, r)
        Dependence of the landmarks' errors on the shared modes.
    roots : ndarray of float, shape (k, 3, 3)
        Square roots of the covariances of their own errors.
    factor : ndarray of float, shape (N, N)
        Covariance factor of the errors of state (n), modes (r) and, where N = n + r + 6, the move.
    """

    layout: StateLayout
    mean: Float[np.ndarray, " m"]
    ids: Int[np.ndarray, " k"]
    points: Float[np.ndarray, "k 3"]
    modes: Float[np.ndarray, "k 3 r"]
    roots: Float[np.ndarray, "k 3 3"]
    factor: Float[np.ndarray, "N N"]
    move: Float[np.ndarray, " 6"]

    def __post_init__(self) -> None:
        size = self.layout.error_dim + self.modes.shape[2]
        if self.mean.shape != (self.layout.mean_dim,) or self.factor.shape not in (
            (size, size),
            (size + GAUGE_DIM, size + GAUGE_DIM),
        ):
            raise ShapeError(
                f"a belief over {self.layout.blocks} and {self.modes.shape[2]} modes needs a mean ({self.layout.mean_dim},) and a "
                f"factor of {size} or {size + GAUGE_DIM} rows, got {self.mean.shape} and {self.factor.shape}"
            )
        if len(np.unique(self.ids)) < len(self.ids):
            raise InputError("a landmark occurs twice in a belief; give each id once")

    @property
    def state(self) -> Gaussian:
        """The state alone, in frame g."""
        mean, rows = self._state_rows()
        return Gaussian(self.layout, mean, triangular_factor(rows.T))

    @property
    def joint(self) -> "LandmarkBelief":
        """The belief itself: state and landmarks together."""
        return self

    @property
    def points_in_g(self) -> Float[np.ndarray, "k 3"]:
        """Landmarks in frame g, m."""
        return moved_points(self.points, self.move)

    def joint_factor(self) -> Float[np.ndarray, "j j"]:
        """Lower triangular factor of the errors of the state and of all points, in frame g."""
        n, r, k = self.layout.error_dim, self.modes.shape[2], len(self.ids)
        rows = (self.modes @ self.factor[n : n + r]).reshape(3 * k, -1)
        if len(self.factor) > n + r:
            rows = rows + gauge_of_points(self.points_in_g) @ self.factor[n + r :]
        own = np.zeros((k, 3, k, 3))
        own[np.arange(k), :, np.arange(k)] = self.roots
        top = np.concatenate([self._state_rows()[1], np.zeros((n, 3 * k))], axis=1)
        return triangular_factor(
            np.concatenate([top, np.concatenate([rows, own.reshape(3 * k, -1)], axis=1)]).T
        )

    def with_modes(self, rank: int) -> "LandmarkBelief":
        """The belief padded to at least so many modes."""
        n, r = self.layout.error_dim, self.modes.shape[2]
        more = max(rank - r, 0)
        modes = np.pad(self.modes, [(0, 0), (0, 0), (0, more)])
        place = np.r_[0 : n + r, n + r + more : len(self.factor) + more]
        factor = np.eye(len(self.factor) + more)
        factor[np.ix_(place, place)] = self.factor
        return replace(self, modes=modes, factor=factor)

    def _state_rows(self) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "n N"]]:
        n = self.layout.error_dim
        if len(self.factor) == n + self.modes.shape[2]:
            return self.mean, self.factor[:n]
        return state_in_g(self.layout, self.mean, self.factor, self.move)


Belief = Gaussian | LandmarkBelief
"""Of a state, alone or with landmarks: `state` is the one, `joint` the other or None."""
