"""A landmark seen by one camera: a direction without a distance."""

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.attitude.expressions import Expression, rotate
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.sensor_noise import IsotropicNoise, NoiseLevel, SensorNoiseModel, noise_parameters
from spinfilters.models.sensors.stereo_landmark import NEAREST_DEPTH
from spinfilters.state.layout import StateLayout


class MonocularLandmark(MeasurementModel):
    """z = (u, v) in pixels of the point p_g, camera frame = frame i: p_c = t + R_ig p_g, u = fx x/z + cx, v = fy y/z + cy
    (Tweddle 2013, Eqs 2.87-2.88 with the sign of c_x corrected).

    Parameters of a measurement: (p_g 3 m, fx, fy, cx, cy px, those of the noise, such as pixel_std px). One view does not tell the
    distance, so this is no `LandmarkSensor`: a landmark cannot be made from a single measurement.
    """

    name = "monocular"
    dim = 2
    value_dim = 2
    needs = ("t", "a")

    def __init__(self, layout: StateLayout, noise: SensorNoiseModel | None = None) -> None:
        super().__init__(layout)
        self.noise = noise or IsotropicNoise(2)
        self.parameter_dim = 7 + self.noise.parameter_dim

    def symbolic(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        p = state["t"] + rotate(state["q"], parameters[:3])
        fx, fy, cx, cy = (parameters[k] for k in range(3, 7))
        depth = ca.fmax(p[2], NEAREST_DEPTH)
        return ca.vertcat(fx * p[0] / depth + cx, fy * p[1] / depth + cy)

    def noise_factor(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        return self.noise.factor(parameters[7:])

    def valid(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        return (state["t"] + rotate(state["q"], parameters[:3]))[2] - NEAREST_DEPTH


def monocular_parameters(
    points: Float[np.ndarray, "count 3"], calibration: Float[np.ndarray, " 4"], noise: NoiseLevel
) -> Float[np.ndarray, "count p"]:
    """Parameters of landmarks at ``points`` (frame g, m) for a camera (fx, fy, cx, cy).

    Parameters
    ----------
    noise: pixel_std (px) of both coordinates, or (count, 2, 2) covariances (px^2).
    """
    count = len(points)
    return np.concatenate([points, np.tile(calibration, (count, 1)), noise_parameters(noise, count)], axis=1)
