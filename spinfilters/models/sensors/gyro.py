"""A rate gyro fixed to the body, axes g."""

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.attitude.expressions import Expression
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.sensor_noise import IsotropicNoise, NoiseLevel, SensorNoiseModel, noise_parameters
from spinfilters.state.blocks.gyro_bias import GYRO_BIAS
from spinfilters.state.layout import StateLayout


class Gyro(MeasurementModel):
    """z = w + b + n, rad/s, the bias b where the layout holds one.

    The noise n has the covariance N + (scale_std |w|)^2 I, with N = noise_std^2 I or each sample's own.
    Consumer gyros carry scale, cross-axis and timing errors that grow with the rate; ``scale_std`` stands for them, because a
    fixed noise makes the normalised innovations of a fast spin tens to hundreds of times too large.
    Parameters of a measurement: (those of N, such as noise_std rad/s, scale_std 1).
    """

    name = "gyro"
    dim = 3
    value_dim = 3
    needs = ("w",)

    def __init__(self, layout: StateLayout, noise: SensorNoiseModel | None = None) -> None:
        super().__init__(layout)
        self.noise = noise or IsotropicNoise(3)
        self.parameter_dim = self.noise.parameter_dim + 1
        if layout.has(GYRO_BIAS):
            self.needs = (*self.needs, GYRO_BIAS.name)

    def symbolic(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        return state["w"] + state["b"] if self.layout.has(GYRO_BIAS) else state["w"]

    def noise_factor(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        w, own = state["w"], self.noise.parameter_dim
        return self.noise.factor(parameters[:own], parameters[own] ** 2 * ca.dot(w, w))


def gyro_parameters(count: int, noise: NoiseLevel, scale_std: float) -> Float[np.ndarray, "count p"]:
    """Parameters of ``count`` gyro samples: noise_std (rad/s) of all, or (count, 3, 3) covariances ((rad/s)^2)."""
    return np.concatenate([noise_parameters(noise, count), np.full((count, 1), scale_std)], axis=1)
