"""The Cramer-Rao bound of what a filter of tracks without a map used.

The posterior bound of a filter is the covariance that the same recursion gives when everything is linearised at the truth instead
of at an estimate (Tichavsky, Muravchik, Nehorai 1998). A filter's decisions - which observations it believed, which landmarks it
took in and let go - are taken from its reports, so that the bound is that of the measurements it used. A landmark that was let go
and came back is a new unknown, as it is for the filter; modes that the filter leaves out, the bound leaves out too.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from spinfilters.estimators.estimator import MapChange, Measurement, ProcessModel
from spinfilters.estimators.filters.multiplicative_ekf import MultiplicativeEkf
from spinfilters.estimators.landmarks.landmark_map import LandmarkOptions
from spinfilters.estimators.landmarks.observations import corrected


@dataclass(frozen=True)
class TrueLandmarks:
    """Where landmarks are: ids (L,) ascending, points (L, 3) m, in the frame g of the true states."""

    ids: Int[np.ndarray, " L"]
    points: Float[np.ndarray, "L 3"]

    def of(self, ids: Int[np.ndarray, " q"]) -> Float[np.ndarray, "q 3"]:
        """Points of these landmarks."""
        return self.points[np.searchsorted(self.ids, ids)]


class CramerRaoBound(MultiplicativeEkf):
    """A filter that always stands at the truth and repeats another one's decisions.

    Parameters
    ----------
    landmarks: the true map.   options: of the filter.
    """

    name = "bound"

    def __init__(
        self, process: ProcessModel, landmarks: TrueLandmarks, options: LandmarkOptions | None = None
    ) -> None:
        super().__init__(process, landmarks=options)
        self._landmarks = landmarks

    def step(self, truth: Float[np.ndarray, " m"], dt: float) -> None:
        """Go on to the true state dt seconds later."""
        self.predict(dt)
        self._mean = truth.copy()

    def repeat(self, measurement: Measurement, change: MapChange) -> None:
        """Take in what another filter took in at this time, and keep house as it did."""
        held = self._with_map()
        gone = held.landmarks.locate(change.removed)
        held.landmarks.remove(gone[gone >= 0])
        true = self._true_measurement(measurement, np.concatenate([change.used, change.added]))
        assert true.ids is not None
        observations = held.observations(self.layout, true, held.landmarks.locate(true.ids), 1.0)
        order = np.argsort(change.used)
        known = true.ids[observations.known]
        weights = change.weights[order[np.searchsorted(change.used, known, sorter=order)]]
        linear = observations.rows_at(self._mean)
        steps, rows = observations.landmarks.steps, np.arange(len(known))
        white = steps.whitened(observations.landmarks, observations.at, linear.rows, weights)
        solved = corrected(observations, linear, white, (rows, weights), self._factor)
        self._factor, _ = held.after(observations, true, solved, self._mean)

    def _true_measurement(self, measurement: Measurement, ids: Int[np.ndarray, " q"]) -> Measurement:
        """Noise-free observations of these landmarks."""
        assert measurement.ids is not None
        order = np.argsort(measurement.ids)
        rows = order[np.searchsorted(measurement.ids, ids, sorter=order)]
        parameters = measurement.parameters[rows].copy()
        parameters[:, :3] = self._landmarks.of(ids)
        values = measurement.model.predict(self._mean, parameters)
        return Measurement(measurement.model, values, parameters, ids)
