"""Drag of the air that brakes the rotation."""

from typing import Final

import numpy as np

from spinfilters.estimators.model_errors.linear_rows import Columns
from spinfilters.estimators.model_errors.model_error import ModelError
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.state.blocks.drag import DRAG


class Drag(ModelError):
    """w' loses d |w| w."""

    name, phrase, unit = "drag", "drag of the rotation", "1/rad"
    cure = "set process.drag = true"
    block = DRAG

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        speed = np.linalg.norm(motion.rates, axis=1, keepdims=True)
        return motion.disturbed(angular=-(speed * motion.rates)[:, :, None])


MODEL_ERRORS: Final = (Drag(),)
