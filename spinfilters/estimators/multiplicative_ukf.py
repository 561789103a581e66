"""The multiplicative unscented Kalman filter in square-root form."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import Measurement, ProcessModel
from spinfilters.estimators.gain import MeasurementPrediction, compressed, last_nonzero, triangular_factor
from spinfilters.estimators.multiplicative_filter import MultiplicativeFilter, nothing_usable, usable


@dataclass(frozen=True)
class SigmaPointOptions:
    """Van der Merwe's scaled set; no covariance weight may be negative: with beta = 2 that asks for alpha >= 0.518."""

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
        self._subset = cache(self._build_subset)

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
        model, n = measurement.model, self.layout.error_dim
        seen = last_nonzero(self._factor[model.columns])
        subset = self._subset(seen)
        points = self.layout.retract(self._mean, subset.offsets @ self._factor.T)
        innovation, valid, log_noise = model.innovations_at(
            points, self._mean, measurement.parameters, measurement.values
        )
        keep = usable(innovation.reshape(len(valid), model.dim * len(points)), valid)
        used = int(np.count_nonzero(keep))
        if not used:
            return nothing_usable(self._factor)
        if used < len(keep):
            innovation, log_noise = innovation[keep], log_noise[keep]
        rows = innovation.reshape(-1, len(points))
        mean = rows @ subset.mean_weights
        rho, H, residual = compressed(mean, mean[:, None] - rows)
        X = np.concatenate([np.zeros((n, seen + 1)), self._factor], axis=1)
        dof = used * model.dim
        return MeasurementPrediction(rho, H @ subset.mixing, X, residual, dof, float(log_noise.sum())), used

    def _build_subset(self, seen: int) -> "_SigmaSubset":
        n = self.layout.error_dim
        pairs = np.arange(1, seen + 1)
        chosen = np.concatenate([[0], pairs, pairs + n])
        weight, unseen = self._root_weights[1], 2 * (n - seen)
        mean_weights = self._mean_weights[chosen]
        mean_weights[0] += unseen * self._mean_weights[1]
        mixing = np.zeros((2 * seen + 1, seen + 1 + n))
        mixing[0, 0] = np.sqrt(self._root_weights[0] ** 2 + unseen * weight**2)
        plus, minus = pairs, pairs + seen
        mixing[plus, pairs] = mixing[minus, pairs] = weight / np.sqrt(2)
        mixing[plus, pairs + seen] = weight / np.sqrt(2)
        mixing[minus, pairs + seen] = -weight / np.sqrt(2)
        return _SigmaSubset(self._offsets[chosen], mean_weights, mixing)


@dataclass(frozen=True)
class _SigmaSubset:
    """The points of a set that differ in what a sensor sees, when that moves only with the first r columns of the factor L.

    The other points coincide with the centre there. A pair of points at +- one column of L is turned into its sum and difference,
    an orthogonal change that leaves every covariance as it is: sums have nothing of the state, differences are that column. So
    X = [0 | L] with Y = deviations @ mixing = [centre and sums | differences | 0], where r = 6 of 20 columns move a pose.

    Attributes
    ----------
    offsets: (2r + 1, n) centre, plus and minus points in units of L.
    mean_weights: (2r + 1,).   mixing: (2r + 1, r + 1 + n).
    """

    offsets: Float[np.ndarray, "p n"]
    mean_weights: Float[np.ndarray, " p"]
    mixing: Float[np.ndarray, "p r"]
