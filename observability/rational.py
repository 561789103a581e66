"""Exact fractions, from which certificates are computed."""

from collections.abc import Iterable, Sequence
from fractions import Fraction

import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError

SIMPLE = 10**6
"""Denominators up to here are tried first, so that the float of 1/3 is read as 1/3."""

Rationals = tuple[Fraction, ...]


def rational(value: float | str | Fraction) -> Fraction:
    """The simplest fraction that rounds to this float.

    A string such as "1e-12" and a fraction are taken as they are.

    Raises
    ------
    InputError: for a number that is not finite.
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


def rationals(values: Iterable[float | str | Fraction]) -> Rationals:
    """`rational` of each."""
    return tuple(rational(value) for value in values)


def unit_quaternion(q: Sequence[float | Fraction] | Float[np.ndarray, " 4"]) -> Rationals:
    """A quaternion of exactly unit norm near q / |q|.

    Within rounding (scalar last), by stereographic projection.

    Raises
    ------
    InputError: when q is no quaternion or its norm is 0.
    """
    values = np.array([float(part) for part in q])
    norm = float(np.linalg.norm(values))
    if values.shape != (4,) or not np.isfinite(norm) or norm == 0:
        raise InputError(f"attitude {values.tolist()} is no quaternion; give four numbers that are not all 0")
    pole = int(np.argmax(np.abs(values)))
    sign = 1 if values[pole] > 0 else -1
    others = [rational(float(v)) for v in np.delete(values * sign, pole) / (norm + abs(values[pole]))]
    square = sum((v * v for v in others), Fraction(0))
    unit = [sign * 2 * v / (1 + square) for v in others]
    unit.insert(pole, sign * (1 - square) / (1 + square))
    return tuple(unit)


def as_floats(values: Sequence[Fraction]) -> Float[np.ndarray, " n"]:
    """The nearest floats."""
    return np.array([float(value) for value in values], dtype=float)
