"""A constant torque in body axes: a leak, a thruster left on."""

from typing import Final

import numpy as np

from spinfilters.estimators.model_errors.linear_rows import Columns
from spinfilters.estimators.model_errors.model_error import ModelError
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.state.blocks.torque import TORQUE


class ConstantTorque(ModelError):
    """w' gains a constant, g axes."""

    name, phrase, unit = "torque", "a constant body torque", "rad/s^2"
    cure = "set process.body_torque = true"
    block = TORQUE

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        return motion.disturbed(angular=np.tile(np.eye(3), (len(motion.time), 1, 1)))


MODEL_ERRORS: Final = (ConstantTorque(),)
