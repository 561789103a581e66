"""Error of the principal point (cx, cy), px, common to both cameras of a rectified pair."""

from typing import Final

import casadi as ca

from spinfilters.attitude.expressions import Expression
from spinfilters.data.consider_parameter import ConsiderParameter
from spinfilters.data.stated_values import NumberRange


def _moved(values: Expression, parameters: Expression, error: Expression) -> tuple[Expression, Expression]:
    return values, ca.vertcat(parameters[:5], parameters[5:7] + error, parameters[7:])


PRINCIPAL_POINT: Final = ConsiderParameter(
    name="center_std",
    words="principal point",
    allowed=NumberRange(0, 1e3, "px"),
    default=0.5,
    sensors=("stereo", "monocular"),
    size=2,
    moved=_moved,
    order=1,
)
