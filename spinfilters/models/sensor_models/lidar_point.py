"""Range to a point of a known plane of the body.

A lidar measures it at an instant of its own within a scan.
"""

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.attitude.expressions import Expression, normalised, quaternion_rate, rotate
from spinfilters.dynamics.mass_distribution import inertia
from spinfilters.models.cholesky_parameters import factor_of, parameters_of
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.process import body_acceleration
from spinfilters.state.blocks.drag import DRAG
from spinfilters.state.blocks.rotor import ROTOR
from spinfilters.state.layout import StateLayout

GRAZING = 0.02
"""Cosine between a beam and the inward normal, at least: below, a beam skims the plane and its range tells nothing."""
STEPS = 2
"""Runge-Kutta steps from the scan's epoch to the point's stamp: error below 2e-5 rad for a rotation of 0.5 rad."""


class LidarPoint(MeasurementModel):
    """z = (d + n.t) / (n.u), the range along a lidar's beam, m.

    Where the beam u of the lidar, at the origin of i, meets the plane n_g.p = d.
    n = R_ig n_g and t are those at the point's own stamp: the state is taken there from the scan's epoch by its rates, its velocity
    and Euler's equation, so that the motion during a scan is part of the model. u = (cos E cos A, sin E, cos E sin A).
    The noise is that of the range, and of the angles as they change the range: s^2 = h S h', h = (1, -dz/dA, -dz/dE).
    Parameters of a measurement: A and E rad, delay of the stamp after the epoch s, n_g (3), d m, and the 6 entries, row by row, of
    the lower Cholesky factor of S, m and rad.
    """

    name = "lidar-points"
    dim = 1
    value_dim = 1
    parameter_dim = 13

    def __init__(self, layout: StateLayout) -> None:
        super().__init__(layout)
        self.needs = (
            "t",
            "a",
            "v",
            "w",
            "c",
            "s",
            *(each.name for each in (DRAG, ROTOR) if layout.has(each)),
        )

    def symbolic(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Range at which the ray meets the face, m."""
        n, distance = self._plane(state, parameters)
        return distance / ca.dot(n, _beam(parameters))

    def noise_factor(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Noise of the range, with the angles' errors by the incidence, m."""
        n, distance = self._plane(state, parameters)
        angles = ca.SX.sym("angles", 2)
        expected = distance / ca.dot(n, _beam(angles))
        slopes = ca.substitute(ca.jacobian(expected, angles), angles, ca.SX(parameters[:2]))
        h = ca.horzcat(1, -slopes)
        return ca.norm_2(h @ factor_of(parameters[7:], 3))

    def valid(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Positive where the beam meets the plane from outside, before the lidar."""
        n, distance = self._plane(state, parameters)
        return ca.fmin(-ca.dot(n, _beam(parameters)) - GRAZING, -distance)

    def _plane(self, state: dict[str, Expression], parameters: Expression) -> tuple[Expression, Expression]:
        """Normal in i and signed distance from the lidar, m, at the stamp."""
        delay, n_g, offset = parameters[2], parameters[3:6], parameters[6]
        q = _attitude_after(state, delay)
        c = state["c"]
        place = state["t"] + rotate(state["q"], c) + delay * state["v"] - rotate(q, c)
        n = rotate(q, n_g)
        return n, offset + ca.dot(n, place)


def lidar_point_parameters(
    angles: Float[np.ndarray, "n 2"],
    delay: Float[np.ndarray, " n"],
    planes: Float[np.ndarray, "n 4"],
    covariance: Float[np.ndarray, "n 3 3"],
) -> Float[np.ndarray, "n 13"]:
    """Parameters of lidar points.

    Azimuth and elevation rad, delay s, unit normals n_g and offsets d m, covariances (m, rad, rad).

    Raises
    ------
    numpy.linalg.LinAlgError: when a covariance is not positive definite.
    """
    return np.column_stack([angles, delay, planes, parameters_of(covariance)])


def _beam(angles: Expression) -> Expression:
    azimuth, elevation = angles[0], angles[1]
    level = ca.cos(elevation)
    return ca.vertcat(level * ca.cos(azimuth), ca.sin(elevation), level * ca.sin(azimuth))


def _attitude_after(state: dict[str, Expression], delay: Expression) -> Expression:
    """q_ig after ``delay`` s, which may be negative, by Runge-Kutta 4 of attitude and rate."""
    J, drag, rotor, h = inertia(state["s"]), state.get("d"), state.get("h"), delay / STEPS

    def rates(x: Expression) -> Expression:
        """Time derivatives of attitude and rate."""
        return ca.vertcat(quaternion_rate(x[:4], x[4:]), body_acceleration(x[4:], J, drag, rotor=rotor))

    x = ca.vertcat(state["q"], state["w"])
    for _ in range(STEPS):
        one = rates(x)
        two = rates(x + h / 2 * one)
        three = rates(x + h / 2 * two)
        four = rates(x + h * three)
        x = x + h / 6 * (one + 2 * two + 2 * three + four)
    return normalised(x[:4])
