"""Measured pose of the geometric frame. From absolute orientation, a scan match or an external tracker."""

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.attitude.expressions import Expression, conjugate, product, short_mrp_from_quaternion
from spinfilters.models.cholesky_parameters import factor_of, parameters_of
from spinfilters.models.measurement import MeasurementModel


class Pose(MeasurementModel):
    """z = (t, q_ig) with an innovation of dimension 6.

    (t, 4 x MRP on the body side).
    Parameters of a measurement: the 21 entries, row by row, of the lower Cholesky factor of its covariance (m, rad).
    """

    name = "pose"
    dim = 6
    value_dim = 7
    parameter_dim = 21
    needs = ("t", "a")

    def symbolic(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """(t, q_ig)."""
        return ca.vertcat(state["t"], state["q"])

    def innovation(self, expected: Expression, measured: Expression) -> Expression:
        """Difference of the positions, m, and 4 x MRP of that of the attitudes, rad."""
        turn = product(conjugate(expected[3:]), measured[3:])
        return ca.vertcat(measured[:3] - expected[:3], short_mrp_from_quaternion(turn))

    def noise_factor(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Lower factor of (t, a), m and rad."""
        return factor_of(parameters, 6)


class LidarPose(Pose):
    """A pose from a registered scan: its noise is a lidar's own."""

    name = "lidar-poses"


def pose_parameters(covariance: Float[np.ndarray, "count 6 6"]) -> Float[np.ndarray, "count 21"]:
    """Parameters of poses with these covariances, order (t, a).

    Raises
    ------
    numpy.linalg.LinAlgError: when a covariance is not positive definite.
    """
    return parameters_of(covariance)
