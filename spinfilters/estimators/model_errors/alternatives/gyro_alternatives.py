"""Errors of a rate gyro."""

from abc import abstractmethod
from typing import ClassVar, Final

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.model_errors.alternative import Alternative
from spinfilters.estimators.model_errors.columns import Columns
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.state.blocks.gyro_bias import GYRO_BIAS
from spinfilters.state.blocks.gyro_scale import GYRO_SCALE

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
    """Linear drift of the gyro bias.

    w reads w + b s, with s from -1 at the begin to 1 in the end.
    """

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
