"""Fractions from their residues: Euclid's algorithm, and as many primes as the fractions need by the Chinese remainder theorem.

A residue modulo one prime of 31 bits is that of a fraction of at most 15 bits above and below, and nearly every residue is that of
some such fraction. A fraction is therefore believed only where it holds modulo a prime that it was not found from.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import gcd, isqrt, lcm
from typing import Generic, TypeVar

from observability.exact_numbers import NotRegularError

T = TypeVar("T")


@dataclass(frozen=True)
class Modulo(Generic[T]):
    """Residues of whatever kind, with their prime.

    Attributes
    ----------
    prime : int
        Of the field.
    residues : T
        A vector, a matrix or a field of the unknowns.
    """

    prime: int
    residues: T


def fraction_of(number: int, modulus: int) -> Fraction | None:
    """The fraction with small numerator and denominator that a residue is of, by Euclid's algorithm."""
    bound = isqrt(modulus // 2)
    above, below = (modulus, 0), (number, 1)
    while below[0] > bound:
        step = above[0] // below[0]
        above, below = below, (above[0] - step * below[0], above[1] - step * below[1])
    if not below[1] or abs(below[1]) > bound:
        return None
    return Fraction(below[0], below[1])


def fractions_that_hold(
    vectors: Iterable[Modulo[Sequence[int]]], holds: Callable[[list[Fraction]], bool]
) -> list[Fraction] | None:
    """Fractions put together of the residues of one prime after the other, until they hold; None where they never do.

    Parameters
    ----------
    vectors : Iterable[Modulo[Sequence[int]]]
        Residues of the same numbers modulo different primes.
    holds : Callable[[list[Fraction]], bool]
        The trial, modulo a prime that is not among these.
    """
    whole: list[int] = []
    modulus = 1
    for vector in vectors:
        prime, new = vector.prime, vector.residues
        if modulus == 1:
            whole = list(new)
        elif len(new) != len(whole):
            return None
        else:
            inverse = pow(modulus, -1, prime)
            whole = [
                old + modulus * ((value - old) * inverse % prime)
                for old, value in zip(whole, new, strict=True)
            ]
        modulus *= prime
        found = [fraction_of(value, modulus) for value in whole]
        fractions = [value for value in found if value is not None]
        try:
            if len(fractions) == len(found) and holds(fractions):
                return fractions
        except NotRegularError:
            continue
    return None


def coprime_integers(values: Sequence[Fraction]) -> list[Fraction]:
    """A vector scaled to coprime integers, the first of them positive."""
    scale = lcm(*[value.denominator for value in values])
    whole = [int(value * scale) for value in values]
    divisor = gcd(*whole) * (1 if whole[0] > 0 else -1)
    return [Fraction(value, divisor) for value in whole]
