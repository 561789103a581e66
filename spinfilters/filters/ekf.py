"""The multiplicative extended Kalman filter in square-root form.

Predict and update, which the UKF shares, are in `spinfilters.filters.filter`. Another filter is a class beside it that linearises
process and measurements in its own way, and an entry in the table `spinfilters.run.estimators`.
"""

import numpy as np

from spinfilters.filters.compiled_steps import Update, compiled_update
from spinfilters.filters.estimator import Measurement, ProcessModel
from spinfilters.filters.filter import LinearisedProcess, MultiplicativeFilter
from spinfilters.filters.iterated_update import (
    IteratedObservations,
    IteratedUpdate,
    IterationOptions,
    is_small,
    proves_right,
    sample_rows,
)
from spinfilters.filters.landmark_observations import SolvedObservations
from spinfilters.filters.landmark_steps import MapObservations
from spinfilters.filters.measurement_prediction import LinearisedRows, linear_rows
from spinfilters.filters.noise_levels import AdaptationOptions
from spinfilters.filters.outlier_rejection import RobustOptions, SensorOutlierRejection
from spinfilters.filters.shared_modes import LandmarkOptions


class FirstOrderFilter(MultiplicativeFilter):
    """A filter that linearises process and measurements by their exact derivatives at the mean."""

    def linearise_process(self, dt: float) -> LinearisedProcess:
        """f, its derivative F with respect to the error, and the noise factor G, all at the mean."""
        mean, transition, noise = self.process.linearise(self.mean, dt)
        return LinearisedProcess(mean, transition, noise)

    def predict_measurement(self, measurement: Measurement) -> LinearisedRows:
        """Innovations y - h(x) and Jacobians H at the mean, whitened by the noise there."""
        return linear_rows(measurement, self.mean)


class MultiplicativeEkf(FirstOrderFilter):
    """First-order filter: the error's transition and the sensors' Jacobians are exact derivatives at the mean.

    Where the measurement is not linear over the step of an update, the update is iterated: linearised again about its own result
    (`spinfilters.filters.iterated_update`). ``IterationOptions(iterations=1)`` is the plain EKF.

    Parameters
    ----------
    process : ProcessModel
        The process model.
    robust : RobustOptions or None
        Gate and weights of measured values.
    adaptation : AdaptationOptions or None
        Adaptation of the stated noise to the innovations.
    iteration : IterationOptions or None
        Options of the iterated update, for measurements far from linear.
    landmarks : LandmarkOptions or None
        How landmarks of an unknown map are represented.
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

    def correct(
        self, measurement: Measurement, outliers: SensorOutlierRejection, scale: float
    ) -> Update | None:
        """Correct mean and covariance as `MultiplicativeFilter.correct` defines it, iterated where the measurement is not linear.

        Compiled code makes the linear update of all values in one pass. Where its step is too large for that, or there is no
        compiler, the values are linearised and corrected here.
        """
        found = self._correct_in_one_pass(measurement, outliers, scale)
        if found is not None:
            return found
        rows = self.reject_outliers(self.predict_measurement(measurement), outliers, scale)
        if not rows.dof:
            return None
        update = self.correct_linearly(rows)
        chosen = sample_rows(
            len(rows.innovation)
        )  # a few values show whether the linear model held over the step
        if self._is_small(update) or proves_right(
            rows.only(chosen), float(chosen.step), update, self._iteration
        ):
            return update
        problem = IteratedUpdate(self.layout, self.mean, self.factor, rows)
        return problem.solve(update.correction, self._iteration)

    def correct_by_landmarks(
        self, observations: MapObservations, outliers: SensorOutlierRejection
    ) -> SolvedObservations:
        """By derivatives at the mean, iterated where the model is far from linear."""
        first = super().correct_by_landmarks(observations, outliers)
        if is_small(self.layout, self.mean, first.correction, self._iteration):
            return first
        problem = IteratedObservations(observations, self.mean, self.factor, first)
        return problem.solution(self._iteration)

    def _is_small(self, update: Update) -> bool:
        return is_small(self.layout, self.mean, update.correction, self._iteration)

    def _correct_in_one_pass(
        self, measurement: Measurement, outliers: SensorOutlierRejection, scale: float
    ) -> Update | None:
        """The linear update by compiled code; None without such code, or where the linear model does not hold over the step."""
        model, count = measurement.model, len(measurement.values)
        compiled = compiled_update(model)
        if compiled is None:
            return None
        found = compiled(self.mean, self.factor, measurement, scale, outliers.limit(model.dim))
        if found is None:
            return None
        if not self._is_small(found):
            if found.correction.dof < model.dim * count:
                return None
            chosen = sample_rows(count)
            rows = self.predict_measurement(
                Measurement(model, measurement.values[chosen], measurement.parameters[chosen])
            )
            if scale != 1:
                rows = rows.weighted(np.full(len(rows.innovation), 1 / scale))
            if not proves_right(rows, float(chosen.step), found, self._iteration):
                return None
        outliers.count(count, count - found.correction.dof // model.dim)
        return found
