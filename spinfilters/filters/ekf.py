"""The multiplicative extended Kalman filter in square-root form.

The formulas of predict and update, which the UKF shares, are in `spinfilters.filters.filter`. This file says how the EKF
linearises, and by which of four paths it updates:

1. compiled code updates with all values in one pass, and the linear model holds over the step;
2. without compiled code, with a robust loss, or where a sample of the values shows that the step is too large for path 1, the
   values are linearised here, and the linear model holds;
3. as 2, but the linear model does not hold: the update is iterated (`spinfilters.filters.iterated_update`);
4. landmarks of an unknown map, which have an iteration of their own (`correct_by_landmarks`).

Another filter is a class of its own in this package, and an entry in the table `OWN` of `spinfilters.run.estimators`. It linearises
process and measurements in its own way, or derives from `FirstOrderFilter` and corrects in its own way. The invariant extended
Kalman filter at the end is the MEKF with the error coordinates of a group of rigid motions.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from spinfilters.filters.compiled_steps import Update, compiled_update
from spinfilters.filters.epoch_run import CompiledPrediction, RunOptions, compiled_loops, run_options, take_in
from spinfilters.filters.error_coordinates import ErrorCoordinates, InvariantOptions
from spinfilters.filters.estimator import EpochRun, Estimator, Measurement, ProcessModel, RunsTaken
from spinfilters.filters.filter import LinearisedProcess, MultiplicativeFilter, PredictedMeasurement
from spinfilters.filters.flow_curvature import FlowCurvature
from spinfilters.filters.iterated_update import (
    IteratedObservations,
    IteratedUpdate,
    IterationOptions,
    is_small,
    linear_model_holds,
    sample_rows,
)
from spinfilters.filters.landmark_observations import SolvedObservations, corrected_at_landmarks
from spinfilters.filters.landmark_steps import MapObservations
from spinfilters.filters.lane_runs import take_in_runs
from spinfilters.filters.measurement_prediction import LinearisedRows, linear_rows
from spinfilters.filters.noise_levels import AdaptationOptions, PredictedMotion
from spinfilters.filters.outlier_rejection import RobustOptions, SensorOutlierRejection
from spinfilters.filters.shared_modes import LandmarkOptions
from spinfilters.filters.square_root import square_root_update
from spinfilters.models.measurement import MeasurementModel


class FirstOrderFilter(MultiplicativeFilter):
    """A filter that linearises process and measurements by their exact derivatives at the mean.

    The base of filters with another correction: they override `correct_linearly`.
    """

    compiled_prediction: ClassVar[bool] = True
    """Whether compiled code predicts: not in a filter with a process of its own."""
    _prediction: CompiledPrediction | None = None
    _is_interpreted = False
    """Whether there turned out to be no compiled code."""

    def __init_subclass__(cls) -> None:
        """Make a subclass with its own `linearise_process` predict by it."""
        if "linearise_process" in vars(cls):
            cls.compiled_prediction = False

    def predict_belief(self, dt: float) -> PredictedMotion:
        """By compiled code in one call, where there is any for so many substeps.

        Parameters
        ----------
        dt : float
            Duration, s; positive.

        Returns
        -------
        PredictedMotion
            Mean, covariance factor, transition and scaled noise factor.
        """
        predicted = self._predict_in_one_pass(dt)
        if predicted is None and self.compiled_prediction and not self._is_interpreted:
            self._build_prediction(dt)
            predicted = self._predict_in_one_pass(dt)
        return super().predict_belief(dt) if predicted is None else predicted

    def _predict_in_one_pass(self, dt: float) -> PredictedMotion | None:
        """By what has been compiled for other steps."""
        if self._prediction is None:
            return None
        scales = self._adaptation.column_scales(self.layout)
        return self._prediction(self.mean, self.factor, dt, scales, self._curvature)

    def _build_prediction(self, dt: float) -> None:
        """Build what a step like this needs, so that all steps like it, in any run, have the same bits."""
        self.process.linearise(self.mean, dt)
        stretch = self._curvature.next_stretch(self.layout, self.mean, self.factor, dt)
        if stretch is not None:
            self.process.linearise(self.mean, stretch)
        self._prediction = CompiledPrediction.of(self.process, self._curvature)
        self._is_interpreted = self._prediction is None

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
    curvature : FlowCurvature or None
        When second-order terms of the motion widen the covariance; None: never.
    """

    name = "mekf"
    compiled_correction: ClassVar[bool] = True
    """Whether compiled code corrects: not in a filter with a correction of its own."""

    def __init_subclass__(cls) -> None:
        """Make a subclass without its own `take_in` take each epoch by itself, outside compiled loops."""
        super().__init_subclass__()
        if "take_in" not in vars(cls):
            cls.take_in, cls.take_in_runs = Estimator.take_in, Estimator.take_in_runs
        if not {"correct_linearly", "predict_measurement"}.isdisjoint(vars(cls)):
            cls.compiled_correction = False

    def __init__(
        self,
        process: ProcessModel,
        robust: RobustOptions | None = None,
        adaptation: AdaptationOptions | None = None,
        iteration: IterationOptions | None = None,
        landmarks: LandmarkOptions | None = None,
        curvature: FlowCurvature | None = None,
    ) -> None:
        super().__init__(process, robust, adaptation, landmarks, curvature)
        self._iteration = iteration or IterationOptions()

    def correct(
        self, measurement: Measurement, outliers: SensorOutlierRejection, scale: float
    ) -> Update | None:
        """Correct mean and covariance as `MultiplicativeFilter.correct` defines it, iterated where the measurement is not linear.

        Parameters
        ----------
        measurement : Measurement
            One sensor's values of the present time.
        outliers : SensorOutlierRejection
            Gate and robust weights of this sensor.
        scale : float
            Ratio of the noise covariance to the stated one.

        Returns
        -------
        Update or None
            What the filter becomes; None when no value is usable.
        """
        update = self._correct_in_one_pass(measurement, outliers, scale)
        if update is not None:
            return update
        rows = self.reject_outliers(self.predict_measurement(measurement), outliers, scale)
        if not rows.dof:
            return None
        update = self.correct_linearly(rows)
        # A few values, spread over all, show whether the linear model held over the step.
        sample, values_per_sample = sample_rows(len(rows.innovation))
        if self._is_small(update) or linear_model_holds(
            rows.only(sample), values_per_sample, update, self._iteration
        ):
            return update
        problem = IteratedUpdate(self.layout, self.mean, self.factor, rows)
        return problem.solve(update.correction, self._iteration)

    def build_take_in(self, models: Sequence[MeasurementModel]) -> None:
        """Load the compiled loops of process and sensors.

        Parameters
        ----------
        models : Sequence[MeasurementModel]
            The sensors whose values `take_in` will get.
        """
        compiled_loops(self.process, models)

    def take_in(self, epochs: EpochRun, rows: Mapping[str, np.ndarray]) -> int:
        """Predict and update through consecutive epochs in one call of compiled code, to the numbers of single ones.

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
        options = self._run_options([part.every.model for part in epochs.sensors])
        return self.take_in_together(
            epochs, rows, lambda run: take_in(self.process, self.mean, self.factor, run, options, rows)
        )

    def take_in_runs(
        self, epochs: EpochRun, mean: Float[np.ndarray, "r m"], factor: Float[np.ndarray, "r n n"]
    ) -> RunsTaken | None:
        """Take many runs of the same epochs in by one call of compiled code.

        Parameters
        ----------
        epochs, mean, factor
            See `Estimator.take_in_runs`.

        Returns
        -------
        RunsTaken or None
            None without compiled code, with a robust loss, while noise levels adapt, or without any sensor.
        """
        models = [part.every.model for part in epochs.sensors]
        constant = self._adaptation.constant_predictions([model.name for model in models])
        if self._held is not None or constant < len(epochs.dt) or not models:
            return None
        options = replace(self._run_options(models), curvature=self._curvature.begun())
        return take_in_runs(self.process, mean, factor, epochs, options)

    def _run_options(self, models: Sequence[MeasurementModel]) -> RunOptions:
        """What is the same in all epochs to come, until noise levels adapt or a gate refuses too much."""
        return run_options(
            *(self.layout, self._adaptation, self._outliers, models, self._iteration),
            curvature=self._curvature,
        )

    def correct_by_landmarks(
        self, observations: MapObservations, outliers: SensorOutlierRejection
    ) -> SolvedObservations:
        """By derivatives at the mean, iterated where the model is far from linear."""
        found = super().correct_by_landmarks(observations, outliers)
        if self._iteration.iterations == 1:
            return found
        if not is_small(self.layout, self.mean, found.correction, self._iteration):
            problem = IteratedObservations(observations, self.mean, self.factor, found)
            found = problem.solution(self._iteration)
        return corrected_at_landmarks(observations, self.mean, self.factor, found)

    def _is_small(self, update: Update) -> bool:
        return is_small(self.layout, self.mean, update.correction, self._iteration)

    def _correct_in_one_pass(
        self, measurement: Measurement, outliers: SensorOutlierRejection, scale: float
    ) -> Update | None:
        """The linear update by compiled code; None without such code, or where the linear model does not hold over the step."""
        model, count = measurement.model, len(measurement.values)
        compiled = compiled_update(model) if self.compiled_correction else None
        if compiled is None:
            return None
        update = compiled(self.mean, self.factor, measurement, scale, outliers.limit(model.dim))
        if update is None:
            return None
        if not self._is_small(update):
            if update.correction.dof < model.dim * count:  # the sample would hold rejected values
                return None
            sample, values_per_sample = sample_rows(count)
            rows = self.predict_measurement(
                Measurement(model, measurement.values[sample], measurement.parameters[sample])
            )
            if scale != 1:
                rows = rows.weighted(np.full(len(rows.innovation), 1 / scale))
            if not linear_model_holds(rows, values_per_sample, update, self._iteration):
                return None
        outliers.count(count, count - update.correction.dof // model.dim)
        return update


class InvariantEkf(FirstOrderFilter):
    """First-order filter whose error coordinates couple attitude, position and velocity, by default as SE_2(3).

    Predictions are those of the MEKF, because a covariance about the mean is the same in all coordinates to first order. An update
    moves the mean along the group and the covariance by the derivative of that move. It is not iterated.

    Parameters
    ----------
    process : ProcessModel
        See `MultiplicativeFilter`.
    robust, adaptation
        See `MultiplicativeFilter`.
    options : InvariantOptions or None
        Which error coordinates.
    """

    name = "invariant"

    def __init__(
        self,
        process: ProcessModel,
        robust: RobustOptions | None = None,
        adaptation: AdaptationOptions | None = None,
        options: InvariantOptions | None = None,
    ) -> None:
        super().__init__(process, robust, adaptation)
        self._coordinates = ErrorCoordinates(self.layout, (options or InvariantOptions()).coordinates)

    def correct_linearly(self, predicted: PredictedMeasurement) -> Update:
        """The correction by values that are linear in the error, folded into the mean along the group."""
        correction = square_root_update(predicted.predicted(self.factor))
        mean, factor = self._coordinates.fold(self.mean, correction.error, correction.factor)
        return Update(mean, correction, factor)
