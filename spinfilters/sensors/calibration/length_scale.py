"""Relative error of the lengths of poses.

Printed markers and the focal lengths of those who look at them are known to about 1 %; it scales places, velocities, accelerations.
"""

from typing import Final

import casadi as ca

from spinfilters.attitude.expressions import Expression
from spinfilters.data.consider_parameter import ConsiderParameter
from spinfilters.data.stated_values import NumberRange


def _moved(values: Expression, parameters: Expression, error: Expression) -> tuple[Expression, Expression]:
    return ca.vertcat(values[:3] / (1 + error), values[3:]), parameters


LENGTH_SCALE: Final = ConsiderParameter(
    name="length_scale_std",
    words="lengths of poses",
    allowed=NumberRange(0, 0.1, "of lengths"),
    default=1e-2,
    sensors=("pose",),
    moved=_moved,
    order=4,
)
"""Relative error of the lengths that poses are told in."""
