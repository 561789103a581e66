"""Functions of an expression written with products, roots, exponentials, logarithms, and turns.

A turn is exp(i a), its inverse the angle of a number of modulus 1: so sines and cosines obey their theorems in residues as well.
"""

import math
from collections.abc import Callable
from fractions import Fraction
from functools import lru_cache
from itertools import product
from typing import Protocol

from observability.exact_numbers import near_simple

LONGEST_POWER = 64
"""Integer exponents up to here become products."""
ROUNDED = 8e-16
"""Relative error of a multiple of pi/12 or of a root that was computed in floats."""
HALF_COSINES = (2, 1, -1, -2, -1, 1)
"""Twice the cosines of multiples of pi/3."""
SIXTH_SINES = (0, 1, 1, 0, -1, -1)
"""Their sines over the root of 3/4."""
DIGITS = 14
"""A constant with no more of them is none that was computed."""
DEEPEST_SUM = 8
"""Levels of a sum that are searched for multiples of pi/12."""
LARGEST_SHARE = 12
"""Numerator and denominator of shares of roots in a sum of two."""
SHARES = tuple(
    sorted({Fraction(sign * n, d) for n in range(1, 7) for d in (1, 2, 3, 4, 6) for sign in (1, -1)})
)
SMALL_PRIMES = tuple(n for n in range(2, 100) if all(n % k for k in range(2, n)))
LARGEST_IN_LOGARITHM = 1000
"""Numerator and denominator of numbers whose logarithm a constant is taken for."""
LARGEST_LOGARITHM = math.log(LARGEST_IN_LOGARITHM)


class Program(Protocol):
    """What registers are written with.

    Attributes
    ----------
    roots : frozenset[int]
        Numbers of 2 and 3 that have roots in the arithmetic at hand.
    splits_logarithms : bool
        Whether logarithms of numbers are written with those of primes.
    sums_roots : bool
        Whether constants are written as sums of two roots.
    """

    roots: frozenset[int]
    splits_logarithms: bool
    sums_roots: bool

    def emit(self, operation: str, *operands: int) -> int:
        """The register of an operation."""
        ...

    def constant(self, value: Fraction) -> int:
        """The register of a constant."""
        ...

    def constant_of(self, register: int) -> Fraction | None:
        """The constant in a register, if there is one."""
        ...

    def written_as(self, register: int) -> tuple[str, int, int] | None:
        """The operation that a register was written by, with its operands."""
        ...


def _half(program: Program, register: int) -> int:
    return program.emit("mul", program.constant(Fraction(1, 2)), register)


def _exponentials_of_angle(program: Program, angle: int) -> tuple[int, int]:
    """exp(i a) and exp(-i a); a multiple of pi/12 that was added to an angle turns exactly."""
    there = _exact_turn(program, angle)
    if there is None:
        there = program.emit("cis", angle)
    return there, program.emit("inv", there)


def _exact_turn(program: Program, angle: int) -> int | None:
    """exp(i x) exp(i c) of an angle whose sum holds constants that make up such a multiple c; None of others."""
    steps, rest = _without_twelfths(program, angle)
    root = _turn_by(program, int(steps) * math.pi / 12) if steps.denominator == 1 else None
    if root is None:
        return None
    return root if rest is None else program.emit("mul", _exponentials_of_angle(program, rest)[0], root)


def _without_twelfths(program: Program, angle: int, levels: int = DEEPEST_SUM) -> tuple[Fraction, int | None]:
    """Multiples of pi/12 in the terms of a sum together, and what remains of it: None where that is nothing."""
    none = (Fraction(0), angle)
    value = program.constant_of(angle)
    if value is not None:
        steps = _twelfths(float(value))
        return (Fraction(steps), None) if steps else none
    operation, left, right = program.written_as(angle) or ("", angle, angle)
    if not levels:
        return none
    if operation in ("add", "sub"):
        (first, a), (second, b) = (_without_twelfths(program, each, levels - 1) for each in (left, right))
        if not (first or second):
            return none
        steps = first + second if operation == "add" else first - second
        if a is None or b is None:
            rest = b if operation == "add" or b is None else program.emit("neg", b)
            return steps, rest if a is None else a
        return steps, program.emit(operation, a, b)
    factor, other = _whole_multiple(program, operation, left, right)
    if not factor:
        return none
    steps, rest = _without_twelfths(program, other, levels - 1)
    if not steps:
        return none
    return steps * factor, None if rest is None else program.emit("mul", program.constant(factor), rest)


