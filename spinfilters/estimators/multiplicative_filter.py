"""What the multiplicative EKF and UKF share: everything but how they predict a measurement and move a belief."""

from abc import abstractmethod

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import Estimator, Measurement, ProcessModel, Snapshot, UpdateReport
from spinfilters.estimators.gain import MeasurementPrediction, apply_gain
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.layout import StateLayout


class MultiplicativeFilter(Estimator):
    """A filter on the error state: mean on the manifold, square root of the error covariance in its tangent space.

    After an update the error is folded into the mean (4 x MRP on the body side) and the covariance moves with the derivative of
    that reset, so that it always refers to the mean it stands beside.
    """

    def __init__(self, process: ProcessModel) -> None:
        super().__init__(process)
        self._mean = np.zeros(0)
        self._factor = np.zeros((0, 0))

    def start(self, belief: Gaussian) -> None:
        if belief.layout != self.layout:
            raise InputError(
                f"belief has the blocks {belief.layout.blocks}, the process has {self.layout.blocks}"
            )
        self._mean, self._factor = belief.mean.copy(), belief.factor.copy()

    @property
    def belief(self) -> Gaussian:
        return Gaussian(self.layout, self._mean, self._factor)

    def update(self, measurement: Measurement) -> UpdateReport:
        prediction, used = self._predict_measurement(measurement)
        count = len(measurement.values)
        if not prediction.dof:
            return UpdateReport(0.0, 0, 0, count)
        correction = apply_gain(prediction)
        self._mean = self.layout.retract(self._mean, correction.error)
        self._factor = reset_factor(self.layout, correction.error, correction.factor)
        return UpdateReport(correction.nis, prediction.dof, used, count - used, correction.log_likelihood)

    def snapshot(self) -> Snapshot:
        return {"mean": self._mean.copy(), "factor": self._factor.copy()}

    def restore(self, snapshot: Snapshot) -> None:
        self._mean, self._factor = snapshot["mean"].copy(), snapshot["factor"].copy()

    @abstractmethod
    def _predict_measurement(self, measurement: Measurement) -> tuple[MeasurementPrediction, int]:
        """Whitened predicted measurement at the present belief, and how many of the values it uses."""


def reset_factor(
    layout: StateLayout, error: Float[np.ndarray, " n"], factor: Float[np.ndarray, "n n"]
) -> Float[np.ndarray, "n n"]:
    """Covariance factor after the error has been folded into the mean."""
    if not {"a", "s"} & set(layout.blocks):
        return factor
    return layout.reset_jacobian(error) @ factor


def nothing_usable(factor: Float[np.ndarray, "n n"]) -> tuple[MeasurementPrediction, int]:
    """The prediction of a measurement none of whose values is valid."""
    return MeasurementPrediction(np.zeros(0), np.zeros((0, factor.shape[1])), factor, 0.0, 0, 0.0), 0


def usable(values: Float[np.ndarray, "k r"], valid: Bool[np.ndarray, " k"]) -> Bool[np.ndarray, " k"]:
    """Where an innovation is valid and finite."""
    return valid & np.isfinite(values).all(axis=-1)
