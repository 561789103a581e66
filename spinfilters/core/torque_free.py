"""Torque-free rotation in closed form: body rates by Jacobi elliptic functions, attitude about the angular momentum."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import quaternion_product
from spinfilters.core.errors import InputError
from spinfilters.core.polhode import (
    PolhodeShape,
    argument_of,
    finite_vector,
    is_fixed_rate,
    jacobi_functions,
    polhode_shape,
    positive_moments,
    validate_principal_moments,
)


@dataclass(frozen=True)
class EulerRates:
    """Elliptic parameters of a body rate that is not fixed.

    The polhode's shape, the signs (+1 or -1) of w_A and w_C, the argument u0 at t = 0, and lambda = du/dt in rad/s.
    """

    shape: PolhodeShape
    signs: tuple[float, float]
    phase: float
    frequency: float

    def argument(self, time: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
        """Argument u of the elliptic functions at times in s."""
        return self.phase + self.frequency * time

    def rate(self, time: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch 3"]:
        """Body rate in principal axes, rad/s, at times in s."""
        sn, cn, dn = jacobi_functions(self.argument(time), self.shape.modulus)
        alpha, beta, gamma = self.shape.amplitudes
        a, b, c = self.shape.axes
        rate = np.empty((*np.shape(time), 3))
        rate[..., a] = self.signs[0] * alpha * cn
        rate[..., b] = beta * sn
        rate[..., c] = self.signs[1] * gamma * dn
        return rate


def euler_rates(moments: Float[np.ndarray, "3"], rate0: Float[np.ndarray, "3"]) -> EulerRates:
    """Elliptic parameters of the motion from ``rate0`` (rad/s) at t = 0, which must not be fixed (`is_fixed_rate`)."""
    shape = polhode_shape(moments, rate0)
    a, b, c = shape.axes
    ac, bc = moments[c] - moments[a], moments[c] - moments[b]
    sine = rate0[b] * math.sqrt(moments[b] * abs(bc))
    cosine = rate0[a] * math.sqrt(moments[a] * abs(ac))
    radius = math.hypot(sine, cosine)
    sign_a, sign_c = math.copysign(1.0, rate0[a]), math.copysign(1.0, rate0[c])
    # J_B w_B' = +-(J_C - J_A) w_C w_A, plus where (A, B, C) is an even permutation of (x, y, z): Eq. 2.70 of
    # Tweddle (2013).
    parity = 1.0 if (b - a) % 3 == 1 else -1.0
    frequency = shape.amplitudes[2] * math.sqrt((ac / moments[b]) * (bc / moments[a]))
    return EulerRates(
        shape=shape,
        signs=(sign_a, sign_c),
        phase=argument_of(sine / radius, abs(cosine) / radius, shape.modulus),
        frequency=parity * math.copysign(1.0, ac) * sign_a * sign_c * frequency,
    )


LOG_ROUNDING: Final[float] = 42.0
"""Fourier terms are kept until exp(-42) = 6e-19, below rounding, as f may be large off the real axis."""

MINIMUM_HARMONICS: Final[int] = 8


@dataclass(frozen=True)
class Invariants:
    """|h|, 2 T, and the moment J_C of the axis that the polhode goes round."""

    momentum: float
    twice_energy: float
    moment: float


def momentum_twist(
    moments: Float[np.ndarray, "3"],
    rate0: Float[np.ndarray, "3"],
    rates: EulerRates,
    time: Float[np.ndarray, "*batch"],
) -> Float[np.ndarray, "*batch"]:
    """psi(t) - psi(0) in rad at times in s."""
    invariants = Invariants(
        momentum=float(np.linalg.norm(moments * rate0)),
        twice_energy=float(np.sum(moments * np.square(rate0))),
        moment=float(moments[rates.shape.axes[2]]),
    )
    if rates.shape.modulus.complement == 0.0:
        return _separatrix_twist(moments, invariants, rates, time)
    return _periodic_twist(moments, invariants, rates, time)


def _periodic_twist(
    moments: Float[np.ndarray, "3"],
    invariants: Invariants,
    rates: EulerRates,
    time: Float[np.ndarray, "*batch"],
) -> Float[np.ndarray, "*batch"]:
    """Secular part by the mean of psi', periodic part by the integrated Fourier series of f."""
    h, gamma, modulus = invariants.momentum, rates.shape.amplitudes[2], rates.shape.modulus
    start = h + invariants.moment * gamma
    factor = _excess(moments, rates.shape) * gamma * modulus.parameter / start
    coefficients = _fourier_coefficients(invariants, rates.shape)
    secular = (invariants.twice_energy + h * gamma) / start - factor * coefficients[0]
    angle = math.pi / modulus.quarter_period * rates.argument(time)
    angle0 = math.pi / modulus.quarter_period * rates.phase
    periodic = np.zeros(np.shape(time))
    for n in range(1, len(coefficients)):
        periodic += coefficients[n] / n * (np.sin(n * angle) - math.sin(n * angle0))
    return secular * time - factor / rates.frequency * modulus.quarter_period / math.pi * periodic


