"""Parts that turn or slide inside a body: its inertia changes while it flies."""

from itertools import combinations_with_replacement
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.model_errors.alternative import Alternative
from spinfilters.estimators.model_errors.linear_rows import Columns
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion


class Hinge(Alternative):
    """J gains D s(t), D symmetric, s linear and quadratic in time: J w' loses D s' w, and turns with the momentum D s w.

    About the smoothed motion J dw' = (D s w) x w - D s w' - D s' w. What D is constant in time is one of the body.
    """

    name, phrase, unit = "hinge", "parts that move inside (a hinge, an elbow)", "of the largest moment"
    cure = "lock the joint: of a body that is not rigid the moments cannot be told"

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        J, w, change = motion.inertia, motion.rates, motion.rate_change
        half = (motion.time[-1] - motion.time[0]) / 2
        x = (motion.time - motion.time[0]) / half - 1
        gained = []
        for shape, slope in ((x, np.ones_like(x) / half), (1.5 * x**2 - 0.5, 3 * x / half)):
            for D in _symmetric() * np.linalg.eigvalsh(J)[-1]:
                turned = np.cross(w @ D, w) - change @ D
                gained.append(shape[:, None] * turned - slope[:, None] * (w @ D))
        return motion.disturbed(angular=np.linalg.solve(J, np.stack(gained, axis=2)))


def _symmetric() -> Float[np.ndarray, "6 3 3"]:
    """A basis."""
    found = np.zeros((6, 3, 3))
    for each, (i, j) in zip(found, combinations_with_replacement(range(3), 2), strict=True):
        each[i, j] = each[j, i] = 1.0
    return found


ALTERNATIVES: Final = (Hinge(),)
