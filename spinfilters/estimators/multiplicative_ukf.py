"""The multiplicative unscented Kalman filter in square-root form."""

from dataclasses import dataclass

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints
from jaxtyping import Float, Int

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import Measurement, ProcessModel
from spinfilters.estimators.gain import MeasurementPrediction, compressed, triangular_factor
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
        distinct, which = self._distinct(model.columns)
        points = self.layout.retract(self._mean, self._offsets[distinct] @ self._factor.T)
        innovations, valid = model.innovations(points[:, None], parameters, values)
        keep = usable(innovations, valid).all(axis=0)
        used = int(np.count_nonzero(keep))
        if not used:
            return nothing_usable(self._factor)
        whitening = model.whitening(self._mean, parameters[keep])
        whitened = np.einsum("kij,pkj->pki", whitening, innovations[:, keep]).reshape(len(points), -1)
        mean = np.bincount(which, self._mean_weights) @ whitened
        rho, Y, residual = compressed(mean, (mean - whitened).T)
        X = (self._root_weights[:, None] * (self._offsets @ self._factor.T)).T
        log_noise = -float(np.log(np.diagonal(whitening, axis1=-2, axis2=-1)).sum())
        dof = used * model.dim
        return MeasurementPrediction(rho, Y[:, which] * self._root_weights, X, residual, dof, log_noise), used

    def _distinct(self, columns: list[int]) -> tuple[Int[np.ndarray, " d"], Int[np.ndarray, " p"]]:
        """Sigma points that differ in these error components, the centre first, and which of them stands for each point.

        The factor is lower triangular, so a sensor of the pose sees 13 different points of the 41 of the full state.
        """
        moving = 1 + np.flatnonzero(self._factor[columns].any(axis=0))
        distinct = np.concatenate([[0], moving, moving + self.layout.error_dim])
        which = np.zeros(len(self._offsets), dtype=int)
        which[distinct] = np.arange(len(distinct))
        return distinct, which