def _fourier_coefficients(invariants: Invariants, shape: PolhodeShape) -> Float[np.ndarray, " n"]:
    """c_n of f(u) = sum c_n cos(n pi u / K) by the trapezoidal rule, which converges as fast as the series."""
    quarter, width = shape.modulus.quarter_period, shape.modulus.complementary_quarter_period
    harmonics = max(MINIMUM_HARMONICS, math.ceil(LOG_ROUNDING * quarter / (math.pi * width)))
    samples = 2 * harmonics + 2
    sn, _, dn = jacobi_functions(np.arange(samples) * (2.0 * quarter / samples), shape.modulus)
    momentum = invariants.momentum + invariants.moment * shape.amplitudes[2] * dn
    spectrum = np.fft.rfft(np.square(sn) / (momentum * (1.0 + dn))).real / samples
    return np.concatenate([spectrum[:1], 2.0 * spectrum[1 : harmonics + 1]])


def _separatrix_twist(
    moments: Float[np.ndarray, "3"],
    invariants: Invariants,
    rates: EulerRates,
    time: Float[np.ndarray, "*batch"],
) -> Float[np.ndarray, "*batch"]:
    """Twist on the separatrix, m1 = 0: the integral of psi' = 2 T/h + D gamma / (h (h cosh u + J_C gamma))."""
    a, _, _ = rates.shape.axes
    alpha, _, gamma = rates.shape.amplitudes
    h = invariants.momentum
    root = moments[a] * alpha / h
    slope = root / (1.0 + invariants.moment * gamma / h)
    factor = _excess(moments, rates.shape) * gamma / (h * h) * 2.0 / (root * rates.frequency)
    bounded = np.arctan(slope * np.tanh(0.5 * rates.argument(time)))
    bounded0 = math.atan(slope * math.tanh(0.5 * rates.phase))
    return invariants.twice_energy / h * time + factor * (bounded - bounded0)


def _excess(moments: Float[np.ndarray, "3"], shape: PolhodeShape) -> float:
    """D = h^2 - 2 T J_C = -alpha^2 J_A (J_C - J_A), without cancellation."""
    a, _, c = shape.axes
    return float(-moments[a] * (moments[c] - moments[a]) * shape.amplitudes[0] ** 2)


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
    return motion_of_moments(validate_principal_moments(principal_moments), rate0, time, attitude0)


def motion_of_moments(
    moments: Float[np.ndarray, "3"],
    rate0: Float[np.ndarray, "3"],
    time: Float[np.ndarray, "*batch"],
    attitude0: Float[np.ndarray, "4"] | None = None,
) -> TorqueFreeMotion:
    """`torque_free_motion` of any three positive moments, such as those of the thesis' figures that no rigid body has."""
    moments = positive_moments(moments)
    rate0 = finite_vector(rate0, 3, "rate0", "rad/s")
    attitude0 = _unit_quaternion(np.array([0.0, 0.0, 0.0, 1.0]) if attitude0 is None else attitude0)
    time = np.array(time, dtype=np.float64)
    if not np.all(np.isfinite(time)):
        raise InputError("time holds NaN or infinity; give finite times in s")
    moments, rate0, scale = _scale_motion(moments, rate0)
    flat_time = time.reshape(-1) * scale
    if is_fixed_rate(moments, rate0):
        rate, turn = _fixed_rate_motion(rate0, flat_time)
    else:
        rate, turn = _moving_rate_motion(moments, rate0, flat_time)
    attitude = quaternion_product(attitude0, turn).reshape(*time.shape, 4)
    return TorqueFreeMotion(time, attitude, rate.reshape(*time.shape, 3) * scale)


def polhode_period(moments: Float[np.ndarray, "3"], rate0: Float[np.ndarray, "3"]) -> float:
    """Time in s after which the body rate returns: 4 K / lambda.

    It is infinite on the separatrix and for rates that stay fixed. A polhode about an axis of symmetry, a circle, has the period of
    the nutation. ``moments`` are positive (kg m^2), ``rate0`` in rad/s in body principal axes.
    """
    moments, rate0, scale = _scale_motion(
        positive_moments(moments), finite_vector(rate0, 3, "rate0", "rad/s")
    )
    if is_fixed_rate(moments, rate0):
        return math.inf
    rates = euler_rates(moments, rate0)
    return 4.0 * rates.shape.modulus.quarter_period / abs(rates.frequency * scale)


def _scale_motion(
    moments: Float[np.ndarray, "3"], rate: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"], float]:
    """Moments and rate scaled to order one, and the unit of the rate in rad/s.

    The scales are powers of two and so exact; squares of the scaled numbers neither overflow nor underflow.
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
    return rate, quaternion_product(quaternion_product(_tilt(moments * rate0, rates), twist), conjugate)


def _encircled_axis(rates: EulerRates) -> Float[np.ndarray, "3"]:
    """e: the axis that the polhode goes round, pointing to the side of the rate."""
    axis = np.zeros(3)
    axis[rates.shape.axes[2]] = rates.signs[1]
    return axis


def _tilt(momentum: Float[np.ndarray, "*batch 3"], rates: EulerRates) -> Float[np.ndarray, "*batch 4"]:
    """Quaternion S of the smallest rotation from e to h, (e x h, |h| + e.h) normalised; never 180 degrees."""
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


def _unit_quaternion(quaternion: Float[np.ndarray, "4"]) -> Float[np.ndarray, "4"]:
    """The quaternion of norm one, or `InputError` if it is far from it."""
    quaternion = finite_vector(quaternion, 4, "attitude0", "quaternion [x, y, z, w]")
    norm = float(np.linalg.norm(quaternion))
    if abs(norm - 1.0) > UNIT_NORM_TOLERANCE:
        raise InputError(f"attitude0 has the norm {norm:.6g}; give a unit quaternion [x, y, z, w]")
    return quaternion / norm
