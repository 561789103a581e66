"""Measured attitude of the geometric frame.

From a star tracker, or a scan match of which only the rotation is trusted.
"""

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.expressions import Expression, conjugate, product, short_mrp_from_quaternion
from spinfilters.models.cholesky_parameters import factor_of, parameters_of
from spinfilters.models.measurement import MeasurementModel


class Attitude(MeasurementModel):
    """z = q_ig with an innovation of 4 x MRP on the body side.

    Parameters of a measurement: the 6 entries, row by row, of the lower Cholesky factor of its covariance (rad).
    """

    name = "attitude"
    dim = 3
    value_dim = 4
    parameter_dim = 6
    needs = ("a",)

    def symbolic(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """q_ig."""
        return state["q"]

    def innovation(self, expected: Expression, measured: Expression) -> Expression:
        """4 x MRP of the rotation from the expected to the measured attitude, rad."""
        return short_mrp_from_quaternion(product(conjugate(expected), measured))

    def noise_factor(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Noise factor from the parameters, rad."""
        return factor_of(parameters, 3)


def attitude_parameters(covariance: Float[np.ndarray, "count 3 3"]) -> Float[np.ndarray, "count 6"]:
    """Parameters of attitudes with these covariances, rad^2.

    Raises
    ------
    numpy.linalg.LinAlgError: when a covariance is not positive definite.
    """
    return parameters_of(covariance)
