"""Relative error of the baseline of a stereo pair.

It scales the whole scene, which no residual shows.
"""

from typing import Final

import casadi as ca

from spinfilters.attitude.expressions import Expression
from spinfilters.data.consider_parameter import ConsiderParameter
from spinfilters.data.stated_values import NumberRange


def _moved(values: Expression, parameters: Expression, error: Expression) -> tuple[Expression, Expression]:
    return values, ca.vertcat(parameters[:7], parameters[7] * (1 + error), parameters[8:])


BASELINE: Final = ConsiderParameter(
    name="baseline_std",
    words="baseline",
    allowed=NumberRange(0, 0.1, "of the baseline"),
    default=1e-3,
    sensors=("stereo",),
    moved=_moved,
    order=2,
)
