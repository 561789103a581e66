"""A rate gyro fixed to the body, axes g."""

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.attitude.expressions import Expression
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.sensor_noise import IsotropicNoise, NoiseLevel, SensorNoiseModel, noise_parameters
from spinfilters.state.blocks.gyro_bias import GYRO_BIAS
from spinfilters.state.blocks.gyro_scale import GYRO_SCALE
from spinfilters.state.layout import StateLayout


class Gyro(MeasurementModel):
    """z = (1 + k) w + b + n, rad/s.

    Bias b and relative error of the scale k where the layout holds them.
    The noise n has the covariance N + (scale_std |w|)^2 I, with N = noise_std^2 I or each sample's own.
    Consumer gyros carry scale, cross-axis and timing errors that grow with the rate; ``scale_std`` stands for them, because a
    fixed noise makes the normalised innovations of a fast spin tens to hundreds of times too large.
    Parameters of a measurement: (those of N, such as noise_std rad/s, scale_std 1).
    """

    name = "gyro"
    dim = 3
    value_dim = 3
    needs = ("w",)
    reads_rate = True

    def __init__(self, layout: StateLayout, noise: SensorNoiseModel | None = None) -> None:
        super().__init__(layout)
        self.noise = noise or IsotropicNoise(3)
        self.parameter_dim = self.noise.parameter_dim + 1
        held = (block.name for block in (GYRO_BIAS, GYRO_SCALE) if layout.has(block))
        self.needs = (*self.needs, *held)

    def symbolic(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Body rate in g axes, with scale error and bias where the state has them, rad/s."""
        rate = state["w"]
        if self.layout.has(GYRO_SCALE):
            rate = (1 + state["k"]) * rate
        return rate + state["b"] if self.layout.has(GYRO_BIAS) else rate

    def noise_factor(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """White noise and, in proportion to the rate, an unknown scale, rad/s."""
        w, own = state["w"], self.noise.parameter_dim
        return self.noise.factor(parameters[:own], parameters[own] ** 2 * ca.dot(w, w))


def gyro_parameters(count: int, noise: NoiseLevel, scale_std: float) -> Float[np.ndarray, "count p"]:
    """Parameters of ``count`` gyro samples: noise_std (rad/s) of all, or (count, 3, 3) covariances ((rad/s)^2)."""
    return np.concatenate([noise_parameters(noise, count), np.full((count, 1), scale_std)], axis=1)
