"""Functions of residues obey the theorems of the real functions, values and derivatives."""

from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

from observability.exact_numbers import ORDER, PRIME, PrimeField
from observability.function_values import branch_decisions, discrete_logarithms, powers
from observability.power_series import Series
from observability.tape import tape_of

FIELD, ORDERS = PrimeField(), 5
ZERO = {
    "addition theorem of exp": lambda x, y: ca.exp(x + y) - ca.exp(x) * ca.exp(y),
    "exp of log": lambda x, y: ca.exp(ca.log(x * y)) - x * y,
    "log of exp": lambda x, y: ca.log(ca.exp(x / y)) - x / y,
    "addition of exponents": lambda x, y: x**y * x ** (1 / y) - x ** (y + 1 / y),
    "power of a product": lambda x, y: (x * y) ** 1.7 - x**1.7 * y**1.7,
    "power of a power": lambda x, y: (x**y) ** (1 / y) - x,
    "root as a power": lambda x, y: ca.sqrt(x) - ca.exp(ca.log(x) / 2),
    "half integer power": lambda x, y: x**2.5 - x * x * ca.sqrt(x),
    "whole power": lambda x, y: x**5 - x * x * x * x * x,
    "inverse power": lambda x, y: x**-3 * x**3 - 1,
    "circle": lambda x, y: ca.sin(x) ** 2 + ca.cos(x) ** 2 - 1,
    "addition theorem of sin": lambda x, y: ca.sin(x + y) - ca.sin(x) * ca.cos(y) - ca.cos(x) * ca.sin(y),
    "double angle": lambda x, y: ca.cos(2 * x) - 2 * ca.cos(x) ** 2 + 1,
    "tangent": lambda x, y: ca.tan(x) * ca.cos(x) - ca.sin(x),
    "hyperbola": lambda x, y: ca.cosh(x) ** 2 - ca.sinh(x) ** 2 - 1,
    "hyperbolic tangent": lambda x, y: ca.tanh(x) * ca.cosh(x) - ca.sinh(x),
    "hypotenuse": lambda x, y: ca.hypot(3 * x, 4 * x) - 5 * x,
    "sine of exponentials": lambda x, y: ca.sin(ca.exp(x)) ** 2 + ca.cos(ca.exp(x)) ** 2 - 1,
}
SLOPES = {
    "atan": (lambda x: ca.atan(x), lambda x: 1 / (1 + x * x)),
    "asin": (lambda x: ca.asin(x), lambda x: 1 / ca.sqrt(1 - x * x)),
    "acos": (lambda x: ca.acos(x), lambda x: -1 / ca.sqrt(1 - x * x)),
    "atan2": (lambda x: ca.atan2(x, 3), lambda x: 3 / (9 + x * x)),
    "asinh": (lambda x: ca.asinh(x), lambda x: 1 / ca.sqrt(1 + x * x)),
    "acosh": (lambda x: ca.acosh(x), lambda x: 1 / ca.sqrt(x * x - 1)),
    "atanh": (lambda x: ca.atanh(x), lambda x: 1 / (1 - x * x)),
    "log1p": (lambda x: ca.log1p(x), lambda x: 1 / (1 + x)),
    "expm1": (lambda x: ca.expm1(x), lambda x: ca.exp(x)),
    "tanh": (lambda x: ca.tanh(x), lambda x: 1 - ca.tanh(x) ** 2),
    "log": (lambda x: ca.log(x), lambda x: 1 / x),
}

POINTS = dict.fromkeys(SLOPES, 10) | {"acosh": 6, "asin": 5, "acos": 5, "asinh": 2}


def _coefficients(expression: ca.SX, x: ca.SX, point: tuple[int, ...]) -> np.ndarray:
    """Series along x + t (1, 2, ...) with tangents: (orders, 1 + n)."""
    tape, size = tape_of("the expression", [x], expression), len(point)
    numbers = tuple(Fraction(value) for value in point)
    series = Series(tape, branch_decisions(tape, [[numbers]], FIELD), FIELD, (ORDERS, 1, 1 + size))
    found = []
    for order in range(ORDERS):
        values = np.zeros((size, 1, 1 + size), dtype=np.uint64)
        if order == 0:
            values[:, 0, 0], values[:, 0, 1:] = point, np.eye(size)
        elif order == 1:
            values[:, 0, 0] = np.arange(1, size + 1)
        series.put(0, order, values)
        found.append(series.advance(order)[0, 0])
    return np.stack(found)


def _squares(seed: int) -> tuple[int, ...]:
    """Two numbers whose roots and logarithms exist modulo p."""
    return tuple(pow(int(number), 4, PRIME) for number in np.random.default_rng(seed).integers(2, PRIME, 2))


@pytest.mark.parametrize("name", ZERO)
def test_theorems_of_functions_hold_with_all_derivatives(name: str) -> None:
    x = ca.SX.sym("x", 2)
    found = _coefficients(ca.SX(ZERO[name](x[0], x[1])), x, _squares(0))
    assert not found.any()


@pytest.mark.parametrize("name", SLOPES)
def test_derivatives_of_inverse_functions_are_the_known_ones(name: str) -> None:
    function, slope = SLOPES[name]
    x, point = ca.SX.sym("x", 1), POINTS[name]
    found = _coefficients(ca.SX(function(x)), x, (point,))
    expected = _coefficients(ca.SX(slope(x)), x, (point,))
    for order in range(1, ORDERS):
        assert int(found[order, 0]) * order % PRIME == expected[order - 1, 0]
    np.testing.assert_array_equal(found[: ORDERS - 1, 1], expected[: ORDERS - 1, 0])


def test_powers_of_arrays_are_those_of_numbers() -> None:
    generator = np.random.default_rng(0)
    base, exponent = generator.integers(0, PRIME, (2, 100), dtype=np.uint64)
    expected = [pow(int(a), int(b), PRIME) for a, b in zip(base, exponent, strict=True)]
    assert powers(base, exponent, PRIME).tolist() == expected


def test_discrete_logarithms_undo_powers() -> None:
    exponents = np.random.default_rng(1).integers(0, ORDER, 5, dtype=np.uint64)
    for base in (FIELD.base, FIELD.turn_base):
        found = discrete_logarithms(powers(base, exponents, PRIME), base, FIELD)
        np.testing.assert_array_equal(found, exponents)
