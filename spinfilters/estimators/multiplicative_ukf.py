"""The multiplicative unscented Kalman filter in square-root form."""

from dataclasses import dataclass

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import Measurement, ProcessModel
from spinfilters.estimators.gain import MeasurementPrediction, triangular_factor
from spinfilters.estimators.multiplicative_filter import MultiplicativeFilter, nothing_usable, usable


@dataclass(frozen=True)
class SigmaPointOptions:
    """Van der Merwe's scaled set. alpha is chosen so that no covariance weight is negative: with beta = 2 that is alpha >= 0.518."""

    alpha: float = 0.6
    beta: float = 2.0
    kappa: float = 0.0


class MultiplicativeUkf(MultiplicativeFilter):
    """Sigma points on the manifold, set and weights from filterpy.

    Parameters
    ----------
    process: the process model.
    options: of the sigma-point set.

    Raises
    ------
    InputError: when the options give a negative covariance weight, with which a covariance could become indefinite.
    """

    name = "ukf"

    def __init__(self, process: ProcessModel, options: SigmaPointOptions | None = None) -> None:
        super().__init__(process)
        options = options or SigmaPointOptions()
        n = self.layout.error_dim
        points = MerweScaledSigmaPoints(n, options.alpha, options.beta, options.kappa)
        if np.min(points.Wc) < 0:
            raise InputError(
                f"sigma points with alpha={options.alpha}, beta={options.beta} have a covariance weight of {np.min(points.Wc):.3g}"
                "; choose alpha >= 0.518 with beta = 2 so that covariances stay positive"
            )
        self._offsets = points.sigma_points(np.zeros(n), np.eye(n))
        self._mean_weights = points.Wm
        self._root_weights = np.sqrt(points.Wc)

    def predict(self, dt: float) -> None:
        noise = self.process.linearise(self._mean, dt)[2]
        moved = self.process.step(self._sigma_points(), dt)
        centre = moved[0]
        shift = self._mean_weights @ self.layout.local(centre, moved)
        self._mean = self.layout.retract(centre, shift)
        deviations = self._root_weights[:, None] * self.layout.local(self._mean, moved)
        self._factor = triangular_factor(np.concatenate([deviations, noise.T]))

    def _sigma_points(self) -> Float[np.ndarray, "p m"]:
        return self.layout.retract(self._mean, self._offsets @ self._factor.T)

    def _predict_measurement(self, measurement: Measurement) -> tuple[MeasurementPrediction, int]:
        model, parameters, values = measurement.model, measurement.parameters, measurement.values
        innovations, valid = model.innovations(self._sigma_points()[:, None], parameters, values)
        keep = usable(innovations, valid).all(axis=0)
        used = int(np.count_nonzero(keep))
        if not used:
            return nothing_usable(self._factor)
        whitening = model.whitening(self._mean, parameters)
        if used < len(keep):
            innovations, whitening = innovations[:, keep], whitening[keep]
        whitened = (whitening @ innovations[..., None]).reshape(len(innovations), -1)
        mean = self._mean_weights @ whitened
        Y = (self._root_weights[:, None] * (mean - whitened)).T
        X = (self._root_weights[:, None] * (self._offsets @ self._factor.T)).T
        log_noise = -float(np.log(np.diagonal(whitening, axis1=-2, axis2=-1)).sum())
        return MeasurementPrediction(mean, Y, X, 0.0, used * model.dim, log_noise), used
