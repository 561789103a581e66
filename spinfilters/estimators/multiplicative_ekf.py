"""The multiplicative extended Kalman filter in square-root form."""

import numpy as np

from spinfilters.estimators.estimator import Measurement
from spinfilters.estimators.gain import MeasurementPrediction, compressed, triangular_factor
from spinfilters.estimators.multiplicative_filter import MultiplicativeFilter, nothing_usable, usable


class MultiplicativeEkf(MultiplicativeFilter):
    """First-order filter: the error's transition and the sensors' Jacobians are exact derivatives at the mean."""

    name = "mekf"

    def predict(self, dt: float) -> None:
        self._mean, transition, noise = self.process.linearise(self._mean, dt)
        self._factor = triangular_factor(np.concatenate([(transition @ self._factor).T, noise.T]))

    def _predict_measurement(self, measurement: Measurement) -> tuple[MeasurementPrediction, int]:
        model = measurement.model
        innovation, jacobian, valid, log_noise = model.linearise(
            self._mean, measurement.parameters, measurement.values
        )
        keep = usable(innovation, valid)
        used = int(np.count_nonzero(keep))
        if not used:
            return nothing_usable(self._factor)
        if used < len(keep):
            innovation, jacobian, log_noise = innovation[keep], jacobian[keep], log_noise[keep]
        columns = model.columns
        rho, H, residual = compressed(innovation.reshape(-1), jacobian.reshape(-1, len(columns)))
        Y = H @ self._factor[columns]
        dof = used * model.dim
        return MeasurementPrediction(rho, Y, self._factor, residual, dof, float(log_noise.sum())), used
