"""Polhode: the closed curve of a torque-free body's rate in body axes.

It is the intersection of the momentum and energy ellipsoids (Tweddle 2013, Eqs 2.78-2.81). With axis C the
one that the curve goes round, A the opposite extreme axis and B the intermediate one, it is

    w_A = alpha cos(phi),   w_B = beta sin(phi),   w_C = +-gamma sqrt(1 - m sin(phi)^2)

and phi is the Jacobi amplitude of the time (Landau and Lifshitz, Mechanics, section 37). Differences such as
2 T J - h^2 decide everything and cancel badly, so the squares of all four constants are computed in rational
arithmetic, exactly.
"""

import math
from dataclasses import dataclass
from enum import Enum
from fractions import Fraction
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.dynamics.jacobi_elliptic import EllipticModulus
from spinfilters.dynamics.principal_moments import (
    angular_momentum,
    finite_vector,
    rotational_energy,
    validate_principal_moments,
)

SEPARATRIX_TOLERANCE: Final[float] = 1e-14
"""Largest m1 called a separatrix: rates rounded to double precision miss h^2 = 2 T J by about this much."""


class PolhodeKind(Enum):
    """Kind of a polhode by the axis that it encircles."""

    ABOUT_MAJOR = "about the axis of largest inertia"
    ABOUT_MINOR = "about the axis of smallest inertia"
    SEPARATRIX = "through the intermediate axis"
    POINT = "a fixed rate"


@dataclass(frozen=True)
class PolhodeShape:
    """Constants of a polhode that is not a point.

    `axes` are the indices of the body axes A, B, C (see the module); `amplitudes` alpha, beta, gamma in
    rad/s, positive; `modulus` holds m and 1 - m.
    """

    axes: tuple[int, int, int]
    amplitudes: tuple[float, float, float]
    modulus: EllipticModulus


@dataclass(frozen=True)
class Polhode:
    """Kind, closed curves and semi-axes of both ellipsoids, all rates in rad/s along body principal axes.

    The first point of a curve is repeated at its end. The two curves are mirror images; the motion stays on
    the one that holds its rate. On the separatrix they are the two ellipses that cross on the intermediate
    axis, and the motion is on a half of one.
    """

    kind: PolhodeKind
    curves: Float[np.ndarray, "2 n 3"]
    momentum_semi_axes: Float[np.ndarray, " 3"]
    energy_semi_axes: Float[np.ndarray, " 3"]


def polhode(
    principal_moments: Float[np.ndarray, " 3"], rate: Float[np.ndarray, " 3"], points: int = 361
) -> Polhode:
    """The polhode of a rate of a body with these moments.

    Rad/s, principal axes; kg m^2, any order.
    """
    moments = validate_principal_moments(principal_moments)
    rate = finite_vector(rate, 3, "rate", "rad/s")
    momentum, energy = ellipsoid_semi_axes(moments, rate)
    kind = polhode_kind(moments, rate)
    if kind is PolhodeKind.POINT:
        curves = np.stack([np.tile(rate, (points, 1)), np.tile(-rate, (points, 1))])
    else:
        curves = _curves(polhode_shape(moments, rate), kind, points)
    return Polhode(kind, curves, momentum, energy)


def ellipsoid_semi_axes(
    principal_moments: Float[np.ndarray, " 3"], rate: Float[np.ndarray, " 3"]
) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
    """Semi-axes H / J and sqrt(2 E / J) of both ellipsoids, rad/s.

    Momentum and energy (Tweddle 2013, Eqs 2.79 and 2.81).
    """
    momentum = float(np.linalg.norm(angular_momentum(principal_moments, rate)))
    energy = float(rotational_energy(principal_moments, rate))
    return momentum / principal_moments, np.sqrt(2.0 * energy / principal_moments)


