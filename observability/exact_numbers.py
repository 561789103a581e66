"""Numbers of the analysis: exact fractions, floats, and residues of a prime, in which a rank is a rank.

A number of the analysis lies in the ring that the rationals and values of exp, log, roots and turns generate. It is mapped to
residues of a prime p = 4 q + 1 with q prime: a fraction n/d to n d^-1, exp(a) to a power of a fixed base of order q whose exponent
is a modulo q, a root to the root of order q, and exp(i a) to a power of a second base, since -1 has a root modulo p. By Lindemann
and Weierstrass exponentials of different rationals are linearly independent over the rationals, so this map has no contradiction;
with logarithms and powers together that leans on Schanuel's conjecture. A map of rings can lose rank and never adds any: a rank
found here is a lower bound of the true one, whatever the prime, and by Schwartz and Zippel equal to it with a chance of some
1 - 1e-6.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from fractions import Fraction
from functools import cache

import numpy as np
from jaxtyping import Float, Num

from spinfilters.core.errors import InputError

SIMPLE = 10**6
"""Denominators up to here are tried first, so that the float of 1/3 is read as 1/3."""
SIMPLEST = 1000
"""Denominators of fractions that a computed float is taken for, as 0.30000000000000004 for 3/10."""
FEW_ROUNDINGS = Fraction(1, 2**51)
"""Relative error of a computed float."""

Rationals = tuple[Fraction, ...]


def rational(value: float | str | Fraction) -> Fraction:
    """The simplest fraction that rounds to this float.

    A string such as "1e-12" and a fraction are taken as they are.

    Raises
    ------
    InputError
        For a number that is not finite.
    """
    if not isinstance(value, float | np.floating):
        return Fraction(value)
    if not np.isfinite(value):
        raise InputError(f"{value} cannot be analysed; give finite numbers")
    number = float(value)
    for guess in (Fraction(number).limit_denominator(SIMPLE), Fraction(repr(number))):
        if float(guess) == number:
            return guess
    return Fraction(number)


def near_simple(value: float) -> Fraction | None:
    """The fraction of small whole numbers that a computed float is equal to but for rounding, if there is one."""
    guess = Fraction(value).limit_denominator(SIMPLEST)
    return guess if guess and abs(guess - Fraction(value)) <= abs(guess) * FEW_ROUNDINGS else None


def rationals(values: Iterable[float | str | Fraction]) -> Rationals:
    """`rational` of each."""
    return tuple(rational(value) for value in values)


def unit_quaternion(q: Sequence[float | Fraction] | Float[np.ndarray, " 4"]) -> Rationals:
    """A rational quaternion (scalar last) of exactly unit norm near q / |q|, by stereographic projection.

    Raises
    ------
    InputError
        When q is no quaternion or its norm is 0.
    """
    values = np.array([float(part) for part in q])
    norm = float(np.linalg.norm(values))
    if values.shape != (4,) or not np.isfinite(norm) or norm == 0:
        raise InputError(f"attitude {values.tolist()} is no quaternion; give four numbers that are not all 0")
    pole = int(np.argmax(np.abs(values)))
    sign = 1 if values[pole] > 0 else -1
    others = [rational(float(v)) for v in np.delete(values * sign, pole) / (norm + abs(values[pole]))]
    *unit, last = (sign * value for value in unit_vector(others))
    unit.insert(pole, last)
    return tuple(unit)


def unit_vector(others: Sequence[Fraction]) -> Rationals:
    """A vector of exactly unit norm by stereographic projection: (2 u, 1 - u.u) / (1 + u.u)."""
    square = sum((v * v for v in others), Fraction(0))
    return (*[2 * v / (1 + square) for v in others], (1 - square) / (1 + square))


def as_floats(values: Sequence[Fraction]) -> Float[np.ndarray, " n"]:
    """The nearest floats."""
    return np.array([float(value) for value in values], dtype=float)


class Arithmetic(ABC):
    """Arrays of one kind of number. All operations are elementwise on any shape, and broadcast."""

    dtype: np.dtype

    @property
    def field(self) -> "PrimeField | None":
        """The field, where numbers are residues of one."""
        return None

    @abstractmethod
    def numbers(self, values: Sequence[Fraction]) -> Num[np.ndarray, " n"]:
        """These fractions as numbers."""

    def copies(self, value: Fraction, count: int) -> Num[np.ndarray, " n"]:
        """A constant as so many numbers."""
        return np.repeat(self.numbers([value]), count)

    @abstractmethod
    def reduced(self, a: np.ndarray) -> np.ndarray:
        """The canonical form of a sum of at most some thousand canonical numbers."""

    @abstractmethod
    def negative(self, a: np.ndarray) -> np.ndarray:
        """-a in canonical form."""

    def difference(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """a - b in canonical form."""
        return self.reduced(a + self.negative(b))

    @abstractmethod
    def product(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """a b in canonical form."""

    @abstractmethod
    def inverse(self, a: np.ndarray) -> np.ndarray:
        """1 / a; NotRegularError where a is 0."""

    @abstractmethod
    def exponential(self, a: np.ndarray) -> np.ndarray:
        """exp(a)."""

    @abstractmethod
    def root(self, a: np.ndarray) -> np.ndarray:
        """The positive square root.

        NotRegularError where there is no derivative or no number for it.
        """

    @abstractmethod
    def logarithm(self, a: np.ndarray) -> np.ndarray:
        """log(a); NotRegularError where there is no number for it."""

    @abstractmethod
    def times_i(self, a: np.ndarray) -> np.ndarray:
        """The imaginary unit times a; NotRegularError where there is none."""


class NotRegularError(ArithmeticError):
    """An expression that has no power series in this arithmetic at this point."""


class Reals(Arithmetic):
    """float64."""

    dtype = np.dtype(np.float64)

    def numbers(self, values: Sequence[Fraction]) -> Num[np.ndarray, " n"]:
        """Nearest floats."""
        return np.array([float(value) for value in values], dtype=np.float64)

    def reduced(self, a: np.ndarray) -> np.ndarray:
        """The same."""
        return a

    def negative(self, a: np.ndarray) -> np.ndarray:
        """-a."""
        return -a

    def product(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """a b."""
        return a * b

    def inverse(self, a: np.ndarray) -> np.ndarray:
        """1 / a; NotRegularError where a is 0."""
        if not np.all(a != 0):
            raise NotRegularError("division by 0")
        return 1 / a

    def exponential(self, a: np.ndarray) -> np.ndarray:
        """exp(a)."""
        return np.exp(a)

    def root(self, a: np.ndarray) -> np.ndarray:
        """The positive root; NotRegularError where a is not positive."""
        if not np.all(a > 0):
            raise NotRegularError("square root of a number that is not positive")
        return np.sqrt(a)

    def logarithm(self, a: np.ndarray) -> np.ndarray:
        """log(a); NotRegularError where a is not positive."""
        if not np.all(a > 0):
            raise NotRegularError("logarithm of a number that is not positive")
        return np.log(a)

    def times_i(self, a: np.ndarray) -> np.ndarray:
        """Refused: these numbers are real."""
        raise NotRegularError("sines and turns are computed in residues only")


SMALL = 1000
"""Numbers of an array whose remainders are taken at once."""
PRIME = 2147411429
"""A prime p = 4 q + 1 below 2^31 with q prime, so that products of residues fit into 64 bits; 5, 6, 7 and 11 are fourth powers."""
ORDER = (PRIME - 1) // 4
"""q, the order of the fourth powers: exponents live here."""


class PrimeField(Arithmetic):
    """uint64 residues below a prime p = 4 q + 1.

    Values of functions are found beforehand, at a point (`function_values`): here an exponential has no exponent to go by.

    Parameters
    ----------
    base : int
        Its fourth power is the image of e and generates all fourth powers.
    prime : int
        p, below 2^31.
    cofactor : int
        (p - 1) / q, 4 or a multiple of it: numbers to its power have roots and logarithms here.
    """

    dtype = np.dtype(np.uint64)

    def __init__(self, base: int = 314159265, prime: int = PRIME, cofactor: int = 4) -> None:
        self.prime, self.order = prime, (prime - 1) // cofactor
        self._p = np.uint64(prime)
        self.base = pow(base, cofactor, prime)
        self.turn_base = pow(base, cofactor * (base % 1009 + 1013), prime)
        self._imaginary = np.array(_fourth_root(prime), dtype=np.uint64)

    def draw(
        self, names: Iterable[str], count: int, random: np.random.Generator
    ) -> dict[str, Num[np.ndarray, " b"]]:
        """Random residues other than 0 by name."""
        return {name: random.integers(1, self.prime, count, dtype=np.uint64) for name in names}

    @property
    def field(self) -> "PrimeField":
        """Itself."""
        return self

    def numbers(self, values: Sequence[Fraction]) -> Num[np.ndarray, " n"]:
        """Residues of the fractions."""
        return np.array([residue(value, self.prime) for value in values], dtype=np.uint64)

    def reduced(self, a: np.ndarray) -> np.ndarray:
        """The sum modulo p."""
        # NumPy divides large arrays by a number faster than it takes remainders; small ones cost a call each.
        return a % self._p if a.size < SMALL else a - (a // self._p) * self._p

    def negative(self, a: np.ndarray) -> np.ndarray:
        """p - a."""
        return np.where(a == 0, a, self._p - a)

    def difference(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """a - b modulo p."""
        return self.reduced(a + (self._p - b))

    def product(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """a b modulo p."""
        return self.reduced(a * b)

    def inverse(self, a: np.ndarray) -> np.ndarray:
        """1 / a modulo p; NotRegularError where a is 0."""
        if not np.all(a):
            raise NotRegularError("division by 0")
        inverses = [pow(number, -1, self.prime) for number in a.ravel().tolist()]
        return np.array(inverses, dtype=np.uint64).reshape(a.shape)

    def exponential(self, a: np.ndarray) -> np.ndarray:
        """Exponential of 0 alone; NotRegularError of other numbers."""
        if not np.all(a == 0):
            raise NotRegularError("an exponential needs its exponent modulo q")
        return np.ones_like(a)

    def root(self, a: np.ndarray) -> np.ndarray:
        """Root of a fourth power, a fourth power again; NotRegularError of other numbers."""
        roots = []
        for number in a.ravel().tolist():
            if pow(number, self.order, self.prime) != 1:
                raise NotRegularError("an exact square root is taken of fourth powers only")
            roots.append(pow(number, (self.order + 1) // 2, self.prime))
        return np.array(roots, dtype=np.uint64).reshape(a.shape)

    def logarithm(self, a: np.ndarray) -> np.ndarray:
        """Logarithm of 1 alone; NotRegularError of other numbers."""
        if not np.all(a == 1):
            raise NotRegularError("an exact logarithm is taken of 1 only")
        return np.zeros_like(a)

    def times_i(self, a: np.ndarray) -> np.ndarray:
        """A root of -1 times a."""
        return self.product(a, self._imaginary)


@cache
def _fourth_root(prime: int) -> int:
    """A number of order 4."""
    return next(
        root
        for base in range(2, prime)
        if pow(root := pow(base, (prime - 1) // 4, prime), 2, prime) == prime - 1
    )


def residue(value: Fraction, prime: int) -> int:
    """n d^-1 modulo a prime; NotRegularError when it divides d."""
    if value.denominator % prime == 0:
        raise NotRegularError(f"the denominator of {value} is a multiple of {prime}")
    return value.numerator * pow(value.denominator, -1, prime) % prime
