"""Residues of a prime: every rational operation without rounding, so that a rank is a rank.

A number of the analysis lies in the ring that the rationals and exp of rationals generate. By Lindemann and Weierstrass the
exponentials of different rationals are linearly independent over the rationals, so that ring maps to residues by n/d -> n d^-1 and
exp(n/d) -> b^(n d^-1) for any b whose order is a prime that divides no d. A map of rings can lose rank and never adds any: a rank
found here is a lower bound of the true one, whatever the prime, and by Schwartz and Zippel equal to it with a chance of some
1 - 1e-6.
"""

from collections.abc import Sequence
from fractions import Fraction

import numpy as np
from jaxtyping import Num

from observability.arithmetic import Arithmetic, NotRegularError

PRIME = 2147483579
"""The largest prime below 2^31 for which (p - 1)/2 is prime too: products of residues fit into 64 bits."""
ORDER = (PRIME - 1) // 2
"""Order of the squares, a prime: exponents live here."""
_P = np.uint64(PRIME)


class PrimeField(Arithmetic):
    """uint64 residues below `PRIME`.

    Parameters
    ----------
    base: stands for e: any residue but -1, 0 and 1; its square generates the squares.
    """

    dtype = np.dtype(np.uint64)

    def __init__(self, base: int = 314159265) -> None:
        self._base = pow(base, 2, PRIME)

    def numbers(self, values: Sequence[Fraction]) -> Num[np.ndarray, " n"]:
        """Residues of the fractions."""
        return np.array([residue(value, PRIME) for value in values], dtype=np.uint64)

    def reduced(self, a: np.ndarray) -> np.ndarray:
        """The sum modulo p."""
        return a - (a // _P) * _P

    def negative(self, a: np.ndarray) -> np.ndarray:
        """p - a."""
        return np.where(a == 0, a, _P - a)

    def product(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """a b modulo p."""
        return self.reduced(a * b)

    def inverse(self, a: np.ndarray) -> np.ndarray:
        """1 / a modulo p; NotRegularError where a is 0."""
        if not np.all(a):
            raise NotRegularError("division by 0")
        inverses = [pow(int(number), -1, PRIME) for number in a.ravel()]
        return np.array(inverses, dtype=np.uint64).reshape(a.shape)

    def exponential(self, a: np.ndarray, exact: Sequence[Fraction]) -> np.ndarray:
        """Powers of a fixed base, which obey the same rules."""
        powers = [pow(self._base, residue(value, ORDER), PRIME) for value in exact]
        return np.array(powers, dtype=np.uint64).reshape(a.shape)

    def root(self, a: np.ndarray) -> np.ndarray:
        """Root of 1 alone; NotRegularError of other numbers."""
        if not np.all(a == 1):
            raise NotRegularError("an exact square root is taken of 1 only")
        return a

    def logarithm(self, a: np.ndarray) -> np.ndarray:
        """Logarithm of 1 alone; NotRegularError of other numbers."""
        if not np.all(a == 1):
            raise NotRegularError("an exact logarithm is taken of 1 only")
        return np.zeros_like(a)


def residue(value: Fraction, prime: int) -> int:
    """n d^-1 modulo a prime; NotRegularError when it divides d."""
    if value.denominator % prime == 0:
        raise NotRegularError(f"the denominator of {value} is a multiple of {prime}")
    return value.numerator * pow(value.denominator, -1, prime) % prime
