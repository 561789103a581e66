"""Contact with a hand or the ground in the first or last epochs."""

from dataclasses import dataclass

import numpy as np

from spinfilters.estimators.model_errors.alternative import Alternative
from spinfilters.estimators.model_errors.columns import Columns
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion

SHARE, FEWEST = 0.05, 2
"""Of the epochs within which a contact ends or begins, and how many they are at least."""
MOST_SHARE = 0.25
"""Of a recording: a touch for longer is a constant force or torque."""


@dataclass(frozen=True)
class _Contact(Alternative):
    """A constant force and torque while it lasts."""

    def _touching(self, motion: SmoothedMotion, at_end: bool) -> Columns | None:
        count = max(FEWEST, round(SHARE * len(motion.time)))
        if count > MOST_SHARE * len(motion.time):
            return None
        touched = np.zeros(len(motion.time))
        touched[-count:] += at_end
        touched[:count] += not at_end
        each = touched[:, None, None] * np.eye(3)
        none = np.zeros_like(each)
        if not motion.translates:
            return motion.disturbed(angular=each)
        return motion.disturbed(
            angular=np.concatenate([each, none], axis=2), linear=np.concatenate([none, each], axis=2)
        )


class ContactAtBegin(_Contact):
    """In the first epochs."""

    name, phrase, unit = "contact-at-begin", "contact in the first epochs", "rad/s^2 and m/s^2"
    cure = "begin the recording later (--segment)"

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """Columns of accelerations in the first epochs."""
        return self._touching(motion, at_end=False)


class ContactAtEnd(_Contact):
    """In the last epochs."""

    name, phrase, unit = "contact-at-end", "contact in the last epochs", "rad/s^2 and m/s^2"
    cure = "end the recording earlier (--segment)"

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """Columns of accelerations in the last epochs."""
        return self._touching(motion, at_end=True)
