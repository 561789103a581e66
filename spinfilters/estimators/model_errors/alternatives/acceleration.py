"""A constant acceleration of the centre of mass: gravity, thrust, drag of the air on a fast throw."""

from typing import Final

import numpy as np

from spinfilters.estimators.model_errors.linear_rows import Columns
from spinfilters.estimators.model_errors.model_error import ModelError
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.state.blocks.acceleration import ACCELERATION


class ConstantAcceleration(ModelError):
    """v' gains a constant, i axes."""

    name, phrase, unit = "acceleration", "a constant acceleration", "m/s^2"
    cure = "set process.gravity = true"
    block = ACCELERATION

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        if not motion.translates:
            return None
        return motion.disturbed(linear=np.tile(np.eye(3), (len(motion.time), 1, 1)))


MODEL_ERRORS: Final = (ConstantAcceleration(),)
