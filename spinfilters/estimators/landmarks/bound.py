"""The Cramer-Rao bound of what a landmark filter used.

The posterior bound of a filter is the covariance that the same recursion gives when everything is linearised at the truth instead
of at an estimate (Tichavsky, Muravchik, Nehorai 1998). A filter's decisions - which sightings it believed, which landmarks it took
in and let go - are taken from its reports, so that the bound is that of the measurements it used. A landmark that was let go and
came back is a new unknown, as it is for the filter.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from spinfilters.estimators.estimator import MapChange, Measurement, ProcessModel
from spinfilters.estimators.iterated import IterationOptions
from spinfilters.estimators.landmarks.approximation import FirstOrder
from spinfilters.estimators.landmarks.joint_factor import after_correction, corrected
from spinfilters.estimators.landmarks.landmark_filter import LandmarkFilter
from spinfilters.estimators.landmarks.landmark_map import LandmarkOptions
from spinfilters.estimators.landmarks.sightings import predicted_sightings, stacked


@dataclass(frozen=True)
class TrueLandmarks:
    """Where landmarks are: ids (L,) ascending, points (L, 3) m, in the frame g of the true states."""

    ids: Int[np.ndarray, " L"]
    points: Float[np.ndarray, "L 3"]

    def of(self, ids: Int[np.ndarray, " q"]) -> Float[np.ndarray, "q 3"]:
        """Points of these landmarks."""
        return self.points[np.searchsorted(self.ids, ids)]


class CramerRaoBound(LandmarkFilter):
    """A landmark filter that always stands at the truth and repeats another one's decisions.

    Parameters
    ----------
    landmarks: the true map.
    """

    def __init__(self, process: ProcessModel, landmarks: TrueLandmarks) -> None:
        super().__init__(
            process, FirstOrder(IterationOptions(iterations=1)), LandmarkOptions(capacity=1 << 30)
        )
        self.name = "bound"
        self._landmarks = landmarks

    def step(self, truth: Float[np.ndarray, " m"], dt: float) -> None:
        """Go on to the true state dt seconds later."""
        self.predict(dt)
        self._mean = truth.copy()

    def repeat(self, measurement: Measurement, change: MapChange) -> None:
        """Take in what another filter took in at this time, and keep house as it did."""
        assert measurement.ids is not None
        order = np.argsort(self._map.locate(change.used), kind="stable")
        used, weights = change.used[order], change.weights[order]
        at = self._map.locate(used)
        rows, _ = predicted_sightings(
            self._approximation, self._joint, self._true_sightings(measurement, used), at
        )
        found = corrected(*stacked(rows, weights, at, self._factor))
        self._factor = after_correction(self._factor, found)
        self._drop(~np.isin(self._map.ids, change.removed))
        self._take_in(self._true_sightings(measurement, change.added), change.added)

    def _true_sightings(self, measurement: Measurement, ids: Int[np.ndarray, " q"]) -> Measurement:
        """Noise-free sightings of these landmarks."""
        assert measurement.ids is not None
        rows = np.flatnonzero(np.isin(measurement.ids, ids))
        rows = rows[np.argsort(measurement.ids[rows])][np.argsort(np.argsort(ids))]
        parameters = measurement.parameters[rows].copy()
        parameters[:, :3] = self._landmarks.of(ids)
        values = measurement.model.predict(self._mean, parameters)
        return Measurement(measurement.model, values, parameters)
