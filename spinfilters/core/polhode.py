"""The polhode of a torque-free rotation: principal moments, its shape and elliptic modulus, and the Jacobi elliptic functions.

Its counterpart in space, the herpolhode with its radii, is in `spinfilters.core.rolling_motion`.
"""

import math
from dataclasses import dataclass
from enum import Enum
from fractions import Fraction
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.special import elliprf

from spinfilters.core.errors import InputError, ShapeError

SERIES_TERMS: Final[int] = 5
"""Highest index of a theta series; the first term left out is exp(-36 pi) = 1e-49 at m = 1/2."""

CIRCULAR_LIMIT: Final[float] = 0.5
"""The parameter up to which the series in q is used; there q equals the complementary nome."""


@dataclass(frozen=True)
class EllipticModulus:
    """Parameter m = k^2 and complement m1 = 1 - m, both to full relative accuracy."""

    parameter: float
    complement: float

    @property
    def quarter_period(self) -> float:
        """K(m), the real quarter period; infinite at m1 = 0."""
        return _quarter_period(self.complement)

    @property
    def complementary_quarter_period(self) -> float:
        """K(m1), the imaginary quarter period; infinite at m = 0."""
        return _quarter_period(self.parameter)


def jacobi_functions(
    argument: Float[np.ndarray, "*batch"], modulus: EllipticModulus
) -> tuple[Float[np.ndarray, "*batch"], Float[np.ndarray, "*batch"], Float[np.ndarray, "*batch"]]:
    """Jacobi's sn, cn and dn of a real argument, to a few 1e-16 besides the rounding of the argument."""
    if modulus.parameter <= CIRCULAR_LIMIT:
        return _circular_series(argument, modulus)
    period = 2.0 * modulus.quarter_period
    turns = np.rint(argument / period)
    reduced = argument - (turns * period if math.isfinite(period) else 0.0)
    sign = np.where(turns % 2 == 0, 1.0, -1.0)
    sn, cn, dn = _hyperbolic_series(reduced, modulus)
    return sign * sn, sign * cn, dn


def argument_of(sine: float, cosine: float, modulus: EllipticModulus) -> float:
    """The u in [-K, K] with sn u = `sine`, cn u = `cosine` >= 0, by Carlson's R_F (DLMF 19.25.5)."""
    square = cosine * cosine
    return float(sine * elliprf(square, square + modulus.complement * sine * sine, 1.0))


def _quarter_period(complement: float) -> float:
    """pi / (2 agm(1, sqrt(m1))), DLMF 19.8.5."""
    larger, smaller = 1.0, math.sqrt(complement)
    if smaller == 0.0:
        return math.inf
    while larger - smaller > 4e-16 * larger:
        larger, smaller = 0.5 * (larger + smaller), math.sqrt(larger * smaller)
    return math.pi / (larger + smaller)


def _circular_series(
    argument: Float[np.ndarray, "*batch"], modulus: EllipticModulus
) -> tuple[Float[np.ndarray, "*batch"], Float[np.ndarray, "*batch"], Float[np.ndarray, "*batch"]]:
    """sn, cn, dn as ratios of theta functions of z = pi u / 2K; theta 1, 2 lack the factor 2 q^(1/4)."""
    quarter = modulus.quarter_period
    nome = math.exp(-math.pi * modulus.complementary_quarter_period / quarter)
    z = 0.5 * math.pi / quarter * argument
    theta1, theta2 = np.sin(z), np.cos(z)
    theta3, theta4 = np.ones_like(z), np.ones_like(z)
    for n in range(1, SERIES_TERMS + 1):
        odd = nome ** (n * (n + 1))
        even = 2.0 * nome ** (n * n) * np.cos(2 * n * z)
        theta1 = theta1 + (-1) ** n * odd * np.sin((2 * n + 1) * z)
        theta2 = theta2 + odd * np.cos((2 * n + 1) * z)
        theta3, theta4 = theta3 + even, theta4 + (-1) ** n * even
    null2, null3, null4 = _theta_constants(nome)
    return null3 / null2 * theta1 / theta4, null4 / null2 * theta2 / theta4, null4 / null3 * theta3 / theta4


