"""Attitudes, body rates and positions measured directly in the first epochs."""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.conversions import (
    integrate_gyro,
    inverse,
    matrix_from_quaternion,
    multiply,
    rotation_vector_from_quaternion,
)
from spinfilters.errors import InputError
from spinfilters.estimators.initialisation.consistent_samples import consistent_samples
from spinfilters.sensors.sensor import MotionSamples

DEGREE = 4
"""Of the polynomial that a window of rotation vectors is fitted with; a steady spin is a straight line."""
LARGEST_TURN = 2.2
"""Rad from the middle of a window: well below pi, where rotation vectors stop being unique."""
LARGEST_WINDOW = 15


@dataclass(frozen=True)
class InitialMotion:
    """Motion at k times.

    Attributes
    ----------
    time: (k,) s.   attitude: (k, 4) q_ig.   rates: (k, 3) body rates, rad/s, g axes.
    positions: (k, 3) origins of g in i, m, or None when nothing measures them.
    defines_attitude: whether the first attitude is a definition of frame i rather than measured.
    """

    time: Float[np.ndarray, " k"]
    attitude: Float[np.ndarray, "k 4"]
    rates: Float[np.ndarray, "k 3"]
    positions: Float[np.ndarray, "k 3"] | None = None
    defines_attitude: bool = field(default=False, kw_only=True)

    @property
    def rotations(self) -> Float[np.ndarray, "k 3 3"]:
        """R_ig at every time."""
        return matrix_from_quaternion(self.attitude)


def initial_motion(samples: MotionSamples, epochs: int) -> InitialMotion:
    """Initial motion samples from the first ``epochs`` samples.

    Attitudes integrated from rates, or rates differenced from attitudes, as is missing.

    The rate at an attitude is the slope of a polynomial through the rotation vectors around it.

    Raises
    ------
    InputError: neither attitudes nor rates; without rates fewer than 4 attitudes, or a body that turns by more than half a
        revolution between two of them.
    """
    first = {name: getattr(samples, name) for name in ("attitude", "rates", "positions")}
    given = {name: None if values is None else values[:epochs] for name, values in first.items()}
    samples = consistent_samples(replace(samples, time=samples.time[:epochs], **given))
    time, positions = samples.time, samples.positions
    if samples.attitude is None and samples.rates is None:
        raise InputError(
            "a motion needs attitudes or body rates; give measurements of a sensor that tells them"
        )
    if samples.attitude is None:
        assert samples.rates is not None
        attitude = integrate_gyro(time, samples.rates, np.array([0.0, 0.0, 0.0, 1.0]))
        return InitialMotion(time, attitude, samples.rates, positions, defines_attitude=True)
    rates = _differenced(time, samples.attitude) if samples.rates is None else samples.rates
    return InitialMotion(time, samples.attitude, rates, positions)


def _differenced(time: Float[np.ndarray, " k"], q: Float[np.ndarray, "k 4"]) -> Float[np.ndarray, "k 3"]:
    """Body rates of attitudes."""
    if len(time) < 4:
        raise InputError(
            f"a start from poses needs at least 4 epochs, got {len(time)}; give a longer recording"
        )
    return _rates(time, q)


def _rates(time: Float[np.ndarray, " k"], q: Float[np.ndarray, "k 4"]) -> Float[np.ndarray, "k 3"]:
    """Slope at every pose of a polynomial through the rotation vectors to the poses around it."""
    half = LARGEST_WINDOW // 2
    around = np.arange(len(time))[:, None] + np.arange(-half, half + 1)
    inside = (around >= 0) & (around < len(time))
    around = np.clip(around, 0, len(time) - 1)
    phi = rotation_vector_from_quaternion(multiply(inverse(q)[:, None], q[around]))
    turn = np.linalg.norm(phi, axis=2)
    near = inside & (turn < LARGEST_TURN)
    reach = np.logical_and.accumulate
    used = np.concatenate([reach(near[:, half::-1], axis=1)[:, :0:-1], reach(near[:, half:], axis=1)], axis=1)
    count = np.count_nonzero(used, axis=1)
    if count.min() < 2:
        k = int(np.argmin(count))
        beside = turn[k, [half - 1, half + 1]][inside[k, [half - 1, half + 1]]]
        raise InputError(
            f"the body turns by {np.degrees(beside.min()):.0f} deg between epochs near t = {time[k]:.3f} s; "
            "more than about half a revolution per epoch cannot be told from its opposite: give a faster frame rate"
        )
    elapsed = np.where(used, time[around] - time[:, None], 0.0)
    scale = np.abs(elapsed).max(axis=1, keepdims=True)
    powers = (elapsed / scale)[..., None] ** np.arange(DEGREE + 1)
    told = used[..., None] & (np.arange(DEGREE + 1) < count[:, None, None])
    slope = np.linalg.pinv(np.where(told, powers, 0.0))[:, 1:2] @ phi
    return slope[:, 0] / scale
