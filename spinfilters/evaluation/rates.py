"""Body rates of estimates, truth or sensors in body-fixed axes, and flips in them (Dzhanibekov)."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.conversions import inverse, rotate
from spinfilters.data.measurement_log import MeasurementLog
from spinfilters.data.truth import Truth
from spinfilters.estimators.history import EstimateHistory, by_stretches
from spinfilters.evaluation.body import BodyEstimate
from spinfilters.sensors.sensor import sensor_of

PLATEAU: Final = 0.5**0.5
"""Share of the rate that is along the intermediate axis on a plateau: at 45 degrees from it a body turns about another axis."""
CLEAR: Final = 3.0
"""Standard deviations between two moments, below which it is open which axis is the intermediate one."""


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


def count_flips(rate: Float[np.ndarray, "n 3"], intermediate: int = 1) -> int:
    """Reversals of the rotation about the intermediate axis.

    From within 45 degrees of the axis to within 45 degrees of its opposite.
    A rate that only crosses zero, as in every nutation about another axis, is none, nor is a reversal that is not complete.

    Parameters
    ----------
    rate: along the principal axes, rad/s.
    """
    along, length = rate[:, intermediate], np.linalg.norm(rate, axis=1)
    plateau = np.sign(along[np.abs(along) > PLATEAU * length])
    return int(np.count_nonzero(np.diff(plateau)))


def knows_intermediate_axis(body: BodyEstimate) -> bool:
    """Whether the moments are distinct, so that axes are known.

    The axes of two equal moments are no axes, and no flip is about them.
    """
    moments, covariance = body.principal_moments, body.principal_moments_cov
    variance = np.diag(covariance)
    apart = variance[1:] + variance[:-1] - 2 * np.diag(covariance, 1)
    return bool(np.all(np.diff(moments) > CLEAR * np.sqrt(np.maximum(apart, 0.0))))
