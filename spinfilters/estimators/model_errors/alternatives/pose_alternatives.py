"""Positions of poses that do not fit the attitudes beside them."""

from abc import abstractmethod
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.data.sensor_format import sensor_format
from spinfilters.estimators.model_errors.alternative import Alternative
from spinfilters.estimators.model_errors.columns import Columns
from spinfilters.estimators.model_errors.smoothed_motion import MeasuredRows, SmoothedMotion
from spinfilters.state.blocks.rigid_body import POSITION


class _PositionAlternative(Alternative):
    """An error of the positions alone."""

    @abstractmethod
    def of_positions(self, motion: SmoothedMotion) -> Float[np.ndarray, "k 3 m"]:
        """Change of the position at every epoch, i axes, per unit."""

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """Shift of the positions of all poses by this error."""
        if not motion.translates:
            return None
        change = self.of_positions(motion)

        def moved(each: MeasuredRows) -> Float[np.ndarray, "r i m"] | None:
            """Positions changed, attitudes as they are; None of what is no pose."""
            positions = sensor_format(each.model.name).quaternion
            if not positions:
                return None
            found = np.zeros((len(each.epoch), each.model.dim, change.shape[2]))
            found[:, :positions] = change[each.epoch]
            return found

        return motion.shifted(moved)


class PositionDelay(_PositionAlternative):
    """They are later than the attitudes.

    As of a tracker that filters both, or joins two of its parts.
    """

    name, phrase, unit = "position-delay", "positions that are later than their attitudes", "s"
    plausible = 0.2
    cure = "give positions and attitudes of one instant"

    def of_positions(self, motion: SmoothedMotion) -> Float[np.ndarray, "k 3 m"]:
        """One column: their velocity."""
        return motion.change[:, motion.rows.problem.layout.slice(POSITION.name), None]


class PositionAxes(_PositionAlternative):
    """Their axes are stretched or mirrored against those of the attitudes."""

    name, phrase = (
        "position-axes",
        "axes of the positions that are mirrored or stretched against the attitudes'",
    )
    unit = "of the position, -2 where mirrored"
    cure = "check that both are right-handed, and in one frame"

    def of_positions(self, motion: SmoothedMotion) -> Float[np.ndarray, "k 3 m"]:
        """Three columns: every axis longer by its own share."""
        position = motion.block(POSITION.name)
        return position[:, :, None] * np.eye(3)


ALTERNATIVES: Final = (PositionDelay(), PositionAxes())
