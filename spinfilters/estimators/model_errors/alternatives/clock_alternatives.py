"""Errors of time stamps."""

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.model_errors.alternative import Alternative
from spinfilters.estimators.model_errors.columns import Columns
from spinfilters.estimators.model_errors.smoothed_motion import MeasuredRows, SmoothedMotion


class ClockJitter(Alternative):
    """Every epoch is measured earlier or later than it says."""

    name, phrase, unit = "clock-jitter", "jitter of the time stamps", "s"
    plausible = 0.1
    cure = "stamp measurements where they are made, not where they arrive"
    moving_cure = f"{cure}, and give poses of the camera that are known to what a pixel is (inspector.tum)"
    by_epoch = True

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """One column: every epoch late by a time of its own."""
        return motion.in_time(lambda each: np.ones((len(each.epoch), 1)))

    def is_possible(self, size: Float[np.ndarray, " m"], motion: SmoothedMotion) -> bool:
        """Whether stamps stay in order: less than an interval."""
        return bool(size[0] < np.median(np.diff(motion.time)))


class ClockDrift(Alternative):
    """Linear drift of the clock.

    Epochs are late by the square of the time from the middle, in units of its span.
    """

    name, phrase, unit = "clock-drift", "a drift of the clock's rate", "s over the recording"
    cure = "check the clock, and the unit of the time stamps"

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """One column: epochs late by the square of the scaled time."""
        span = motion.time[-1] - motion.time[0]
        late = 4 * ((motion.time - motion.time.mean()) / span) ** 2
        return motion.in_time(lambda each: late[each.epoch, None])

    def is_possible(self, size: Float[np.ndarray, " m"], motion: SmoothedMotion) -> bool:
        """Whether the clock runs forward at both ends."""
        return bool(abs(size[0]) < (motion.time[-1] - motion.time[0]) / 4)


class SensorDelay(Alternative):
    """All measurements of a sensor are late against those of the last one."""

    name, phrase, unit = "sensor-delay", "a time offset between the sensors", "s"
    plausible = 0.2
    cure = "shift the time stamps of one of them"

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """A column per sensor but the first: its measurements late."""
        names = list(dict.fromkeys(each.model.name for each in motion.measured))
        if len(names) < 2:
            return None

        def late(each: MeasuredRows) -> Float[np.ndarray, "r m"]:
            """Delay of a row, s per unit."""
            own = np.zeros((len(each.epoch), len(names) - 1))
            number = names.index(each.model.name)
            own[:, number : number + 1] = 1.0  # of the last there is no column
            return own

        return motion.in_time(late)
