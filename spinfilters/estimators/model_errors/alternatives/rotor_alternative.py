"""A flywheel inside the body, which holds angular momentum of its own."""

from typing import ClassVar

import numpy as np

from spinfilters.estimators.model_errors.alternative import Alternative
from spinfilters.estimators.model_errors.columns import Columns
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.state.blocks.rotor import ROTOR


class Rotor(Alternative):
    """Constant angular momentum h of a flywheel inside.

    J w' gains h x w; h in units of J times rad/s. What of it the moments take up leaves no residual: h along a spin about a
    principal axis is such a part, for there J w + h is the J' w of another body.
    """

    name, phrase, unit = "rotor", "a flywheel turning inside", "rad/s"
    plausible = 1.0
    cure = "set process.rotor = true, or stop the flywheel while recording"
    block = ROTOR
    held_by: ClassVar = {"process": {"rotor": True}}

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """Three columns of the flywheel's angular momentum, g axes."""
        cross = np.cross(np.eye(3)[:, None], motion.rates[None])  # h along each axis, epoch
        gained = np.linalg.solve(motion.inertia, np.moveaxis(cross, 0, 2))
        return motion.disturbed(angular=gained)
