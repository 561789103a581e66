"""Rotation of a torque-free body about its angular momentum (elliptic integral of the third kind).

Let e be the signed axis C of the polhode, h the momentum in body axes, and S the smallest rotation that takes
e to h / |h|. Then R_ib(t) = M Rot(e, psi(t)) S(t)' with a constant M, and the twist psi obeys

    psi' = (2 T + h w_C) / (h + J_C w_C),   w_C = gamma dn(u) >= 0, h = |h|, T the rotational energy.

It is bounded by 2 |w|, positive and smooth, unlike Euler's precession angle, which jumps where h passes an
axis. With D = h^2 - 2 T J_C, psi' = g - k f(u) where g is the value at w_C = gamma,

    f(u) = sn^2 / ((h + J_C gamma dn) (1 + dn)),   k = D gamma m / (h + J_C gamma).

f is even, has the period 2K and is analytic for |Im u| < K', so its Fourier series converges as exp(-pi n
K'/K) and is integrated term by term. On the separatrix (K infinite) the integral is elementary.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.dynamics.euler_rates import EulerRates
from spinfilters.dynamics.jacobi_elliptic import jacobi_functions
from spinfilters.dynamics.polhode import PolhodeShape

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
    """c_n of f(u) = sum c_n cos(n pi u / K), by the trapezoidal rule.

    It converges as the series does.
    """
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
    """Twist on the separatrix, m1 = 0.

    The integral of psi' = 2 T/h + D gamma / (h (h cosh u + J_C gamma)).
    """
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
