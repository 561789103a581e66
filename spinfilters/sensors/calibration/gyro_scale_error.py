"""Relative error of a gyro's scale, common to its axes.

Data sheets of small gyros say about 1 % at most.
"""

from typing import Final

from spinfilters.attitude.expressions import Expression
from spinfilters.data.consider_parameter import ConsiderParameter
from spinfilters.data.stated_values import NumberRange
from spinfilters.state.blocks.gyro_scale import GYRO_SCALE


def _moved(values: Expression, parameters: Expression, error: Expression) -> tuple[Expression, Expression]:
    return values / (1 + error), parameters


GYRO_SCALE_ERROR: Final = ConsiderParameter(
    name="gyro_scale_std",
    words="scale of the gyro",
    allowed=NumberRange(0, 0.1, "of the rate"),
    default=5e-3,
    sensors=("gyro",),
    moved=_moved,
    block=GYRO_SCALE.name,
    order=3,
)
