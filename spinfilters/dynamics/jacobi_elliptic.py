"""Jacobi's elliptic functions sn, cn, dn from theta series, accurate for every parameter in [0, 1].

A parameter m near 1 is lost when only m is stored, so a modulus carries m and m1 = 1 - m separately. Series
are in the nome q for m <= 1/2 and, after Jacobi's imaginary transformation, in the complementary nome for m >
1/2: either nome is at most exp(-pi), five terms reach rounding, and m = 0 (circular) and m1 = 0 (hyperbolic
functions) need no special case.
Formulas: NIST Digital Library of Mathematical Functions, 19.8, 19.25, 20.2, 20.7.30-33, 22.2, 22.6.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.special import elliprf

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
    """Jacobi's sn, cn and dn of a real argument.

    To a few 1e-16 besides the rounding of the argument.
    """
    if modulus.parameter <= CIRCULAR_LIMIT:
        return _circular_series(argument, modulus)
    period = 2.0 * modulus.quarter_period
    turns = np.rint(argument / period)
    reduced = argument - (turns * period if math.isfinite(period) else 0.0)
    sign = np.where(turns % 2 == 0, 1.0, -1.0)
    sn, cn, dn = _hyperbolic_series(reduced, modulus)
    return sign * sn, sign * cn, dn


def argument_of(sine: float, cosine: float, modulus: EllipticModulus) -> float:
    """The u in [-K, K] with sn u = `sine`, cn u = `cosine` >= 0.

    Uses Carlson's R_F (DLMF 19.25.5).
    """
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
    """sn, cn, dn as ratios of theta functions of pi u / 2K.

    z = pi u / 2K; theta 1, 2 lack the factor 2 q^(1/4).
    """
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
