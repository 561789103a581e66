"""Positions of poses that do not fit the attitudes beside them."""

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.conversions import matrix_from_quaternion
from spinfilters.data.sensor_format import sensor_format
from spinfilters.estimators.model_errors.alternative import Alternative
from spinfilters.estimators.model_errors.columns import Columns
from spinfilters.estimators.model_errors.smoothed_motion import MeasuredRows, SmoothedMotion
from spinfilters.state.blocks.rigid_body import ATTITUDE, POSITION


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
        return _of_positions(motion, velocity[:, :, None])


class PointDrift(Alternative):
    """The tracked point moves evenly in the body, or the centre of mass does.

    As of a marker that slips, a tracker whose model of the body creeps, or a load that moves inside.
    Its size is the way from the first epoch to the last, g axes.
    """

    name, phrase, unit = "point-drift", "a tracked point that moves in the body", "m"
    plausible = 0.1
    cure = "the tracked point or the centre of mass moves in the body: fix it, or take a shorter recording"

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """Three columns: positions that move along each axis of the body."""
        if not motion.translates:
            return None
        since = (motion.time - motion.time[0]) / (motion.time[-1] - motion.time[0])
        turned = matrix_from_quaternion(motion.block(ATTITUDE.name))
        return _of_positions(motion, since[:, None, None] * turned)


def _of_positions(motion: SmoothedMotion, moved: Float[np.ndarray, "k 3 m"]) -> Columns | None:
    """Right-hand sides of poses whose positions alone move by so much, i axes."""

    def shift(each: MeasuredRows) -> Float[np.ndarray, "r i m"] | None:
        """Change of the innovations; None of what is no pose."""
        positions = sensor_format(each.model.name).quaternion
        if not positions:
            return None
        found = np.zeros((len(each.epoch), each.model.dim, moved.shape[2]))
        found[:, :positions] = moved[each.epoch]
        return found

    return motion.shifted(shift)
