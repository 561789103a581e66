"""The multiplicative unscented Kalman filter in square-root form."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.filters.epoch_run import CompiledSpread, SpreadPoints, compiled_loops, run_options, take_in
from spinfilters.filters.estimator import EpochRun, Estimator, Measurement, ProcessModel
from spinfilters.filters.filter import LinearisedProcess, MultiplicativeFilter
from spinfilters.filters.landmark_observations import (
    Regression,
    SolvedObservations,
    corrected_at_landmarks,
    solve,
)
from spinfilters.filters.landmark_steps import MapObservations
from spinfilters.filters.measurement_prediction import SigmaPointOptions, sigma_points, usable
from spinfilters.filters.noise_levels import AdaptationOptions
from spinfilters.filters.outlier_rejection import RobustOptions, SensorOutlierRejection
from spinfilters.filters.shared_modes import LandmarkOptions
from spinfilters.filters.square_root import (
    MeasurementPrediction,
    compressed,
    covariance_factor,
    is_lower,
    last_nonzero,
)
from spinfilters.models.measurement import MeasurementModel


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
        As `sigma_points`.
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
        self._sigma_points = points = sigma_points(n, self._points_options)
        self._offsets = points.offsets
        self._mean_weights = points.mean_weights
        self._root_weights = points.root_weights
        self._subset = cache(self._build_subset)
        self._compiled_spread: CompiledSpread | None = None

    def __init_subclass__(cls) -> None:
        """Make a subclass without its own `take_in` take each epoch by itself, outside compiled loops."""
        if "take_in" not in vars(cls):
            cls.take_in = Estimator.take_in

    def build_take_in(self, models: Sequence[MeasurementModel]) -> None:
        """Load the compiled loops of process, sensors and sigma points.

        Parameters
        ----------
        models : Sequence[MeasurementModel]
            The sensors whose values `take_in` will get.
        """
        compiled_loops(self.process, models)
        for model in models:
            model.innovations_beside.build()

    def take_in(self, epochs: EpochRun, rows: Mapping[str, np.ndarray]) -> int:
        """Predict and update through consecutive epochs in one call of compiled code, to rounding as by single ones.

        Parameters
        ----------
        epochs : EpochRun
            From the present time on, without landmarks.
        rows : Mapping[str, ndarray]
            A row per epoch to be written, see `Estimator.take_in`.

        Returns
        -------
        int
            How many epochs were taken in; the next one needs `predict` and `update`.
        """
        models = [part.every.model for part in epochs.sensors]
        options = run_options(
            self.layout, self._adaptation, self._outliers, models, points=self._sigma_points
        )
        return self.take_in_together(
            epochs, rows, lambda run: take_in(self.process, self.mean, self.factor, run, options, rows)
        )

    def linearise_process(self, dt: float) -> LinearisedProcess:
        """Mean and spread of the sigma points after the step; the transition is the derivative at the mean."""
        self._make_triangular()
        mean, deviations, transition, noise = self._spread(dt)
        if self._held is None:
            return LinearisedProcess(mean, transition, noise, deviations.T)
        # Modes and move after the state depend on the factor's coordinates: regress on these, [A | D - A E'].
        scaled = self._root_weights[:, None] * self._offsets
        rows = np.zeros((self._n, len(self.factor)))
        rows[:, : self._n] = deviations.T @ scaled
        rest = deviations.T - rows[:, : self._n] @ scaled.T
        return LinearisedProcess(mean, transition, noise, np.concatenate([rows, rest], axis=1))

    def _spread(self, dt: float) -> SpreadPoints:
        """Sigma points after a step, by compiled code where there is any for so many substeps."""
        found = self._compiled_points(dt)
        if found is not None:
            return found
        _, transition, noise = self.process.linearise(self.mean, dt)  # builds what a step like this needs
        self._compiled_spread = CompiledSpread.of(self.process, self._sigma_points)
        found = self._compiled_points(dt)
        if found is not None:
            return found
        # X_i <- f(X_i, dt); mean of the tangents about the centre's, deviations about that mean.
        moved = self.process.step(self.layout.retract_each(self.mean, self._displace(self._offsets)), dt)
        centre = moved[0]
        mean = self.layout.retract(centre, self._mean_weights @ self.layout.local_each(centre, moved))
        deviations = self._root_weights[:, None] * self.layout.local_each(mean, moved)
        return SpreadPoints(mean, deviations, transition, noise)

    def _compiled_points(self, dt: float) -> SpreadPoints | None:
        """Sigma points by what has been compiled for other steps."""
        if self._compiled_spread is None or not dt > 0:
            return None
        return self._compiled_spread(self.mean, self.factor[: self._n, : self._n], dt)

    def predict_measurement(self, measurement: Measurement) -> "RegressedRows":
        """Innovations of the usable values at the sigma points that the sensor sees apart, whitened by the noise at the mean."""
        self._make_triangular()
        model = measurement.model
        subset = self._subset(last_nonzero(self.factor[model.columns]))
        points = self.layout.retract_each(self.mean, self._displace(subset.offsets))
        innovation, valid, log_noise = model.innovations_at(
            points, self.mean, measurement.parameters, measurement.values
        )
        keep = usable(innovation.reshape(len(valid), model.dim * len(points)), valid)
        if not keep.all():
            innovation, log_noise = innovation[keep], log_noise[keep]
        return RegressedRows(innovation @ subset.mean_weights, innovation, log_noise, subset.mixing)

    def correct_by_landmarks(
        self, observations: MapObservations, outliers: SensorOutlierRejection
    ) -> SolvedObservations:
        """By regression over sigma points of the pose and of each landmark; of young ones by derivatives at their new points."""
        self._make_triangular()
        regression = Regression(observations, self.mean, self.factor)
        first = solve(observations, regression.rows(self._points_options), self.factor, outliers)
        return corrected_at_landmarks(observations, self.mean, self.factor, first)

    def _make_triangular(self) -> None:
        """Turn the factor so that the state's rows stand on its first coordinates alone: sigma points are drawn along these."""
        if not (self._held is None or is_lower(self.factor[: self._n])):
            self.factor = covariance_factor(self.factor.T)

    def _displace(self, offsets: Float[np.ndarray, "p n"]) -> Float[np.ndarray, "p n"]:
        """Errors of the state at offsets in units of the factor's columns."""
        return offsets @ self.factor[: self._n, : self._n].T

    def _build_subset(self, seen: int) -> "_SigmaSubset":
        n = self.layout.error_dim
        pairs = np.arange(1, seen + 1)
        # Centre, then the points at + and - the first r columns; the centre takes the weight of all others.
        chosen = np.concatenate([[0], pairs, pairs + n])
        weight, unseen = self._root_weights[1], 2 * (n - seen)
        mean_weights = self._mean_weights[chosen]
        mean_weights[0] += unseen * self._mean_weights[1]
        mixing = np.zeros((2 * seen + 1, seen + 1 + n))
        mixing[0, 0] = np.sqrt(self._root_weights[0] ** 2 + unseen * weight**2)
        # Columns 1 to r: (plus + minus) / sqrt 2; columns r + 1 to 2r: (plus - minus) / sqrt 2; the rest is not seen.
        plus, minus = pairs, pairs + seen
        mixing[plus, pairs] = mixing[minus, pairs] = weight / np.sqrt(2)
        mixing[plus, pairs + seen] = weight / np.sqrt(2)
        mixing[minus, pairs + seen] = -weight / np.sqrt(2)
        return _SigmaSubset(self._offsets[chosen], mean_weights, mixing)


