"""A rate gyro fixed to the body, axes g."""

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.attitude.expressions import Expression
from spinfilters.models.measurement import MeasurementModel


class Gyro(MeasurementModel):
    """z = w + n, rad/s, with standard deviation sqrt(noise_std^2 + (scale_std |w|)^2) on each axis.

    Consumer gyros carry scale, cross-axis and timing errors that grow with the rate; ``scale_std`` stands for them, because a
    fixed noise makes the normalised innovations of a fast spin tens to hundreds of times too large.
    Parameters of a measurement: (noise_std rad/s, scale_std 1).
    """

    name = "gyro"
    dim = 3
    value_dim = 3
    parameter_dim = 2
    needs = ("w",)

    def symbolic(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        return state["w"]

    def noise_factor(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        w = state["w"]
        return ca.sqrt(parameters[0] ** 2 + parameters[1] ** 2 * ca.dot(w, w)) * ca.DM.eye(3)


def gyro_parameters(count: int, noise_std: float, scale_std: float) -> Float[np.ndarray, "count 2"]:
    """Parameters of ``count`` gyro samples."""
    return np.tile([noise_std, scale_std], (count, 1))
