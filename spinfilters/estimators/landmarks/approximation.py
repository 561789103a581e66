"""How a filter meets what is nonlinear: the only thing in which EKF and UKF differ.

Both say how errors and sightings depend on the coordinates y of the joint factor (error = F y, y standard normal). The first-order
filter differentiates. The unscented one takes sigma points through what is nonlinear and regresses on y (statistical linear
regression, Lefebvre, Bruyninckx, De Schutter 2002): of the state's n components in a prediction, of the pose and one landmark in a
sighting. Whatever enters linearly - a landmark's constancy, its correlation with everything else - needs no points: what the
regression leaves is noise to all the rest. So neither cost grows faster than the joint factor.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.estimators.estimator import ProcessModel
from spinfilters.estimators.iterated import IterationOptions
from spinfilters.models.anchored_point import anchored_points
from spinfilters.models.landmark_sensor import LandmarkSensor
from spinfilters.models.measurement import MeasurementModel


@dataclass(frozen=True)
class Propagation:
    """Mean after a step; its error is by_root @ y + rest @ f + noise @ e, f and e of unit covariance.

    Attributes
    ----------
    rest: (n, p) what the approximation could not explain by y.   noise: (n, k) of the process.
    transition: (n, n) derivative at the mean.
    """

    mean: Float[np.ndarray, " m"]
    by_root: Float[np.ndarray, "n n"]
    rest: Float[np.ndarray, "n p"]
    noise: Float[np.ndarray, "n k"]
    transition: Float[np.ndarray, "n n"]


@dataclass(frozen=True)
class SightedFrom:
    """What k sightings are predicted from.

    Attributes
    ----------
    mean: the state's point.   root: (n, n) its factor.
    anchors, coordinates: (k, 7) and (k, 3) of the landmarks (`spinfilters.models.anchored_point`).
    linearised_at: (k, 3) coordinates where first derivatives are taken.
    shared: (k, 3, n) factor rows of the landmarks' coordinates on those of the state.
    rest: (k, 3, c) factor rows on the landmarks' coordinates.
    """

    mean: Float[np.ndarray, " m"]
    root: Float[np.ndarray, "n n"]
    anchors: Float[np.ndarray, "k 7"]
    coordinates: Float[np.ndarray, "k 3"]
    linearised_at: Float[np.ndarray, "k 3"]
    shared: Float[np.ndarray, "k 3 n"]
    rest: Float[np.ndarray, "k 3 c"]


@dataclass(frozen=True)
class Rows:
    """Whitened: innovation = by_state @ y[:n] + by_landmark @ (rest of the landmark's error) + unit noise.

    Attributes
    ----------
    innovation: (k, r).   by_state: (k, r, n).   by_landmark: (k, r, 3), or (k, r, 0) where no landmark is seen.   valid: (k,).
    log_noise: (k,) log determinant of what it was whitened with.
    """

    innovation: Float[np.ndarray, "k r"]
    by_state: Float[np.ndarray, "k r n"]
    by_landmark: Float[np.ndarray, "k r l"]
    valid: Bool[np.ndarray, " k"]
    log_noise: Float[np.ndarray, " k"]

    def scaled(self, scale: float) -> "Rows":
        """The same, had the noise ``scale`` times the covariance."""
        if scale == 1:
            return self
        root, dim = np.sqrt(scale), self.innovation.shape[1]
        return Rows(
            self.innovation / root,
            self.by_state / root,
            self.by_landmark / root,
            self.valid,
            self.log_noise + dim * np.log(root),
        )


class Approximation(ABC):
    """See the module's docstring."""

    name: str
    iteration = IterationOptions(iterations=1)
    """Of an update."""

    @abstractmethod
    def propagate(
        self, process: ProcessModel, mean: Float[np.ndarray, " m"], root: Float[np.ndarray, "n n"], dt: float
    ) -> Propagation:
        """The state dt seconds later."""

    @abstractmethod
    def sightings(
        self,
        sensor: LandmarkSensor,
        place: SightedFrom,
        values: Float[np.ndarray, "k v"],
        parameters: Float[np.ndarray, "k p"],
    ) -> Rows:
        """Predicted sightings of landmarks, one per value."""

    @abstractmethod
    def readings(
        self,
        sensor: MeasurementModel,
        place: SightedFrom,
        values: Float[np.ndarray, "k v"],
        parameters: Float[np.ndarray, "k p"],
    ) -> Rows:
        """Predicted values of a sensor that sees no landmark (``by_landmark`` is empty; no landmark of ``place`` is read)."""


class FirstOrder(Approximation):
    """Exact derivatives at the mean; an update is linearised again where that has moved it too far.

    Parameters
    ----------
    iteration: of an update.
    """

    name = "mekf"

    def __init__(self, iteration: IterationOptions | None = None) -> None:
        self.iteration = iteration or IterationOptions()

    def propagate(
        self, process: ProcessModel, mean: Float[np.ndarray, " m"], root: Float[np.ndarray, "n n"], dt: float
    ) -> Propagation:
        after, transition, noise = process.linearise(mean, dt)
        return Propagation(after, transition @ root, np.zeros((len(root), 0)), noise, transition)

    def sightings(
        self,
        sensor: LandmarkSensor,
        place: SightedFrom,
        values: Float[np.ndarray, "k v"],
        parameters: Float[np.ndarray, "k p"],
    ) -> Rows:
        points, slopes = anchored_points(place.anchors, place.coordinates)
        at = sensor.linearise_landmarks(
            place.mean, np.concatenate([points, parameters[:, 3:]], axis=1), values
        )
        jacobian, by_landmark = at.jacobian, at.by_landmark @ slopes
        if place.linearised_at is not place.coordinates:
            points, slopes = anchored_points(place.anchors, place.linearised_at)
            first = np.concatenate([points, parameters[:, 3:]], axis=1)
            elsewhere = sensor.linearise_landmarks(place.mean, first, values)
            jacobian, by_landmark = elsewhere.jacobian, elsewhere.by_landmark @ slopes
        by_state = jacobian @ place.root[sensor.columns] + by_landmark @ place.shared
        return Rows(at.innovation, by_state, by_landmark, at.valid, at.log_noise)

    def readings(
        self,
        sensor: MeasurementModel,
        place: SightedFrom,
        values: Float[np.ndarray, "k v"],
        parameters: Float[np.ndarray, "k p"],
    ) -> Rows:
        at = sensor.linearise(place.mean, parameters, values)
        by_state = at.jacobian @ place.root[sensor.columns]
        return Rows(at.innovation, by_state, np.zeros((*at.innovation.shape, 0)), at.valid, at.log_noise)
