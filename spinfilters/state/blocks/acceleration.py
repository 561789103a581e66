"""Constant acceleration of the centre of mass, such as gravity: v' = f, in i axes."""

from typing import Final

from spinfilters.state.block import ReportedConstant, StateBlock

ACCELERATION: Final = StateBlock(
    name="f",
    rank=8,
    dimension=3,
    unit="m/s^2",
    label="acceleration",
    phrase="the constant acceleration",
    constant=True,
    translational=True,
    prior_std=10.0,
    reported=ReportedConstant("acceleration", "acceleration_std"),
)
