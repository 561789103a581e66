"""What the multiplicative EKF and UKF share: everything but how they predict a measurement and move a belief."""

from abc import abstractmethod
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.errors import InputError
from spinfilters.estimators.adaptation import AdaptationOptions, NoiseAdaptation, PredictedMotion
from spinfilters.estimators.estimator import Estimator, Measurement, ProcessModel, Snapshot, UpdateReport
from spinfilters.estimators.gain import Correction, MeasurementPrediction
from spinfilters.estimators.robustness import RobustOptions, SensorGuard, SensorGuards
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.layout import StateLayout


class Corrected(NamedTuple):
    """A point (m,) and the correction that leads to it."""

    mean: Float[np.ndarray, " m"]
    correction: Correction


class MultiplicativeFilter(Estimator):
    """A filter on the error state: mean on the manifold, square root of the error covariance in its tangent space.

    After an update the error is folded into the mean (4 x MRP on the body side) and the covariance moves with the derivative of
    that reset, so that it always refers to the mean it stands beside.

    Parameters
    ----------
    process: the process model.
    robust: gate and weights of measured values.
    adaptation: of stated noise to what is seen.
    """

    def __init__(self, process: ProcessModel, robust: RobustOptions, adaptation: AdaptationOptions) -> None:
        super().__init__(process)
        self._mean = np.zeros(0)
        self._factor = np.zeros((0, 0))
        self._guards = SensorGuards(robust)
        self._adaptation = NoiseAdaptation(adaptation)

    def start(self, belief: Gaussian) -> None:
        if belief.layout != self.layout:
            raise InputError(
                f"belief has the blocks {belief.layout.blocks}, the process has {self.layout.blocks}"
            )
        self._mean, self._factor = belief.mean.copy(), belief.factor.copy()
        self._guards = SensorGuards(self._guards.options)
        self._adaptation = NoiseAdaptation(self._adaptation.options)

    @property
    def belief(self) -> Gaussian:
        return Gaussian(self.layout, self._mean, self._factor)

    def predict(self, dt: float) -> None:
        self._guards.pass_time()
        self._adaptation.observe_motion(self.layout, self._mean, self._factor)
        motion = self._moved(dt)
        self._mean, self._factor = motion.mean, motion.factor
        self._adaptation.expect_motion(motion)

    def update(self, measurement: Measurement) -> UpdateReport:
        """Take in one sensor's values; those that only repeat the latest ones count as rejected."""
        name, count = measurement.model.name, len(measurement.values)
        guard, keys = self._guards.of(name), measurement.parameters[:, : measurement.model.known_by]
        if guard.frames.repeats(keys, measurement.values):
            return UpdateReport(0.0, 0, 0, count)
        corrected = self._corrected(measurement, guard, self._adaptation.measurement_scale(name))
        if corrected is None:
            return UpdateReport(0.0, 0, 0, count)
        correction = corrected.correction
        self._mean = corrected.mean
        self._factor = reset_factor(self.layout, correction.error, correction.factor)
        self._adaptation.observe_measurement(name, correction)
        used = correction.dof // measurement.model.dim
        return UpdateReport(correction.nis, correction.dof, used, count - used, correction.log_likelihood)

    def snapshot(self) -> Snapshot:
        beliefs = {"mean": self._mean.copy(), "factor": self._factor.copy()}
        return {**beliefs, **self._guards.snapshot(), **self._adaptation.snapshot()}

    def restore(self, snapshot: Snapshot) -> None:
        self._mean, self._factor = snapshot["mean"].copy(), snapshot["factor"].copy()
        self._guards.restore(snapshot)
        self._adaptation.restore(snapshot)

    @abstractmethod
    def _moved(self, dt: float) -> PredictedMotion:
        """The belief dt seconds later."""

    @abstractmethod
    def _corrected(self, measurement: Measurement, guard: SensorGuard, scale: float) -> Corrected | None:
        """The mean after a measurement whose noise covariance is ``scale`` times the stated one; None when no value is usable."""


def reset_factor(
    layout: StateLayout, error: Float[np.ndarray, " n"], factor: Float[np.ndarray, "n n"]
) -> Float[np.ndarray, "n n"]:
    """Covariance factor after the error has been folded into the mean."""
    if "a" in layout.blocks or "s" in layout.blocks:
        return layout.reset_jacobian(error) @ factor
    return factor


def nothing_usable(factor: Float[np.ndarray, "n n"]) -> tuple[MeasurementPrediction, int]:
    """The prediction of a measurement none of whose values is valid."""
    return MeasurementPrediction(np.zeros(0), np.zeros((0, factor.shape[1])), factor, 0.0, 0, 0.0), 0


def usable(values: Float[np.ndarray, "k r"], valid: Bool[np.ndarray, " k"]) -> Bool[np.ndarray, " k"]:
    """Where an innovation is valid and finite."""
    if np.count_nonzero(np.isfinite(values)) == values.size:  # the usual case, in a third of the time
        return valid
    return valid & np.isfinite(values).all(axis=-1)
