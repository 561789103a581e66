"""Coefficient of a drag that brakes the rotation: w' loses d |w| w."""

from typing import Final

from spinfilters.attitude.expressions import Expression
from spinfilters.state.block import ReportedConstant, RotationParameters, StateBlock


def _coefficient(d: Expression) -> Expression:
    return d


DRAG: Final = StateBlock(
    name="d",
    rank=6,
    dimension=1,
    unit="1/rad",
    label="drag",
    phrase="the drag",
    constant=True,
    prior_std=0.05,
    prior_option="drag_std",
    rotation=RotationParameters(1, _coefficient),
    reported=ReportedConstant("drag_per_rad", "drag_std_per_rad", ".2e", ".1e"),
)
