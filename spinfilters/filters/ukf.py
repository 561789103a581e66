"""The multiplicative unscented Kalman filter in square-root form."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Float

from spinfilters.filters.compiled_steps import Update
from spinfilters.filters.estimator import Measurement, ProcessModel
from spinfilters.filters.filter import MultiplicativeFilter, joined_rows, reset_factor
from spinfilters.filters.landmark_observations import Regression, SolvedObservations, solve
from spinfilters.filters.landmark_steps import MapObservations
from spinfilters.filters.measurement_prediction import SigmaPointOptions, usable
from spinfilters.filters.noise_levels import AdaptationOptions, PredictedMotion
from spinfilters.filters.outlier_rejection import RobustOptions, SensorOutlierRejection
from spinfilters.filters.shared_modes import LandmarkOptions
from spinfilters.filters.square_root import (
    MeasurementPrediction,
    compressed,
    is_lower,
    last_nonzero,
    square_root_update,
    triangular_factor,
)


class MultiplicativeUkf(MultiplicativeFilter):
    """Sigma points on the manifold, set and weights from filterpy.

    Parameters
    ----------
    process : ProcessModel
        See `MultiplicativeFilter`.
    robust : RobustOptions or None
        See `MultiplicativeFilter`.
    adaptation : AdaptationOptions or None
        See `MultiplicativeFilter`.
    landmarks : LandmarkOptions or None
        See `MultiplicativeFilter`.
    options : SigmaPointOptions or None
        Options of the sigma-point set.

    Raises
    ------
    InputError
        As `SigmaPointOptions.points`.
    """

    name = "ukf"

    def __init__(
        self,
        process: ProcessModel,
        options: SigmaPointOptions | None = None,
        robust: RobustOptions | None = None,
        adaptation: AdaptationOptions | None = None,
        landmarks: LandmarkOptions | None = None,
    ) -> None:
        super().__init__(process, robust, adaptation, landmarks)
        n, self._points_options = self.layout.error_dim, options or SigmaPointOptions()
        points = self._points_options.points(n)
        self._offsets = points.sigma_points(np.zeros(n), np.eye(n))
        self._mean_weights = points.Wm
        self._root_weights = np.sqrt(points.Wc)
        self._subset = cache(self._build_subset)

    def _moved(self, dt: float) -> PredictedMotion:
        _, transition, noise = self.process.linearise(self._mean, dt)
        noise = self._adaptation.scaled(noise)
        self._factor = self._triangular()
        moved = self.process.step(self._sigma_points(), dt)
        centre = moved[0]
        shift = self._mean_weights @ self.layout.local(centre, moved)
        mean = self.layout.retract(centre, shift)
        deviations = self._root_weights[:, None] * self.layout.local(mean, moved)
        if self._held is None:
            factor = triangular_factor(np.concatenate([deviations, noise.T]))
            return PredictedMotion(mean, factor, transition, noise)
        scaled = self._root_weights[:, None] * self._offsets
        rows = np.zeros((self._n, len(self._factor)))
        rows[:, : self._n] = deviations.T @ scaled
        rest = deviations.T - rows[:, : self._n] @ scaled.T
        factor = joined_rows(self._factor, rows, np.concatenate([rest, noise], axis=1))
        return PredictedMotion(mean, factor, transition, noise)

    def _triangular(self) -> Float[np.ndarray, "N N"]:
        """The factor with the state's rows on its first coordinates alone, as sigma points need it."""
        if self._held is None or is_lower(self._factor[: self._n]):
            return self._factor
        return triangular_factor(self._factor.T)

    def _sigma_points(self) -> Float[np.ndarray, "p m"]:
        return self.layout.retract(self._mean, self._offsets @ self._factor[: self._n, : self._n].T)

    def _corrected(
        self, measurement: Measurement, guard: SensorOutlierRejection, scale: float
    ) -> Update | None:
        self._factor = self._triangular()
        subset = self._subset(last_nonzero(self._factor[measurement.model.columns]))
        seen = self._seen(measurement, subset)
        if len(seen.log_noise) and scale != 1:
            seen = seen.weighted(np.full(len(seen.log_noise), 1 / scale))
        weights = guard.weights(
            seen.mean, lambda chosen: (seen.mean[chosen, :, np.newaxis] - seen.points[chosen]) @ subset.mixing
        )
        if weights is not None:
            seen = seen.weighted(weights)
        if not seen.mean.size:
            return None
        mean, points = seen.mean.reshape(-1), seen.points.reshape(seen.mean.size, -1)
        rho, H, residual = compressed(mean, mean[:, np.newaxis] - points)
        size, n = len(self._factor), self._n
        X = np.concatenate([np.zeros((size, subset.mixing.shape[1] - n)), self._factor], axis=1)
        log_noise = float(seen.log_noise.sum())
        Y = H @ subset.mixing
        if size > n:  # what stands behind the state is not seen
            Y = np.concatenate([Y, np.zeros((len(Y), size - n))], axis=1)
        prediction = MeasurementPrediction(rho, Y, X, residual, mean.size, log_noise)
        correction = square_root_update(prediction)
        mean = self.layout.retract(self._mean, correction.error[:n])
        return Update(mean, correction, reset_factor(self.layout, correction.error, correction.factor))

    def _solved(self, observations: MapObservations, guard: SensorOutlierRejection) -> SolvedObservations:
        self._factor = self._triangular()
        regression = Regression(observations, self._mean, self._factor)
        return solve(observations, regression.rows(self._points_options), self._factor, guard)

    def _seen(self, measurement: Measurement, subset: "_SigmaSubset") -> "_SeenPoints":
        """The usable values as the points see them."""
        model = measurement.model
        points = self.layout.retract(self._mean, subset.offsets @ self._factor[: self._n, : self._n].T)
        innovation, valid, log_noise = model.innovations_at(
            points, self._mean, measurement.parameters, measurement.values
        )
        keep = usable(innovation.reshape(len(valid), model.dim * len(points)), valid)
        if not keep.all():
            innovation, log_noise = innovation[keep], log_noise[keep]
        return _SeenPoints(innovation @ subset.mean_weights, innovation, log_noise)

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
class _SeenPoints:
    """Whitened innovations of k values at the sigma points.

    Their mean (k, d), at each of the p points (k, d, p), and log determinants of the noise.
    """

    mean: Float[np.ndarray, "k d"]
    points: Float[np.ndarray, "k d p"]
    log_noise: Float[np.ndarray, " k"]

    def weighted(self, weights: Float[np.ndarray, " k"]) -> "_SeenPoints":
        """Values with their noise covariance divided by the weights. Those of weight 0 are left out."""
        used = weights > 0
        root = np.sqrt(weights[used])
        if (root == 1).all():
            return _SeenPoints(self.mean[used], self.points[used], self.log_noise[used])
        return _SeenPoints(
            self.mean[used] * root[:, np.newaxis],
            self.points[used] * root[:, np.newaxis, np.newaxis],
            self.log_noise[used] - self.mean.shape[1] * np.log(root),
        )


@dataclass(frozen=True)
class _SigmaSubset:
    """Sigma points that differ in what a sensor measures.

    The measurement moves only with the first r columns of the factor L.

    The other points coincide with the centre there. A pair of points at +- one column of L is turned into its sum and difference,
    an orthogonal change that leaves every covariance as it is: sums have nothing of the state, differences are that column. So
    X = [0 | L] with Y = deviations @ mixing = [centre and sums | differences | 0], where r = 6 of 20 columns move a pose.

    Attributes
    ----------
    offsets : ndarray of float, shape (p, n)
        Centre, plus and minus points in units of L.
    mean_weights : ndarray of float, shape (p,)
        Weights of the mean, p = 2r + 1 points.
    mixing : ndarray of float, shape (p, r)
        (2r + 1, r + 1 + n).
    """

    offsets: Float[np.ndarray, "p n"]
    mean_weights: Float[np.ndarray, " p"]
    mixing: Float[np.ndarray, "p r"]