def _hyperbolic_series(
    argument: Float[np.ndarray, "*batch"], modulus: EllipticModulus
) -> tuple[Float[np.ndarray, "*batch"], Float[np.ndarray, "*batch"], Float[np.ndarray, "*batch"]]:
    """sn, cn, dn for |u| <= K by the imaginary transformation; theta functions carry exp(-|y|)."""
    width = modulus.complementary_quarter_period
    log_nome = -math.pi * modulus.quarter_period / width
    y = np.abs(0.5 * math.pi / width * argument)
    theta1, theta2 = -0.5 * np.expm1(-2.0 * y), 0.5 * (1.0 + np.exp(-2.0 * y))
    theta3, theta4 = np.ones_like(y), np.ones_like(y)
    for n in range(1, SERIES_TERMS + 1):
        odd = 0.5 * np.exp(n * (n + 1) * log_nome + 2 * n * y)
        even = np.exp(n * n * log_nome + 2 * n * y) * (1.0 + np.exp(-4 * n * y))
        theta1 = theta1 - (-1) ** n * odd * np.expm1(-(4 * n + 2) * y)
        theta2 = theta2 + odd * (1.0 + np.exp(-(4 * n + 2) * y))
        theta3, theta4 = theta3 + even, theta4 + (-1) ** n * even
    null2, null3, null4 = _theta_constants(math.exp(log_nome))
    decay = np.exp(-y)
    sn = np.sign(argument) * null3 / null4 * theta1 / theta2
    return sn, null2 / null4 * decay * theta4 / theta2, null2 / null3 * decay * theta3 / theta2


def _theta_constants(nome: float) -> tuple[float, float, float]:
    """theta_2(0) / (2 q^(1/4)), theta_3(0) and theta_4(0)."""
    indices = range(1, SERIES_TERMS + 1)
    null2 = 1.0 + sum(nome ** (n * (n + 1)) for n in indices)
    null3 = 1.0 + 2.0 * sum(nome ** (n * n) for n in indices)
    null4 = 1.0 + 2.0 * sum((-1) ** n * nome ** (n * n) for n in indices)
    return null2, null3, null4


AXIS_NAMES: Final[tuple[str, str, str]] = ("Jxx", "Jyy", "Jzz")

TRIANGLE_TOLERANCE: Final[float] = 1e-12
"""Relative slack of the triangle inequality: a thin plate has equality, which rounding may miss."""


def validate_principal_moments(principal_moments: Float[np.ndarray, " n"]) -> Float[np.ndarray, " 3"]:
    """Principal moments of a body that can exist, as a float64 array in the order given.

    Every moment must be finite and positive, and none may exceed the sum of the other two (equality is a thin
    plate).
    Units: kg m^2, or any common multiple of it where only ratios matter.
    Raises: `ShapeError` unless the shape is (3,); `InputError` for anything that is not a rigid body, such as
    J = (3, 1, 1/3) of Figures 2-6, 2-7 and 2-9 of Tweddle (2013).
    """
    moments = positive_moments(principal_moments)
    if not are_of_rigid_body(moments):
        largest = int(np.argmax(moments))
        others = float(np.delete(moments, largest).sum())
        raise InputError(
            f"principal_moments: {AXIS_NAMES[largest]} = {moments[largest]:.6g} kg m^2 exceeds the sum "
            f"{others:.6g} of the other two, which no rigid body has (triangle inequality); "
            f"lower it to {others:.6g} or raise the others"
        )
    return moments


def positive_moments(principal_moments: Float[np.ndarray, " n"]) -> Float[np.ndarray, " 3"]:
    """Three finite, positive moments (kg m^2) as a float64 array, whether a rigid body can have them or not."""
    moments = finite_vector(principal_moments, 3, "principal_moments", "kg m^2")
    for name, moment in zip(AXIS_NAMES, moments, strict=True):
        if moment <= 0.0:
            raise InputError(
                f"principal_moments: {name} = {moment:.6g} kg m^2 is not positive; give three that are"
            )
    return moments


