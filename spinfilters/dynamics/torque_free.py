"""Exact torque-free motion of a rigid body in closed form.

Rate and attitude, the reference of every integrator.
Jacobi (1849); Landau and Lifshitz, Mechanics, section 37. The rate is in `euler_rates`, the turn about the
angular momentum in `momentum_twist`; this file joins them into an attitude and treats the rates that stay
fixed.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.dynamics.euler_rates import EulerRates, euler_rates
from spinfilters.dynamics.momentum_twist import momentum_twist
from spinfilters.dynamics.polhode import is_fixed_rate
from spinfilters.dynamics.principal_moments import finite_vector, validate_principal_moments
from spinfilters.errors import InputError

NEGLIGIBLE_RATE: Final[float] = 1e-140
"""Components below this part of the largest are set to zero: their squares would underflow.

From there an unstable spin takes at least 51 revolutions to leave its axis."""

UNIT_NORM_TOLERANCE: Final[float] = 1e-6
"""A quaternion further than this from unit norm is taken for a mistake, a closer one is normalised."""


@dataclass(frozen=True)
class TorqueFreeMotion:
    """Time in s, attitude q_ib (Hamilton, scalar last, continuous), rate in body principal axes in rad/s."""

    time: Float[np.ndarray, "*batch"]
    attitude: Float[np.ndarray, "*batch 4"]
    rate: Float[np.ndarray, "*batch 3"]


def torque_free_motion(
    principal_moments: Float[np.ndarray, "3"],
    rate0: Float[np.ndarray, "3"],
    time: Float[np.ndarray, "*batch"],
    attitude0: Float[np.ndarray, "4"] | None = None,
) -> TorqueFreeMotion:
    """Rate and attitude at times of a torque-free motion.

    Every `time` (s, any sign, any shape) of a body that moves freely from t = 0.
    `principal_moments` in any order, kg m^2 up to a common factor; `rate0` (rad/s, body principal axes) and
    `attitude0` (q_ib, default identity) hold at t = 0. Over 100 revolutions the error is about 1e-13 of |w|
    and 1e-13 rad for the doubles given as input, also next to the separatrix and for nearly equal moments.
    Raises: `ShapeError` and `InputError` for moments of no rigid body, numbers not finite, quaternions not of
    norm one.
    """
    moments = validate_principal_moments(principal_moments)
    rate0 = finite_vector(rate0, 3, "rate0", "rad/s")
    attitude0 = _unit_quaternion(np.array([0.0, 0.0, 0.0, 1.0]) if attitude0 is None else attitude0)
    time = np.array(time, dtype=np.float64)
    if not np.all(np.isfinite(time)):
        raise InputError("time holds NaN or infinity; give finite times in s")
    moments, rate0, scale = _scaled(moments, rate0)
    flat_time = time.reshape(-1) * scale
    if is_fixed_rate(moments, rate0):
        rate, turn = _fixed_rate_motion(rate0, flat_time)
    else:
        rate, turn = _moving_rate_motion(moments, rate0, flat_time)
    attitude = _product(attitude0, turn).reshape(*time.shape, 4)
    return TorqueFreeMotion(time, attitude, rate.reshape(*time.shape, 3) * scale)


def _scaled(
    moments: Float[np.ndarray, "3"], rate: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"], float]:
    """Moments and rate of order one, and the unit of the rate in rad/s.

    Powers of two, so exact: squares of the scaled numbers neither overflow nor underflow.
    """
    unit = float(2.0 ** np.frexp(np.max(np.abs(rate)))[1])
    kept = np.where(np.abs(rate) < NEGLIGIBLE_RATE * np.max(np.abs(rate)), 0.0, rate)
    return moments / 2.0 ** np.frexp(np.max(moments))[1], kept / unit, unit


def _fixed_rate_motion(
    rate: Float[np.ndarray, "3"], time: Float[np.ndarray, "*batch"]
) -> tuple[Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch 4"]]:
    """Constant rate, and the turn about it since t = 0."""
    speed = float(np.linalg.norm(rate))
    direction = rate / speed if speed > 0.0 else np.array([0.0, 0.0, 1.0])
    return np.broadcast_to(rate, (*time.shape, 3)).copy(), _turn_about(direction, speed * time)


def _moving_rate_motion(
    moments: Float[np.ndarray, "3"], rate0: Float[np.ndarray, "3"], time: Float[np.ndarray, "*batch"]
) -> tuple[Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch 4"]]:
    """Rate, and the turn since t = 0 as S(0) Rot(e, psi) S(t)' (see `momentum_twist`)."""
    rates = euler_rates(moments, rate0)
    rate = rates.rate(time)
    twist = _turn_about(_encircled_axis(rates), momentum_twist(moments, rate0, rates, time))
    conjugate = _tilt(moments * rate, rates) * np.array([-1.0, -1.0, -1.0, 1.0])
    return rate, _product(_product(_tilt(moments * rate0, rates), twist), conjugate)


def _encircled_axis(rates: EulerRates) -> Float[np.ndarray, "3"]:
    """e: the axis that the polhode goes round, pointing to the side of the rate."""
    axis = np.zeros(3)
    axis[rates.shape.axes[2]] = rates.signs[1]
    return axis


def _tilt(momentum: Float[np.ndarray, "*batch 3"], rates: EulerRates) -> Float[np.ndarray, "*batch 4"]:
    """Quaternion S of the smallest rotation from e to h.

    (e x h, |h| + e.h) / norm, never 180 degrees.
    """
    axis = _encircled_axis(rates)
    vector = np.cross(axis, momentum)
    scalar = np.linalg.norm(momentum, axis=-1) + momentum @ axis
    quaternion = np.concatenate([vector, scalar[..., None]], axis=-1)
    return quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True)


def _turn_about(
    direction: Float[np.ndarray, "3"], angle: Float[np.ndarray, "*batch"]
) -> Float[np.ndarray, "*batch 4"]:
    """Quaternion of the turn by an angle in rad about a unit vector."""
    half = 0.5 * np.asarray(angle)
    return np.concatenate([np.sin(half)[..., None] * direction, np.cos(half)[..., None]], axis=-1)


def _product(
    left: Float[np.ndarray, "*#batch 4"], right: Float[np.ndarray, "*#batch 4"]
) -> Float[np.ndarray, "*#batch 4"]:
    """Hamilton product, scalar last: R(product) = R(left) R(right)."""
    v, s, u, w = left[..., :3], left[..., 3:], right[..., :3], right[..., 3:]
    vector = s * u + w * v + np.cross(v, u)
    scalar = s * w - np.sum(v * u, axis=-1, keepdims=True)
    return np.concatenate([vector, scalar], axis=-1)


def _unit_quaternion(quaternion: Float[np.ndarray, "4"]) -> Float[np.ndarray, "4"]:
    """The quaternion of norm one, or `InputError` if it is far from it."""
    quaternion = finite_vector(quaternion, 4, "attitude0", "quaternion [x, y, z, w]")
    norm = float(np.linalg.norm(quaternion))
    if abs(norm - 1.0) > UNIT_NORM_TOLERANCE:
        raise InputError(f"attitude0 has the norm {norm:.6g}; give a unit quaternion [x, y, z, w]")
    return quaternion / norm
