"""A landmark of the map seen by a rectified stereo pair."""

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.attitude.expressions import Expression, conjugate, rotate
from spinfilters.models.landmark_sensor import LandmarkSensor
from spinfilters.models.sensor_noise import IsotropicNoise, NoiseLevel, SensorNoiseModel, noise_parameters
from spinfilters.state.layout import StateLayout

NEAREST_DEPTH = 1e-3
"""Depth in m below which a point counts as at or behind the camera."""
SMALLEST_DENOMINATOR = 1e-6
"""Disparity in px that a division is guarded with; such a point is not `determined`."""
SMALLEST_DISPARITY = 5.0
"""In standard deviations of a disparity: a depth that is less certain is no point that a linear model could hold."""


class StereoLandmark(LandmarkSensor):
    """z = (u_left, v_left, u_right) in rectified pixels of the point p_g, camera frame = frame i.

    p_c = t + R_ig p_g; u_left = fx x/z + cx, v_left = fy y/z + cy, u_right = u_left - fx baseline / z
    (Tweddle 2013, Eqs 2.87-2.88 and 4.83-4.84 with the sign of c_x corrected).
    Parameters of a measurement: (p_g 3 m, fx, fy, cx, cy px, baseline m, those of the noise, such as pixel_std px).
    """

    name = "stereo"
    dim = 3
    value_dim = 3
    needs = ("t", "a")

    def __init__(self, layout: StateLayout, noise: SensorNoiseModel | None = None) -> None:
        super().__init__(layout)
        self.noise = noise or IsotropicNoise(3)
        self.parameter_dim = 8 + self.noise.parameter_dim

    def symbolic(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        p = state["t"] + rotate(state["q"], parameters[:3])
        fx, fy, cx, cy, baseline = (parameters[k] for k in range(3, 8))
        depth = ca.fmax(p[2], NEAREST_DEPTH)
        u = fx * p[0] / depth + cx
        return ca.vertcat(u, fy * p[1] / depth + cy, u - fx * baseline / depth)

    def noise_factor(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        return self.noise.factor(parameters[8:])

    def valid(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        return (state["t"] + rotate(state["q"], parameters[:3]))[2] - NEAREST_DEPTH

    def landmark(
        self, state: dict[str, Expression], measured: Expression, parameters: Expression
    ) -> Expression:
        fx, fy, cx, cy, baseline = (parameters[k] for k in range(3, 8))
        depth = fx * baseline / ca.fmax(measured[0] - measured[2], SMALLEST_DENOMINATOR)
        seen = ca.vertcat((measured[0] - cx) / fx, (measured[1] - cy) / fy, 1) * depth
        return rotate(conjugate(state["q"]), seen - state["t"])

    def determined(self, measured: Expression, parameters: Expression) -> Expression:
        return (
            measured[0] - measured[2] - SMALLEST_DISPARITY * self.noise.difference_std(parameters[8:], 0, 2)
        )


def stereo_parameters(
    points: Float[np.ndarray, "count 3"], calibration: Float[np.ndarray, " 5"], noise: NoiseLevel
) -> Float[np.ndarray, "count p"]:
    """Parameters of landmarks at ``points`` (frame g, m) for a rig (fx, fy, cx, cy, baseline).

    Parameters
    ----------
    noise: pixel_std (px) of every coordinate, or (count, 3, 3) covariances (px^2).
    """
    count = len(points)
    return np.concatenate([points, np.tile(calibration, (count, 1)), noise_parameters(noise, count)], axis=1)
