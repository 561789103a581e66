"""Drag of the air on a body's path."""

import numpy as np

from spinfilters.estimators.model_errors.alternative import Alternative
from spinfilters.estimators.model_errors.columns import Columns
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.state.blocks.rigid_body import VELOCITY


class AirResistance(Alternative):
    """v' loses k |v| v, i axes."""

    name, phrase, unit = "air-resistance", "air that brakes the path", "1/m"
    plausible = 1.0
    only_positive = True
    cure = "take a slower or shorter throw, or state a larger process.force_psd"

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """One column: deceleration along the velocity by its square."""
        if not motion.translates:
            return None
        v = motion.block(VELOCITY.name)
        return motion.disturbed(linear=-(np.linalg.norm(v, axis=1, keepdims=True) * v)[:, :, None])
