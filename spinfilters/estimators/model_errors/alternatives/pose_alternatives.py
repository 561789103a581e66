"""Positions of poses that do not fit the attitudes beside them."""

from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.data.sensor_format import sensor_format
from spinfilters.estimators.model_errors.alternative import Alternative
from spinfilters.estimators.model_errors.columns import Columns
from spinfilters.estimators.model_errors.smoothed_motion import MeasuredRows, SmoothedMotion
from spinfilters.state.blocks.rigid_body import POSITION


class PositionDelay(Alternative):
    """Positions are later than the attitudes beside them.

    As of a tracker that filters both, or joins two of its parts.
    """

    name, phrase, unit = "position-delay", "positions that are later than their attitudes", "s"
    plausible = 0.2
    cure = "give positions and attitudes of one instant"

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """One column: positions of all poses late, attitudes in time."""
        if not motion.translates:
            return None
        velocity = motion.change[:, motion.rows.problem.layout.slice(POSITION.name)]

        def late(each: MeasuredRows) -> Float[np.ndarray, "r i m"] | None:
            """Their velocity; None of what is no pose."""
            positions = sensor_format(each.model.name).quaternion
            if not positions:
                return None
            found = np.zeros((len(each.epoch), each.model.dim, 1))
            found[:, :positions, 0] = velocity[each.epoch]
            return found

        return motion.shifted(late)


ALTERNATIVES: Final = (PositionDelay(),)
