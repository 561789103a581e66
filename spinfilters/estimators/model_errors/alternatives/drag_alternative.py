"""Drag of the air that brakes the rotation."""

from typing import ClassVar

import numpy as np

from spinfilters.estimators.model_errors.alternative import Alternative
from spinfilters.estimators.model_errors.columns import Columns
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.state.blocks.drag import DRAG


class Drag(Alternative):
    """w' loses d |w| w."""

    name, phrase, unit = "drag", "drag of the rotation", "1/rad"
    plausible = 0.05
    only_positive = True
    cure = 'set process.drag = "auto"'
    block = DRAG
    held_by: ClassVar = {"process": {"drag": True}}

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """One column: angular deceleration by the square of the rate."""
        speed = np.linalg.norm(motion.rates, axis=1, keepdims=True)
        return motion.disturbed(angular=-(speed * motion.rates)[:, :, None])
