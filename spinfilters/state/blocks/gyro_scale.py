"""Constant relative error of a rate gyro's scale: it reads (1 + k) w."""

from typing import Final

from spinfilters.state.block import ReportedConstant, StateBlock

GYRO_SCALE: Final = StateBlock(
    name="k",
    rank=10,
    dimension=1,
    unit="1",
    label="gyro scale",
    phrase="the scale of the gyro",
    constant=True,
    prior_std=0.05,
    prior_option="gyro_scale_error_std",
    reported=ReportedConstant("gyro_scale_error", "gyro_scale_error_std"),
)
