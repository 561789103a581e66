"""A landmark seen by one camera: a direction without a distance."""

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.attitude.expressions import Expression, rotate
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.sensors.stereo_landmark import NEAREST_DEPTH


class MonocularLandmark(MeasurementModel):
    """z = (u, v) in pixels of the point p_g, camera frame = frame i: p_c = t + R_ig p_g, u = fx x/z + cx, v = fy y/z + cy
    (Tweddle 2013, Eqs 2.87-2.88 with the sign of c_x corrected).

    Parameters of a measurement: (p_g 3 m, fx, fy, cx, cy px, pixel_std px). One view does not tell the distance, so this is no
    `LandmarkSensor`: a landmark cannot be made from a single measurement.
    """

    name = "monocular"
    dim = 2
    value_dim = 2
    parameter_dim = 8
    needs = ("t", "a")

    def symbolic(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        p = state["t"] + rotate(state["q"], parameters[:3])
        fx, fy, cx, cy = (parameters[k] for k in range(3, 7))
        depth = ca.fmax(p[2], NEAREST_DEPTH)
        return ca.vertcat(fx * p[0] / depth + cx, fy * p[1] / depth + cy)

    def noise_factor(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        return parameters[7] * ca.DM.eye(2)

    def valid(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        return (state["t"] + rotate(state["q"], parameters[:3]))[2] - NEAREST_DEPTH


def monocular_parameters(
    points: Float[np.ndarray, "count 3"], calibration: Float[np.ndarray, " 4"], pixel_std: float
) -> Float[np.ndarray, "count 8"]:
    """Parameters of landmarks at ``points`` (frame g, m) for a camera (fx, fy, cx, cy)."""
    count = len(points)
    return np.concatenate([points, np.tile(calibration, (count, 1)), np.full((count, 1), pixel_std)], axis=1)
