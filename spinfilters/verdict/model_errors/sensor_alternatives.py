"""Errors of time stamps, of a rate gyro, and of poses whose positions do not fit their attitudes."""

from abc import abstractmethod
from typing import ClassVar, Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.io.sensor_format import sensor_format
from spinfilters.models.state_blocks import ATTITUDE, GYRO_BIAS, GYRO_SCALE, POSITION
from spinfilters.verdict.model_errors.linear_rows import Columns
from spinfilters.verdict.model_errors.score_tests import Alternative
from spinfilters.verdict.model_errors.smoothed_motion import MeasuredRows, SmoothedMotion


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
    """Linear clock drift: epochs are late by the square of the time from the middle, in units of its span."""

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


SHEARS: Final = np.array(
    [
        [[0, 1, 0], [1, 0, 0], [0, 0, 0]],
        [[0, 0, 1], [0, 0, 0], [1, 0, 0]],
        [[0, 0, 0], [0, 0, 1], [0, 1, 0]],
        [[1, 0, 0], [0, -1, 0], [0, 0, 0]],
        [[0, 0, 0], [0, 1, 0], [0, 0, -1]],
    ],
    dtype=float,
)
"""Non-orthogonal axes and different scales; an alignment as a whole is one of frame g."""


class _GyroAlternative(Alternative):
    """An error of the rates that a gyro reads."""

    @abstractmethod
    def of_rates(self, motion: SmoothedMotion) -> Float[np.ndarray, "k 3 m"]:
        """Change of the rate at every epoch, g axes, per unit."""

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """Shift of the rates of all gyros by this error."""
        change = self.of_rates(motion)
        return motion.shifted(lambda each: change[each.epoch] if each.model.reads_rate else None)


class GyroBias(_GyroAlternative):
    """w reads w + b."""

    name, phrase, unit = "gyro-bias", "a bias of the gyro", "rad/s"
    plausible = 0.1
    cure = "set initialisation.gyro_bias_std"
    block = GYRO_BIAS
    held_by: ClassVar = {"initialisation": {"gyro_bias_std": 0.05}}

    def of_rates(self, motion: SmoothedMotion) -> Float[np.ndarray, "k 3 m"]:
        """Three columns of a constant shift."""
        return np.tile(np.eye(3), (len(motion.time), 1, 1))


class GyroDrift(_GyroAlternative):
    """Linear drift of the gyro bias: w reads w + b s, with s from -1 at the begin to 1 in the end."""

    name, phrase, unit = "gyro-drift", "a bias of the gyro that drifts", "rad/s"
    plausible = 0.05
    cure = "let the gyro warm up, or take a shorter recording (--segment)"

    def of_rates(self, motion: SmoothedMotion) -> Float[np.ndarray, "k 3 m"]:
        """Three columns of a shift linear in time."""
        time = motion.time
        return ((2 * time - time[0] - time[-1]) / (time[-1] - time[0]))[:, None, None] * np.eye(3)


class GyroScale(_GyroAlternative):
    """w reads (1 + k) w."""

    name, phrase, unit = "gyro-scale", "an error of the gyro's scale", "of the rate"
    plausible = 0.1
    cure = "set initialisation.gyro_scale_error_std, and check its unit (rad/s)"
    block = GYRO_SCALE
    held_by: ClassVar = {"initialisation": {"gyro_scale_error_std": GYRO_SCALE.prior_std}}

    def of_rates(self, motion: SmoothedMotion) -> Float[np.ndarray, "k 3 m"]:
        """One column proportional to the rates."""
        return motion.rates[:, :, None]


class GyroMisalignment(_GyroAlternative):
    """w reads (I + M) w, M symmetric and traceless."""

    name, phrase, unit = "gyro-misalignment", "misaligned axes of the gyro", "rad"
    plausible = 0.1
    cure = "calibrate the gyro's axes and their scales"

    def of_rates(self, motion: SmoothedMotion) -> Float[np.ndarray, "k 3 m"]:
        """Columns of rates mixed by the off-diagonal shears."""
        return np.einsum("mij,kj->kim", SHEARS, motion.rates)


class GyroLowPass(_GyroAlternative):
    """Low-pass filter of the gyro.

    w reads w + tau^2 w'' / 2: amplitudes fall with the square of the frequency; its lag is a shift of time.
    """

    name, phrase, unit = "gyro-low-pass", "a low-pass filter within the gyro", "s^2"
    plausible = 0.1
    cure = "set the gyro's bandwidth well above the wobble"

    def of_rates(self, motion: SmoothedMotion) -> Float[np.ndarray, "k 3 m"]:
        """One column: half the second derivative of the rates."""
        return np.gradient(motion.rate_change, motion.time, axis=0)[:, :, None] / 2


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
