"""Coefficient of a drag that is linear in the rate: w' loses l w, so that the angular momentum falls as exp(-l t)."""

from typing import Final

from spinfilters.attitude.expressions import Expression
from spinfilters.state.block import ReportedConstant, RotationParameters, StateBlock


def _coefficient(point: Expression) -> Expression:
    return point


LINEAR_DRAG: Final = StateBlock(
    name="l",
    rank=11,
    dimension=1,
    unit="1/s",
    label="linear drag",
    phrase="the linear drag",
    constant=True,
    prior_std=0.5,
    prior_option="linear_drag_std",
    rotation=RotationParameters(1, _coefficient),
    reported=ReportedConstant("linear_drag_per_s", "linear_drag_std_per_s", ".2e", ".1e"),
)
