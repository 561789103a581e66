"""Constant bias of a rate gyro: it reads w + b, in g axes."""

from typing import Final

from spinfilters.state.block import ReportedConstant, StateBlock, vector_after_gauge_move

GYRO_BIAS: Final = StateBlock(
    name="b",
    rank=7,
    dimension=3,
    unit="rad/s",
    label="gyro bias",
    phrase="the bias of the gyro",
    constant=True,
    prior_std=0.003,
    prior_option="gyro_bias_std",
    after_gauge_move=vector_after_gauge_move,
    truth_field="gyro_bias",
    reported=ReportedConstant("gyro_bias", "gyro_bias_std"),
)
