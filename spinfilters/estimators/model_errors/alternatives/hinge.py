"""Parts that turn or slide inside a body: its inertia changes while it flies."""

import numpy as np

from spinfilters.estimators.model_errors.alternative import Alternative
from spinfilters.estimators.model_errors.alternatives.gyro_alternatives import SHEARS as TRACELESS
from spinfilters.estimators.model_errors.columns import Columns
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion


class Hinge(Alternative):
    """Linear change of the inertia over time, as of a hinge.

    J gains J^1/2 B J^1/2 s, B symmetric and traceless, s from -1 to 1: with D for it J w' loses (D s)' w, and turns with D s w.
    About the smoothed motion J dw' = (D s w) x w - D s w' - D s' w. What is constant is of the body's own
    shape, and a B that is a multiple of the identity brakes the rotation as drag does.
    """

    name, phrase, unit = "hinge", "parts that move inside (a hinge, an elbow)", "of the moments"
    plausible = 0.3
    cure = "lock the joint: of a body that is not rigid the moments cannot be told"

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """Columns of the inertia's traceless linear changes."""
        J, w, change = motion.inertia, motion.rates, motion.rate_change
        half = (motion.time[-1] - motion.time[0]) / 2
        share = ((motion.time - motion.time[0]) / half - 1)[:, None]
        values, axes = np.linalg.eigh(J)
        root = axes * np.sqrt(values) @ axes.T
        gained = [share * (np.cross(w @ D, w) - change @ D) - w @ D / half for D in root @ TRACELESS @ root]
        return motion.disturbed(angular=np.linalg.solve(J, np.stack(gained, axis=2)))
