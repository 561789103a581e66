"""An independent reference for torque-free motion: Taylor integration in fixed point of any precision.

Python integers scaled by 2^bits replace floating point; 128 bits are 38 digits. The power series of Euler's
equations and of q' = q (x) (w, 0) / 2 follow by recursion (convolution of coefficients); each step reaches as
far as its last coefficients allow. It shares nothing with the closed form under test.
"""

from dataclasses import dataclass
from fractions import Fraction
from operator import mul

import numpy as np
from jaxtyping import Float

BITS_PER_TERM = 3
"""A step of 1/8 of the radius of convergence gains three bits a term."""


@dataclass(frozen=True)
class ReferenceMotion:
    """Attitude q_ib (Hamilton, scalar last) and rate (rad/s, principal axes), rounded at the end."""

    attitude: Float[np.ndarray, "n 4"]
    rate: Float[np.ndarray, "n 3"]


def reference_motion(
    moments: Float[np.ndarray, "3"],
    rate0: Float[np.ndarray, "3"],
    time: Float[np.ndarray, " n"],
    attitude0: Float[np.ndarray, "4"],
    bits: int = 128,
) -> ReferenceMotion:
    """The motion at times that increase from 0 in absolute value and have one sign."""
    J = [Fraction(float(moment)) for moment in moments]
    ratios = [_fixed((J[(i + 1) % 3] - J[(i + 2) % 3]) / J[i], bits) for i in range(3)]
    rate = [_fixed(Fraction(float(w)), bits) for w in rate0]
    attitude = [_fixed(Fraction(float(q)), bits) for q in attitude0]
    now, rates, attitudes = Fraction(0), [], []
    for target in (Fraction(float(t)) for t in time):
        while now != target:
            series = _series(ratios, rate, attitude, bits)
            reach = _reach(series)
            step = min(abs(target - now), reach) * (1 if target > now else -1)
            state = [_horner(coefficients, _fixed(step, bits), bits) for coefficients in series]
            rate, attitude, now = state[:3], state[3:], now + step
        rates.append([_rounded(w, bits) for w in rate])
        attitudes.append([_rounded(q, bits) for q in attitude])
    return ReferenceMotion(np.array(attitudes), np.array(rates))


def _fixed(value: Fraction, bits: int) -> int:
    return round(value * (1 << bits))


def _rounded(value: int, bits: int) -> float:
    return float(Fraction(value, 1 << bits))


def _series(ratios: list[int], rate: list[int], attitude: list[int], bits: int) -> list[list[int]]:
    """Taylor coefficients of w_x, w_y, w_z, q_x, q_y, q_z, q_w about now."""
    w = [[component] for component in rate]
    q = [[component] for component in attitude]
    (x, y, z), (a, b, c, d) = w, q
    for n in range(bits // BITS_PER_TERM):
        products = [_convolution(y, z), _convolution(z, x), _convolution(x, y)]
        derivatives = [
            _convolution(d, x) + _convolution(b, z) - _convolution(c, y),
            _convolution(d, y) + _convolution(c, x) - _convolution(a, z),
            _convolution(d, z) + _convolution(a, y) - _convolution(b, x),
            -_convolution(a, x) - _convolution(b, y) - _convolution(c, z),
        ]
        for component, ratio, product in zip(w, ratios, products, strict=True):
            component.append(((ratio * product) >> (2 * bits)) // (n + 1))
        for component, derivative in zip(q, derivatives, strict=True):
            component.append((derivative >> (bits + 1)) // (n + 1))
    return [*w, *q]


def _convolution(left: list[int], right: list[int]) -> int:
    return sum(map(mul, left, reversed(right)))


def _reach(series: list[list[int]]) -> Fraction:
    """The step at which the last two terms of every series are below the resolution."""
    last = max(max(abs(c[-1]), abs(c[-2])) for c in series)
    return Fraction(2.0 ** (-last.bit_length() / (len(series[0]) - 2))) if last else Fraction(1)


def _horner(coefficients: list[int], step: int, bits: int) -> int:
    value = 0
    for coefficient in reversed(coefficients):
        value = ((value * step) >> bits) + coefficient
    return value
