"""Constant body torque as the angular acceleration m = J^-1 tau.

w' gains m, in g axes.
"""

from typing import Final

from spinfilters.attitude.expressions import Expression
from spinfilters.state.block import ReportedConstant, RotationParameters, StateBlock, vector_after_gauge_move


def _angular_acceleration(m: Expression) -> Expression:
    return m


TORQUE: Final = StateBlock(
    name="m",
    rank=9,
    dimension=3,
    unit="rad/s^2",
    label="body torque",
    phrase="the constant body torque",
    constant=True,
    prior_std=0.1,
    rotation=RotationParameters(3, _angular_acceleration),
    after_gauge_move=vector_after_gauge_move,
    reported=ReportedConstant("body_torque", "body_torque_std"),
)
