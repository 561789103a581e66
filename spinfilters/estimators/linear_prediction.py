"""A measurement predicted to first order: what the EKF and the smoother of the start share."""

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.estimator import Measurement
from spinfilters.estimators.gain import MeasurementPrediction, compressed
from spinfilters.estimators.multiplicative_filter import nothing_usable, usable


def linear_prediction(
    measurement: Measurement,
    x: Float[np.ndarray, " m"],
    factor: Float[np.ndarray, "n r"],
    error: Float[np.ndarray, " n"] | None = None,
) -> tuple[MeasurementPrediction, int]:
    """Whitened prediction linearised at ``x``, and how many of the values it uses (valid and finite ones).

    Parameters
    ----------
    factor: covariance factor of the error about ``x``.   error: its mean, None for zero.
    """
    model = measurement.model
    innovation, jacobian, valid, log_noise = model.linearise(x, measurement.parameters, measurement.values)
    keep = usable(innovation, valid)
    used = int(np.count_nonzero(keep))
    if not used:
        return nothing_usable(factor)
    if used < len(keep):
        innovation, jacobian, log_noise = innovation[keep], jacobian[keep], log_noise[keep]
    columns = model.columns
    rho, rows = innovation.reshape(-1), jacobian.reshape(-1, len(columns))
    if error is not None:
        rho = rho - rows @ error[columns]
    rho, H, residual = compressed(rho, rows)
    Y = H @ factor[columns]
    return MeasurementPrediction(rho, Y, factor, residual, used * model.dim, float(log_noise.sum())), used
