"""The multiplicative extended Kalman filter in square-root form."""

import numpy as np

from spinfilters.estimators.estimator import Measurement
from spinfilters.estimators.gain import MeasurementPrediction, triangular_factor
from spinfilters.estimators.linear_prediction import linear_prediction
from spinfilters.estimators.multiplicative_filter import MultiplicativeFilter


class MultiplicativeEkf(MultiplicativeFilter):
    """First-order filter: the error's transition and the sensors' Jacobians are exact derivatives at the mean."""

    name = "mekf"

    def predict(self, dt: float) -> None:
        self._mean, transition, noise = self.process.linearise(self._mean, dt)
        self._factor = triangular_factor(np.concatenate([(transition @ self._factor).T, noise.T]))

    def _predict_measurement(self, measurement: Measurement) -> tuple[MeasurementPrediction, int]:
        return linear_prediction(measurement, self._mean, self._factor)
