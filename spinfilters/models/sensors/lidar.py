"""A lidar that measures range and angles of landmarks, for the observability analyser."""

import casadi as ca

from spinfilters.core.attitude_expressions import Expression, rotate
from spinfilters.models.measurement import MeasurementModel

NEAREST_RANGE = 1e-3
"""Range in m below which a point counts as at the lidar itself."""


class LidarLandmark(MeasurementModel):
    """z = t + R_ig p_g, the point in the lidar's frame i.

    m, with the noise of a range and of two angles.
    Range, azimuth and elevation are held as the point that they give: the same information, and neither square roots nor the
    poles of the angles. With r = |z| and u = z / r the noise covariance is range_std^2 u u' + (r angle_std)^2 (I - u u'):
    angle_std is that of azimuth and elevation as arcs on the sphere, alike in every direction.
    Parameters of a measurement: (p_g 3 m, range_std m, angle_std rad). The noise is taken where the map says that the point is,
    so that no landmark can be made from a measurement before one is known: this is no `LandmarkSensor`.
    """

    name = "lidar"
    dim = 3
    value_dim = 3
    parameter_dim = 5
    needs = ("t", "a")

    def symbolic(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """t + R_ig p_g, the point in frame i, m."""
        return state["t"] + rotate(state["q"], parameters[:3])

    def noise_factor(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Cholesky factor of the covariance along and across the beam, m."""
        p = self.symbolic(state, parameters)
        square = ca.fmax(ca.dot(p, p), NEAREST_RANGE**2)
        along = p @ p.T / square
        across = parameters[4] ** 2 * square * (ca.DM.eye(3) - along)
        return ca.chol(ca.SX(parameters[3] ** 2 * along + across)).T

    def valid(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Positive beyond the nearest range."""
        p = self.symbolic(state, parameters)
        return ca.dot(p, p) - NEAREST_RANGE**2
