"""Body rates of estimates, truth or sensors in body-fixed axes."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.conversions import inverse, rotate
from spinfilters.data.measurement_log import MeasurementLog
from spinfilters.data.truth import Truth
from spinfilters.estimators.history import EstimateHistory
from spinfilters.evaluation.error_propagation import by_stretches
from spinfilters.sensors.registry import sensor_of


@dataclass(frozen=True)
class BodyRates:
    """Rates over time.

    Attributes
    ----------
    label: whose they are.   time: (n,) s.   rate: (n, 3) rad/s in axes fixed to the body (g unless turned).
    covariance: (n, 3, 3) (rad/s)^2, None where there is none.
    """

    label: str
    time: Float[np.ndarray, " n"]
    rate: Float[np.ndarray, "n 3"]
    covariance: Float[np.ndarray, "n 3 3"] | None = None

    @property
    def std(self) -> Float[np.ndarray, "n 3"] | None:
        """Standard deviations along the axes, rad/s."""
        return None if self.covariance is None else np.sqrt(np.einsum("nii->ni", self.covariance))

    def in_axes(self, axes: Float[np.ndarray, "3 3"]) -> "BodyRates":
        """The same rates along other axes.

        Given as rows in the present ones (R_bg for principal axes b).
        """
        own, rate = self.covariance, self.rate @ axes.T
        if own is None:
            return BodyRates(self.label, self.time, rate)
        turned = by_stretches(len(own), lambda rows: {"P": axes @ own[rows] @ axes.T})
        return BodyRates(self.label, self.time, rate, turned["P"])


def estimated_rates(history: EstimateHistory) -> BodyRates:
    """Block w of a history, axes g, labelled with the estimator's name."""
    factor = history.factor[:, history.layout.slice("w")]
    rate = history.mean[:, history.layout.mean_slice("w")]
    squares = by_stretches(len(rate), lambda rows: {"P": factor[rows] @ np.swapaxes(factor[rows], 1, 2)})
    return BodyRates(history.name, history.time, rate, squares["P"])


def true_rates(truth: Truth, frame: Float[np.ndarray, "4"] | None = None) -> BodyRates:
    """True rates in the g of the truth or of an estimate.

    The estimate's with ``frame`` = `TruthErrors.frame`.
    """
    rate = rotate(inverse(truth.q_ig), truth.rate_i)
    return BodyRates("truth", truth.time, rate if frame is None else rotate(inverse(frame), rate))


def measured_rates(log: MeasurementLog) -> BodyRates | None:
    """Rates of the first rate sensor of a log, or None.

    Axes g.
    """
    for stream in log.streams:
        rates = sensor_of(stream.sensor).measured_rates(stream)
        if rates is not None:
            return BodyRates(stream.sensor, stream.time, rates)
    return None