def _whole_multiple(program: Program, operation: str, left: int, right: int) -> tuple[Fraction, int]:
    """A constant factor with the other one; 0 where there is none."""
    if operation in ("neg", "twice"):
        return Fraction(-1 if operation == "neg" else 2), left
    if operation == "mul":
        for number, other in ((left, right), (right, left)):
            value = program.constant_of(number)
            if value is not None:
                return value, other
    return Fraction(0), left


def roots_of_turn(angle: float) -> frozenset[int]:
    """Numbers whose roots the cosine and sine of a multiple of pi/12 hold; none of other angles."""
    steps = _twelfths(angle)
    # pi/12 = pi/3 - pi/4: an odd number of quarters wants the root of 2, a broken number of halves that of 3.
    return frozenset({2} if steps % 2 else ()) | frozenset({3} if steps % 3 else ())


def _twelfths(angle: float) -> int:
    """Multiples of pi/12 in an angle as a float, 0 where it is none."""
    steps = round(angle * 12 / math.pi)
    return steps if math.isclose(angle, steps * math.pi / 12, rel_tol=ROUNDED, abs_tol=0) else 0


def _turn_by(program: Program, angle: float) -> int | None:
    """exp(i c) of a multiple c of pi/12 as a float, else None."""
    steps = _twelfths(angle)
    if not steps or not roots_of_turn(angle) <= program.roots:
        return None
    # k pi/12 = k pi/3 - k pi/4
    quarters, thirds = -steps % 8, steps % 6
    root = program.constant(Fraction((-1) ** (quarters // 4) * HALF_COSINES[thirds], 2))
    if SIXTH_SINES[thirds]:
        half = program.constant(Fraction((-1) ** (quarters // 4) * SIXTH_SINES[thirds], 2))
        root = _complex(program, root, program.emit("mul", half, square_root(program, 3)))
    if quarters % 2:
        half = program.emit("mul", program.constant(Fraction(1, 2)), square_root(program, 2))
        root = program.emit("mul", _complex(program, half, half), root)
    return program.emit("times_i", root) if quarters % 4 > 1 else root


def square_root(program: Program, number: int) -> int:
    """Of a whole number, as an operation of its own."""
    return program.emit("sqrt", program.constant(Fraction(number)))


def roots_of_number(value: float) -> frozenset[int]:
    """Which roots, of 2 and 3, a constant is a simple sum of; none of others."""
    parts = _sum_of_roots(value, frozenset({2, 3}), 2)
    return frozenset().union(*[_factors(number) for number in parts or () if number > 1])


def sum_of_roots(program: Program, value: float) -> int | None:
    """The register of a constant that is a simple sum of roots, such as sqrt(3)/2 or 1 + sqrt(2); None of others."""
    parts = _sum_of_roots(value, program.roots, 2 if program.sums_roots else 1)
    if parts is None:
        return None
    terms = []
    for number, share in parts.items():
        register = program.constant(share)
        for each in sorted(_factors(number)):
            register = program.emit("mul", register, square_root(program, each))
        terms.append(register)
    return terms[0] if len(terms) == 1 else program.emit("add", *terms)


@lru_cache(maxsize=256)
def _sum_of_roots(value: float, roots: frozenset[int], most: int) -> dict[int, Fraction] | None:
    """Shares of one root of 2, 3 or 6, or of two of 1 and these at most, that add up to a number but for rounding."""
    if not roots or float(f"{value:.{DIGITS}g}") == value or near_simple(value) is not None:
        return None
    known = [1, *[number for number in (2, 3, 6) if _factors(number) <= roots]]
    for number in known[1:]:
        share = near_simple(value / math.sqrt(number))
        if share is not None:
            return {number: share}
    for number, share in product(known[1:], SHARES if most > 1 else ()):
        rest = value - float(share) * math.sqrt(number)
        for other in known:
            more = Fraction(rest / math.sqrt(other)).limit_denominator(LARGEST_SHARE)
            whole = float(more) * math.sqrt(other) + float(share) * math.sqrt(number)
            if other != number and more and math.isclose(whole, value, rel_tol=ROUNDED, abs_tol=0):
                return {other: more, number: share}
    return None


def _factors(number: int) -> frozenset[int]:
    """2 and 3 of those that divide a number."""
    return frozenset(each for each in (2, 3) if number % each == 0)


def _sine(program: Program, angle: int) -> int:
    there, back = _exponentials_of_angle(program, angle)
    return _half(program, program.emit("times_i", program.emit("sub", back, there)))


def _cosine(program: Program, angle: int) -> int:
    return _half(program, program.emit("add", *_exponentials_of_angle(program, angle)))


def _tangent(program: Program, angle: int) -> int:
    there, back = _exponentials_of_angle(program, angle)
    above = program.emit("times_i", program.emit("sub", back, there))
    return program.emit("div", above, program.emit("add", there, back))


def _hyperbolic_sine(program: Program, a: int) -> int:
    power = program.emit("exp", a)
    return _half(program, program.emit("sub", power, program.emit("inv", power)))


def _hyperbolic_cosine(program: Program, a: int) -> int:
    power = program.emit("exp", a)
    return _half(program, program.emit("add", power, program.emit("inv", power)))


def _hyperbolic_tangent(program: Program, a: int) -> int:
    """(exp(2 a) - 1) / (exp(2 a) + 1)."""
    power, one = program.emit("exp", program.emit("twice", a)), program.constant(Fraction(1))
    return program.emit("div", program.emit("sub", power, one), program.emit("add", power, one))


def _complex(program: Program, real: int, imaginary: int) -> int:
    return program.emit("add", real, program.emit("times_i", imaginary))


def _other_leg(program: Program, a: int) -> int:
    """sqrt(1 - a^2)."""
    square = program.emit("sub", program.constant(Fraction(1)), program.emit("sq", a))
    return program.emit("sqrt", square)


def _arc_sine(program: Program, a: int) -> int:
    return program.emit("arg", _complex(program, _other_leg(program, a), a))


def _arc_cosine(program: Program, a: int) -> int:
    return program.emit("arg", _complex(program, a, _other_leg(program, a)))


def _angle(program: Program, y: int, x: int) -> int:
    """Half the angle of (x + i y) / (x - i y), which has modulus 1."""
    above = _complex(program, x, y)
    below = program.emit("sub", x, program.emit("times_i", y))
    return _half(program, program.emit("arg", program.emit("div", above, below)))


def _arc_tangent(program: Program, a: int) -> int:
    return _angle(program, a, program.constant(Fraction(1)))


def _area_sine(program: Program, a: int) -> int:
    root = program.emit("sqrt", program.emit("add", program.emit("sq", a), program.constant(Fraction(1))))
    return program.emit("log", program.emit("add", a, root))


def _area_cosine(program: Program, a: int) -> int:
    root = program.emit("sqrt", program.emit("sub", program.emit("sq", a), program.constant(Fraction(1))))
    return program.emit("log", program.emit("add", a, root))


def _area_tangent(program: Program, a: int) -> int:
    one = program.constant(Fraction(1))
    quotient = program.emit("div", program.emit("add", one, a), program.emit("sub", one, a))
    return _half(program, program.emit("log", quotient))


def _logarithm(program: Program, a: int) -> int:
    """The sum of logarithms of a product's factors, so that log(a) + log(b) = log(a b) holds exactly.

    The gradient is that of log(a) also where two factors are negative. A number is such a factor where logarithms of numbers are
    written with those of primes; elsewhere it stays with the other one.
    """
    operation, left, right = program.written_as(a) or ("", a, a)
    value = program.constant_of(a)
    if value is not None and value > 0 and program.splits_logarithms:
        return _logarithm_of_number(program, value)
    if operation == "exp":
        return left
    if operation in ("mul", "div") and all(_is_factor(program, each) for each in (left, right)):
        both = (_logarithm(program, left), _logarithm(program, right))
        return program.emit("add" if operation == "mul" else "sub", *both)
    if operation == "twice" and program.splits_logarithms:
        return program.emit("add", _logarithm_of_number(program, Fraction(2)), _logarithm(program, left))
    if operation == "inv":
        return program.emit("neg", _logarithm(program, left))
    if operation == "sq":
        return program.emit("twice", _logarithm(program, left))
    if operation == "sqrt":
        return _half(program, _logarithm(program, left))
    return program.emit("log", a)


def _is_factor(program: Program, register: int) -> bool:
    """Whether a factor's logarithm may be taken by itself."""
    value = program.constant_of(register)
    return value is None or (program.splits_logarithms and value > 0)


def _logarithm_of_number(program: Program, value: Fraction) -> int:
    """With logarithms of primes, and of what remains of it without small ones."""
    result = program.constant(Fraction(0))
    for sign, number in ((1, value.numerator), (-1, value.denominator)):
        for divisor in SMALL_PRIMES:
            power = 0
            while number % divisor == 0:
                number, power = number // divisor, power + 1
            result = _with_logarithm(program, result, divisor, sign * power)
        result = _with_logarithm(program, result, number, sign if number > 1 else 0)
    return result


def _with_logarithm(program: Program, sum_so_far: int, number: int, times: int) -> int:
    if not times:
        return sum_so_far
    own = program.emit("log", program.constant(Fraction(number)))
    if times != 1:
        own = program.emit("mul", program.constant(Fraction(times)), own)
    return own if program.constant_of(sum_so_far) == 0 else program.emit("add", sum_so_far, own)


def logarithm_multiple(program: Program, value: float) -> int | None:
    """The register of a constant that is the logarithm of a simple fraction, or a half or third of it; None of others."""
    if not program.splits_logarithms or abs(value) > LARGEST_LOGARITHM or near_simple(value) is not None:
        return None
    for parts in (1, 2, 3):
        number = Fraction(math.exp(parts * value)).limit_denominator(LARGEST_IN_LOGARITHM)
        if not 0 < number <= LARGEST_IN_LOGARITHM or number == 1:
            continue
        if math.isclose(parts * value, math.log(number), rel_tol=ROUNDED, abs_tol=0):
            share = program.constant(Fraction(1, parts))
            own = _logarithm_of_number(program, number)
            return own if parts == 1 else program.emit("mul", share, own)
    return None


def _logarithm_of_one_plus(program: Program, a: int) -> int:
    return _logarithm(program, program.emit("add", program.constant(Fraction(1)), a))


def _exponential_less_one(program: Program, a: int) -> int:
    return program.emit("sub", program.emit("exp", a), program.constant(Fraction(1)))


def _hypotenuse(program: Program, a: int, b: int) -> int:
    return program.emit("sqrt", program.emit("add", program.emit("sq", a), program.emit("sq", b)))


def _power(program: Program, base: int, exponent: int) -> int:
    """Products and a root where the exponent is a small half integer; else exp(exponent log(base))."""
    value = program.constant_of(exponent)
    if value is None or value.denominator > 2 or abs(value) > LONGEST_POWER:
        return program.emit("exp", program.emit("mul", exponent, _logarithm(program, base)))
    whole = abs(value.numerator) // value.denominator
    result = _whole_power(program, base, whole) if whole else None
    if value.denominator == 2:
        root = program.emit("sqrt", base)
        result = root if result is None else program.emit("mul", result, root)
    if result is None:
        return program.constant(Fraction(1))
    return program.emit("inv", result) if value < 0 else result


def _whole_power(program: Program, base: int, exponent: int) -> int:
    if exponent == 1:
        return base
    half = program.emit("sq", _whole_power(program, base, exponent // 2))
    return program.emit("mul", half, base) if exponent % 2 else half


LOWERED: dict[str, Callable[..., int]] = {
    "sin": _sine,
    "cos": _cosine,
    "tan": _tangent,
    "sinh": _hyperbolic_sine,
    "cosh": _hyperbolic_cosine,
    "log": _logarithm,
    "tanh": _hyperbolic_tangent,
    "asin": _arc_sine,
    "acos": _arc_cosine,
    "atan": _arc_tangent,
    "atan2": _angle,
    "asinh": _area_sine,
    "acosh": _area_cosine,
    "atanh": _area_tangent,
    "log1p": _logarithm_of_one_plus,
    "expm1": _exponential_less_one,
    "hypot": _hypotenuse,
    "pow": _power,
    "constpow": _power,
}
"""CasADi's functions by name, as programs of operations that have a power series here."""
