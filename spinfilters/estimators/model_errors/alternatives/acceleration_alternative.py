"""Constant acceleration of the centre of mass.

Gravity, thrust, drag of the air on a fast throw.
"""

from typing import ClassVar

import numpy as np

from spinfilters.estimators.model_errors.alternative import Alternative
from spinfilters.estimators.model_errors.columns import Columns
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.state.blocks.acceleration import ACCELERATION


class ConstantAcceleration(Alternative):
    """v' gains a constant, i axes."""

    name, phrase, unit = "acceleration", "a constant acceleration", "m/s^2"
    cure = "set process.gravity = true"
    block = ACCELERATION
    held_by: ClassVar = {"process": {"gravity": True}}

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """Three columns of the acceleration of the centre of mass, i axes."""
        if not motion.translates:
            return None
        return motion.disturbed(linear=np.tile(np.eye(3), (len(motion.time), 1, 1)))