def are_of_rigid_body(moments: Float[np.ndarray, " 3"]) -> bool:
    """Whether no moment exceeds the sum of the other two."""
    return bool(2.0 * moments.max() <= moments.sum() + (moments.sum() - moments.max()) * TRIANGLE_TOLERANCE)


def nearest_possible_moments(moments: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
    """Moments whose largest is lowered to the sum of the other two, a thin plate's; the same of a body that can exist."""
    possible = np.array(moments, dtype=np.float64)
    largest = int(np.argmax(possible))
    possible[largest] = min(possible[largest], float(np.delete(possible, largest).sum()))
    return possible


def finite_vector(
    values: Float[np.ndarray, " n"], length: int, name: str, unit: str
) -> Float[np.ndarray, " n"]:
    """The vector as float64. Raises `ShapeError` on another length, `InputError` on NaN or infinity."""
    vector = np.array(values, dtype=np.float64)
    if vector.shape != (length,):
        raise ShapeError(f"{name} has shape {vector.shape}, expected ({length},) in {unit}")
    if not np.all(np.isfinite(vector)):
        raise InputError(
            f"{name} = {vector.tolist()} {unit} is not finite; replace NaN and infinity by numbers"
        )
    return vector


def angular_momentum(
    principal_moments: Float[np.ndarray, " 3"], rate: Float[np.ndarray, "*batch 3"]
) -> Float[np.ndarray, "*batch 3"]:
    """Angular momentum h = J w in body principal axes, kg m^2/s, of a rate in rad/s (Tweddle 2013, Eq. 2.78)."""
    return principal_moments * rate


def rotational_energy(
    principal_moments: Float[np.ndarray, " 3"], rate: Float[np.ndarray, "*batch 3"]
) -> Float[np.ndarray, "*batch"]:
    """Rotational kinetic energy w'Jw / 2, J, of a rate in principal axes, rad/s (Tweddle 2013, Eq. 2.80)."""
    return np.asarray(0.5 * np.sum(principal_moments * np.square(rate), axis=-1))


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
    """The polhode through a body rate: its kind, curves and ellipsoids.

    Parameters
    ----------
    principal_moments : Float[np.ndarray, " 3"]
        Principal moments of inertia, kg m^2, in any order.
    rate : Float[np.ndarray, " 3"]
        Body rate in principal axes, rad/s.
    points : int
        Points of each closed curve.

    Returns
    -------
    Polhode
        Curves in principal axes, rad/s.

    Raises
    ------
    InputError
        Moments of no rigid body, or a rate that is not finite.
    ShapeError
        Moments or a rate that are not of shape (3,).
    """
    return polhode_of_moments(validate_principal_moments(principal_moments), rate, points)


def polhode_of_moments(
    moments: Float[np.ndarray, " 3"], rate: Float[np.ndarray, " 3"], points: int = 361
) -> Polhode:
    """`polhode` of any three positive numbers, as Figures 2-6, 2-7 and 2-9 of Tweddle (2013) draw it for no rigid body."""
    moments = positive_moments(moments)
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
    """Semi-axes H / J and sqrt(2 E / J) of the momentum and energy ellipsoids, rad/s (Tweddle 2013, Eqs 2.79, 2.81)."""
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
    """Whether J w x w is exactly zero: the body rests, is a sphere, or spins about a principal axis."""
    pairs = ((0, 1), (1, 2), (2, 0))
    return all(
        principal_moments[i] == principal_moments[j] or rate[i] == 0.0 or rate[j] == 0.0 for i, j in pairs
    )


def polhode_shape(principal_moments: Float[np.ndarray, " 3"], rate: Float[np.ndarray, " 3"]) -> PolhodeShape:
    """Constants of a polhode that is not a point (Landau and Lifshitz, Mechanics, Eqs 37.8-37.12).

    They are computed in exact rational arithmetic and rounded once.
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
