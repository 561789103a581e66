"""The multiplicative extended Kalman filter in square-root form."""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from spinfilters.filters.compiled_steps import Update, compiled_update
from spinfilters.filters.estimator import Measurement, ProcessModel
from spinfilters.filters.filter import MultiplicativeFilter, propagated, reset_factor
from spinfilters.filters.iterated_update import IteratedObservations, IterationOptions, agrees, iterate
from spinfilters.filters.landmark_observations import SolvedObservations, solve_at
from spinfilters.filters.landmark_steps import MapObservations
from spinfilters.filters.measurement_prediction import LinearisedRows, linear_rows
from spinfilters.filters.noise_levels import AdaptationOptions, PredictedMotion
from spinfilters.filters.outlier_rejection import RobustOptions, SensorOutlierRejection
from spinfilters.filters.shared_modes import LandmarkOptions
from spinfilters.filters.square_root import Correction, square_root_update
from spinfilters.models.state_blocks import ATTITUDE
from spinfilters.models.state_layout import StateLayout

SMALLEST_RANGE = 1e-3
"""Of a body, m: divides its displacement."""
SAMPLE = 16
"""Values at which an update's linear model is checked, spread over all."""


class MultiplicativeEkf(MultiplicativeFilter):
    """First-order filter: the error's transition and the sensors' Jacobians are exact derivatives at the mean.

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
    iteration : IterationOptions or None
        Options of the iterated update, for measurements far from linear.
    """

    name = "mekf"

    def __init__(
        self,
        process: ProcessModel,
        robust: RobustOptions | None = None,
        adaptation: AdaptationOptions | None = None,
        iteration: IterationOptions | None = None,
        landmarks: LandmarkOptions | None = None,
    ) -> None:
        super().__init__(process, robust, adaptation, landmarks)
        self._iteration = iteration or IterationOptions()

    def _moved(self, dt: float) -> PredictedMotion:
        mean, transition, noise = self.process.linearise(self._mean, dt)
        noise = self._adaptation.scaled(noise)
        factor = propagated(self._factor, transition, noise)
        return PredictedMotion(mean, factor, transition, noise)

    def _corrected(
        self, measurement: Measurement, guard: SensorOutlierRejection, scale: float
    ) -> Update | None:
        compiled = compiled_update(measurement.model)
        if compiled is not None:
            limit = guard.limit(measurement.model.dim)
            found = compiled(self._mean, self._factor, measurement, scale, limit)
            if found is not None and self._has_proved_right(found, measurement, scale):
                count = len(measurement.values)
                guard.count(count, count - found.correction.dof // measurement.model.dim)
                return found
        return self._weighed(measurement, guard, scale)

    def _weighed(
        self, measurement: Measurement, guard: SensorOutlierRejection, scale: float
    ) -> Update | None:
        """Update by the valid values with the weights of outlier rejection, iterated where the model is far from linear."""
        rows = linear_rows(measurement, self._mean)
        if rows.dof and scale != 1:
            rows = rows.weighted(np.full(len(rows.innovation), 1 / scale))
        weights = guard.weights(rows.innovation, lambda chosen: rows.deviations(self._factor, chosen))
        weighted = rows if weights is None else rows.weighted(weights)
        if not weighted.dof:
            return None
        correction = square_root_update(weighted.predicted(self._factor))
        mean = self.layout.retract(self._mean, correction.error[: self._n])
        if self._is_small(correction) or self._agrees(*_sampled(weighted), mean, correction):
            return Update(mean, correction, reset_factor(self.layout, correction.error, correction.factor))
        return IteratedUpdate(self.layout, self._mean, self._factor, weighted).solved(
            correction, self._iteration
        )

    def _solved(self, observations: MapObservations, guard: SensorOutlierRejection) -> SolvedObservations:
        first = solve_at(observations, self._mean, self._factor, guard)
        if self._is_small(first.correction):
            return first
        problem = IteratedObservations(observations, self._mean, self._factor, first)
        return problem.solution(self._iteration)

    def _is_small(self, correction: Correction) -> bool:
        """Whether the linear model cannot but have proved right."""
        length = math.sqrt(correction.shift @ correction.shift)
        return length * _curvature(self.layout, self._mean, correction.error) <= self._iteration.tolerance

    def _has_proved_right(self, found: Update, measurement: Measurement, scale: float) -> bool:
        """Whether an update needs no iteration: it is small, or all values passed the gate as the model predicted."""
        if self._is_small(found.correction):
            return True
        model, chosen = measurement.model, _sample(len(measurement.values))
        if found.correction.dof < model.dim * len(measurement.values):
            return False
        values = Measurement(model, measurement.values[chosen], measurement.parameters[chosen])
        rows = linear_rows(values, self._mean)
        if scale != 1:
            rows = rows.weighted(np.full(len(rows.innovation), 1 / scale))
        return self._agrees(rows, float(chosen.step), found.mean, found.correction)

    def _agrees(
        self, rows: LinearisedRows, spacing: float, mean: Float[np.ndarray, " m"], correction: Correction
    ) -> bool:
        """Whether sampled rows, each counted ``spacing`` times, are as the model predicted, or iteration is off."""
        if self._iteration.iterations == 1:
            return True
        expected = rows.innovation - rows.jacobian @ correction.error[rows.columns]
        m = rows.measurement
        found = m.model.linearise(mean, m.parameters, m.values)
        residual = found.innovation
        if rows.root_weights is not None:
            residual = residual * rows.root_weights[:, np.newaxis]
        root = np.sqrt(spacing)
        good = agrees(root * residual.reshape(-1), root * expected.reshape(-1), self._iteration)
        return good and bool(found.valid.all())


def _sample(count: int) -> slice:
    """Rows, spread over so many, at which a linear model is checked."""
    return slice(None, None, -(-count // SAMPLE))


def _sampled(rows: LinearisedRows) -> tuple[LinearisedRows, float]:
    """Rows at which their linear model is checked, and for how many each stands."""
    chosen = _sample(len(rows.innovation))
    return rows.only(chosen), float(chosen.step)


def _curvature(layout: StateLayout, mean: Float[np.ndarray, " m"], error: Float[np.ndarray, " n"]) -> float:
    """Relative error of a linearly predicted change of residual, in order of magnitude.

    It is the sum of the rotation (rad) and the relative change of range. A correction moves a residual by |H y| <= |U y|
    standard deviations; where that times this is below the tolerance, a second linearisation changes nothing that matters.
    """
    if not layout.has(ATTITUDE):
        return math.inf
    curvature = math.hypot(*error[layout.slice("a")].tolist())
    if layout.translates:
        away = math.hypot(*mean[layout.mean_slice("t")].tolist())
        curvature += math.hypot(*error[layout.slice("t")].tolist()) / max(away, SMALLEST_RANGE)
    return curvature


@dataclass(frozen=True)
class IteratedUpdate:
    """Iterated update in the coordinates y of a predicted belief, whose error about its mean is factor @ y.

    Attributes
    ----------
    rows : LinearisedRows
        Linearised at the mean; the noise is what it is there.
    """

    layout: StateLayout
    mean: Float[np.ndarray, " m"]
    factor: Float[np.ndarray, "n n"]
    rows: LinearisedRows

    def solved(self, first: Correction, options: IterationOptions) -> Update:
        """The most probable point, from the correction about the mean."""
        y, correction = iterate(first, self.solution, self.objective, options)
        correction = replace(correction, error=self.factor @ y)
        factor = reset_factor(self.layout, correction.error, correction.factor)
        return Update(self._point(y), correction, factor)

    def objective(self, y: Float[np.ndarray, " n"]) -> float:
        """|y|^2 + |r|^2, infinite where a value is impossible."""
        m = self.rows.measurement
        away, valid = m.model.innovations(self._point(y), m.parameters, m.values)
        if not (valid.all() and np.isfinite(away).all()):
            return np.inf
        residual = self._weighing @ away[..., np.newaxis]
        return float(y @ y) + float(np.sum(residual * residual))

    def solution(self, y: Float[np.ndarray, " n"]) -> Correction:
        """Correction by the model linearised at y, as an error about the mean; the objective must be finite there."""
        point = self._point(y)
        m = self.rows.measurement
        rows = linear_rows(m, point)
        # Errors about the point by y: reset Jacobian times factor, so that the prior mean lies at -moved y.
        moved = self.layout.reset_jacobian(self._rows @ y) @ self._rows
        whitening = m.model.whitening(point, m.parameters)
        innovation, jacobian = rows.innovation, rows.jacobian
        # Rows whitened at y are re-whitened by the weighted noise at the mean: W_mean W_y^-1.
        if not np.array_equal(whitening, self._weighing):  # noise that depends on the state, or weights
            back = np.swapaxes(whitening, 1, 2)
            turn = np.swapaxes(np.linalg.solve(back, np.swapaxes(self._weighing, 1, 2)), 1, 2)
            innovation, jacobian = (turn @ innovation[..., np.newaxis])[..., 0], turn @ jacobian
        rows = replace(rows, innovation=innovation, jacobian=jacobian, log_noise=self.rows.log_noise)
        return square_root_update(replace(rows.predicted(moved, -(moved @ y)), state_factor=self.factor))

    def _point(self, y: Float[np.ndarray, " n"]) -> Float[np.ndarray, " m"]:
        return self.layout.retract(self.mean, self._rows @ y)

    @property
    def _rows(self) -> Float[np.ndarray, "n N"]:
        """Rows of the covariance factor that belong to the state."""
        return self.factor[: self.layout.error_dim]

    @cached_property
    def _weighing(self) -> Float[np.ndarray, "k d d"]:
        """Whitening matrix of a residual times the square root of its weight."""
        m, root = self.rows.measurement, self.rows.root_weights
        whitening = m.model.whitening(self.mean, m.parameters)
        return whitening if root is None else whitening * root[:, np.newaxis, np.newaxis]