@dataclass(frozen=True)
class RegressedRows:
    """Whitened innovations of k usable values at the sigma points: a `PredictedMeasurement`.

    Attributes
    ----------
    innovation : ndarray of float, shape (k, d)
        Their mean over the points.
    points : ndarray of float, shape (k, d, p)
        At each point.
    log_noise : ndarray of float, shape (k,)
        Log determinant of the factor by which each was whitened.
    mixing : ndarray of float, shape (p, q)
        See `_SigmaSubset`.
    """

    innovation: Float[np.ndarray, "k d"]
    points: Float[np.ndarray, "k d p"]
    log_noise: Float[np.ndarray, " k"]
    mixing: Float[np.ndarray, "p q"]

    @property
    def dof(self) -> int:
        """Number of scalar measurements."""
        return self.innovation.size

    def deviations(
        self, factor: Float[np.ndarray, "n r"], chosen: Bool[np.ndarray, " k"]
    ) -> Float[np.ndarray, "s d q"]:
        """Deviations of the chosen values, that depend on the factor by the points."""
        return (self.innovation[chosen, :, np.newaxis] - self.points[chosen]) @ self.mixing

    def weighted(self, weights: Float[np.ndarray, " k"]) -> "RegressedRows":
        """Values with their noise covariance divided by the weights. Those of weight 0 are left out."""
        used = weights > 0
        root = np.sqrt(weights[used])
        innovation, points, log_noise = self.innovation[used], self.points[used], self.log_noise[used]
        if not (root == 1).all():
            innovation = innovation * root[:, np.newaxis]
            points = points * root[:, np.newaxis, np.newaxis]
            log_noise = log_noise - innovation.shape[1] * np.log(root)
        return RegressedRows(innovation, points, log_noise, self.mixing)

    def predicted(self, factor: Float[np.ndarray, "N N"]) -> MeasurementPrediction:
        """Factors X = [0 | S] and Y = deviations @ mixing, of all values together."""
        mean, points = self.innovation.reshape(-1), self.points.reshape(self.dof, -1)
        rho, H, residual = compressed(mean, mean[:, np.newaxis] - points)
        size, n = len(factor), self.mixing.shape[1] - (self.mixing.shape[0] + 1) // 2
        X = np.concatenate([np.zeros((size, self.mixing.shape[1] - n)), factor], axis=1)
        Y = H @ self.mixing
        if size > n:  # what stands after the state is not seen
            Y = np.concatenate([Y, np.zeros((len(Y), size - n))], axis=1)
        return MeasurementPrediction(rho, Y, X, residual, self.dof, float(self.log_noise.sum()))


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
    mixing : ndarray of float, shape (p, q)
        Deviations of the points into centre and r sums, then n differences: q = r + 1 + n.
    """

    offsets: Float[np.ndarray, "p n"]
    mean_weights: Float[np.ndarray, " p"]
    mixing: Float[np.ndarray, "p q"]
