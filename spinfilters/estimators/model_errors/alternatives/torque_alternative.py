"""A constant torque in body axes: a leak, a thruster left on."""

from typing import ClassVar

import numpy as np

from spinfilters.estimators.model_errors.alternative import Alternative
from spinfilters.estimators.model_errors.columns import Columns
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.state.blocks.torque import TORQUE


class ConstantTorque(Alternative):
    """w' gains a constant, g axes."""

    name, phrase, unit = "torque", "a constant body torque", "rad/s^2"
    cure = "set process.body_torque = true"
    block = TORQUE
    held_by: ClassVar = {"process": {"body_torque": True}}

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """Three columns of the angular acceleration, g axes."""
        return motion.disturbed(angular=np.tile(np.eye(3), (len(motion.time), 1, 1)))