def polhode_kind(principal_moments: Float[np.ndarray, " 3"], rate: Float[np.ndarray, " 3"]) -> PolhodeKind:
    """Kind of the polhode as a set of points.

    A spin exactly about the intermediate axis is a fixed rate, but the ellipsoids meet in the separatrix,
    which is what is returned. Where two or three moments are equal, rates that stay fixed give a point.
    """
    minor, middle, major = (int(i) for i in np.argsort(principal_moments, kind="stable"))
    distinct = principal_moments[minor] < principal_moments[middle] < principal_moments[major]
    about_middle = rate[minor] == 0.0 and rate[major] == 0.0 and rate[middle] != 0.0
    if is_fixed_rate(principal_moments, rate) and not (distinct and about_middle):
        return PolhodeKind.POINT
    shape = polhode_shape(principal_moments, rate)
    if shape.modulus.complement <= SEPARATRIX_TOLERANCE:
        return PolhodeKind.SEPARATRIX
    return PolhodeKind.ABOUT_MAJOR if shape.axes[2] == major else PolhodeKind.ABOUT_MINOR


def is_fixed_rate(principal_moments: Float[np.ndarray, " 3"], rate: Float[np.ndarray, " 3"]) -> bool:
    """Whether J w x w is exactly zero.

    The body rests, is a sphere, or spins about a principal axis.
    """
    pairs = ((0, 1), (1, 2), (2, 0))
    return all(
        principal_moments[i] == principal_moments[j] or rate[i] == 0.0 or rate[j] == 0.0 for i, j in pairs
    )


def polhode_shape(principal_moments: Float[np.ndarray, " 3"], rate: Float[np.ndarray, " 3"]) -> PolhodeShape:
    """Constants of a polhode that is not a point, exact and then rounded once.

    Landau and Lifshitz, Mechanics, Eqs 37.8-37.12.
    """
    J = [Fraction(float(moment)) for moment in principal_moments]
    squares = [Fraction(float(component)) ** 2 for component in rate]
    minor, b, major = (int(i) for i in np.argsort(principal_moments, kind="stable"))
    above_separatrix = _momentum_excess(J, squares, b)
    a, c = (minor, major) if above_separatrix >= 0 else (major, minor)
    # Positive or zero: |h^2 - 2 T J_C| and |h^2 - 2 T J_A| are sums of terms of one sign.
    from_c, from_a = abs(_momentum_excess(J, squares, c)), abs(_momentum_excess(J, squares, a))
    ac, bc, ab = abs(J[c] - J[a]), abs(J[c] - J[b]), abs(J[b] - J[a])
    amplitudes = (from_c / (J[a] * ac), from_c / (J[b] * bc), from_a / (J[c] * ac))
    modulus = EllipticModulus(
        float(ab * from_c / (bc * from_a)), float(ac * abs(above_separatrix) / (bc * from_a))
    )
    alpha, beta, gamma = (math.sqrt(amplitude) for amplitude in amplitudes)
    return PolhodeShape((a, b, c), (alpha, beta, gamma), modulus)


def _momentum_excess(J: list[Fraction], squares: list[Fraction], axis: int) -> Fraction:
    """h^2 - 2 T J_axis = sum of J_i (J_i - J_axis) w_i^2, exactly."""
    return sum((J[i] * (J[i] - J[axis]) * squares[i] for i in range(3)), Fraction(0))


def _curves(shape: PolhodeShape, kind: PolhodeKind, points: int) -> Float[np.ndarray, "2 n 3"]:
    """Both closed curves at equal steps of the Jacobi amplitude."""
    phi = np.linspace(0.0, 2.0 * np.pi, points)
    sine, cosine = np.sin(phi), np.cos(phi)
    delta = np.sqrt(np.square(cosine) + shape.modulus.complement * np.square(sine))
    if kind is PolhodeKind.SEPARATRIX:
        delta = cosine
    curves = np.empty((2, points, 3))
    for axis, amplitude, profile in zip(shape.axes, shape.amplitudes, (cosine, sine, delta), strict=True):
        curves[:, :, axis] = amplitude * profile
    curves[1, :, shape.axes[2]] *= -1.0
    return curves
