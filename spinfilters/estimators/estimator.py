"""Interface of recursive estimators, and the report of an update."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from jaxtyping import Float, Int

from spinfilters.models.linearised_step import LinearisedStep, LinearisedSteps
from spinfilters.models.measurement import MeasurementModel
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.layout import StateLayout
from spinfilters.state.status import EstimatorStatus

if TYPE_CHECKING:
    from spinfilters.estimators.landmarks.belief import Belief


@dataclass(frozen=True)
class Measurement:
    """Values of one sensor at one instant.

    Attributes
    ----------
    model: the sensor.
    values: (k, value_dim) measured values, k at least 0.
    parameters: (k, parameter_dim) what accompanies each value (landmark, calibration, noise).
    ids: (k,) landmarks that an estimator holds in its own state, each once; their points in ``parameters`` are then not read.
        None where the map is known, and for sensors without landmarks.
    """

    model: MeasurementModel
    values: Float[np.ndarray, "k v"]
    parameters: Float[np.ndarray, "k p"]
    ids: Int[np.ndarray, " k"] | None = None


NO_IDS = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class MapChange:
    """Change of the landmarks in the state by an update.

    Ids that it used (with their weights), took in, and let go.
    """

    used: Int[np.ndarray, " u"]
    weights: Float[np.ndarray, " u"]
    added: Int[np.ndarray, " a"]
    removed: Int[np.ndarray, " r"]


@dataclass(frozen=True)
class UpdateReport:
    """Innovation, degrees of freedom and outcome of an update.

    Attributes
    ----------
    nis: normalised innovation squared, chi-square distributed with ``dof`` degrees of freedom when the filter is consistent.
    dof: number of scalar measurements used.
    accepted, rejected: numbers of measurements used, the first of a landmark among them, and left out (point at or behind the
        camera, not finite, refused).
    log_likelihood: of the values used, given everything before.
    map_change: of an estimator that holds landmarks in its state, None otherwise.
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

        Landmarks that only the estimator holds go: what told them has told the smoother's state too, and
        nobody knows how their errors depend on one another.
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
        """Estimator's own verdict on its present belief; ok unless it can tell."""
        return EstimatorStatus()

    @abstractmethod
    def predict(self, dt: float) -> None:
        """Move the belief dt > 0 seconds ahead."""

    @abstractmethod
    def update(self, measurement: Measurement) -> UpdateReport:
        """Update with one sensor's values at the present time."""

    def update_all(self, measurements: Sequence[Measurement]) -> list[UpdateReport]:
        """Update by everything of the present time, in its order.

        An estimator that solves anew does so once.
        """
        return [self.update(measurement) for measurement in measurements]

    @abstractmethod
    def snapshot(self) -> Snapshot:
        """Copies of the whole internal state as named arrays."""

    @abstractmethod
    def restore(self, snapshot: Snapshot) -> None:
        """Continue from a `snapshot` of an estimator built alike.

        The same numbers follow, bit for bit.
        """
