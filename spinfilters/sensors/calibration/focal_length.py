"""Relative error of the focal length.

Common to fx and fy and to both cameras of a pair.
"""

from typing import Final

import casadi as ca

from spinfilters.attitude.expressions import Expression
from spinfilters.data.consider_parameter import ConsiderParameter
from spinfilters.data.stated_values import NumberRange


def _moved(values: Expression, parameters: Expression, error: Expression) -> tuple[Expression, Expression]:
    return values, ca.vertcat(parameters[:3], parameters[3:5] * (1 + error), parameters[5:])


FOCAL_LENGTH: Final = ConsiderParameter(
    name="focal_std",
    words="focal length",
    allowed=NumberRange(0, 0.1, "of the focal length"),
    default=1e-3,
    sensors=("stereo", "monocular"),
    moved=_moved,
    order=0,
)
