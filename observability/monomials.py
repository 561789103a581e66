"""Monomials and polynomials of a model's symbols: their values, rates along the motion and weights, modulo a prime."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from fractions import Fraction

import numpy as np
from jaxtyping import Num

from observability.exact_numbers import PrimeField

Monomial = tuple[str, ...]
"""Factors, in the order of their names where monomials are compared."""
Polynomial = dict[Monomial, int]
"""Residues of the coefficients by factors."""
Values = Mapping[str, Num[np.ndarray, " b"]]
"""Residues of all symbols at points."""
Weights = Sequence[Mapping[str, int]]
"""Of every scaling known, by unknown, as residues."""


def monomial_value(monomial: Sequence[str], values: Values, field: PrimeField) -> Num[np.ndarray, " b"]:
    """A monomial at points."""
    result = np.ones_like(next(iter(values.values())))
    for name in monomial:
        result = field.product(result, values[name])
    return result


def polynomial_value(
    polynomial: Mapping[Monomial, int], values: Values, field: PrimeField
) -> Num[np.ndarray, " b"]:
    """A polynomial at points."""
    total = np.zeros_like(next(iter(values.values())))
    for monomial, coefficient in polynomial.items():
        size = np.array(coefficient, dtype=np.uint64)
        total = field.reduced(total + field.product(monomial_value(monomial, values, field), size))
    return total


def monomial_rate(
    monomial: Sequence[str], values: Values, rates: Values, field: PrimeField
) -> Num[np.ndarray, " b"]:
    """Derivative of a monomial along a field with these components; symbols without one stay as they are."""
    total = np.zeros_like(next(iter(values.values())))
    for k, name in enumerate(monomial):
        if name in rates:
            others = monomial_value([*monomial[:k], *monomial[k + 1 :]], values, field)
            total = field.reduced(total + field.product(others, rates[name]))
    return total


def weight(factors: Sequence[str], moved: Sequence[str], weights: Weights, prime: int) -> tuple[int, ...]:
    """Weight of a monomial less that of the unknowns that move, for every scaling."""
    return tuple(
        (sum(each.get(name, 0) for name in factors) - sum(each.get(name, 0) for name in moved)) % prime
        for each in weights
    )


def multiplied(a: Polynomial, b: Polynomial, prime: int) -> Polynomial:
    """The product of two polynomials."""
    found: Polynomial = defaultdict(int)
    for left, x in a.items():
        for right, y in b.items():
            key = tuple(sorted((*left, *right)))
            found[key] = (found[key] + x * y) % prime
    return {key: value for key, value in found.items() if value}


def product_in_words(value: Fraction, factors: Sequence[str]) -> str:
    """A coefficient times a monomial, as a formula."""
    powers = [(name, factors.count(name)) for name in dict.fromkeys(sorted(factors))]
    words = "*".join(name if power == 1 else f"{name}**{power}" for name, power in powers)
    if not words:
        return str(value)
    if abs(value) == 1:
        return words if value > 0 else f"-{words}"
    return f"{value}*{words}" if value.denominator == 1 else f"({value})*{words}"


def sum_in_words(parts: Sequence[str]) -> str:
    """A sum of formulas."""
    return " + ".join(parts).replace("+ -", "- ")
