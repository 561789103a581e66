"""Expressions as text: sums of products with what they have in common before the parenthesis, such as w2*w3*(J2 - J3)/J1."""

from collections import defaultdict
from collections.abc import Mapping
from fractions import Fraction
from math import gcd, lcm
from typing import Final

import casadi as ca

from observability.exact_numbers import rational
from observability.tape import NAMES
from spinfilters.core.errors import InputError

MOST_TERMS: Final = 300
"""Terms of a sum that products with it are multiplied out to."""
LONGEST_FORMULA: Final = 20_000
"""Characters."""
LARGEST_DENOMINATOR: Final = 10**6
"""Of fractions that are written as such, not as decimals."""

Product = tuple[tuple[str, Fraction], ...]
"""Atoms (names, functions, sums in parentheses) with their exponents, in alphabetical order."""
Sum = Mapping[Product, Fraction]
"""Coefficients by products."""

NAMES_OF_FUNCTIONS: Final = {"fabs": "abs", "fmin": "min", "fmax": "max"}
ONE: Final[Product] = ()


def written(expression: ca.SX) -> str:
    """A scalar expression as a formula that a model's file may hold.

    Raises
    ------
    InputError
        Where it is longer than `LONGEST_FORMULA`.
    """
    return _sum_in_words(_multiplied_out(expression))


def _multiplied_out(expression: ca.SX) -> Sum:
    symbols = ca.symvar(expression)
    function = ca.Function("written", symbols, [ca.densify(ca.SX(expression))])
    work: dict[int, Sum] = {}
    result: Sum = {}
    for k in range(function.n_instructions()):
        operation = NAMES[function.instruction_id(k)]
        read, to = function.instruction_input(k), function.instruction_output(k)
        if operation == "output":
            result = work[read[0]]
        elif operation == "input":
            work[to[0]] = _atom(symbols[read[0]].name())
        elif operation == "const":
            work[to[0]] = _number(rational(function.instruction_constant(k)))
        else:
            work[to[0]] = _operation(operation, [work[register] for register in read])
    return result


def _operation(operation: str, operands: list[Sum]) -> Sum:
    a, b = operands[0], operands[-1]
    match operation:
        case "add":
            return _add_terms(a, b, 1)
        case "sub":
            return _add_terms(a, b, -1)
        case "neg":
            return _scale_sum(a, Fraction(-1))
        case "twice":
            return _scale_sum(a, Fraction(2))
        case "assign":
            return a
        case "mul":
            return _product(a, b)
        case "sq":
            return _product(a, a)
        case "div":
            return _product(a, _power(b, Fraction(-1)))
        case "inv":
            return _power(a, Fraction(-1))
        case "sqrt":
            return _power(a, Fraction(1, 2))
        case "pow" | "constpow" if set(b) <= {ONE}:
            return _power(a, b.get(ONE, Fraction(0)))
        case "pow" | "constpow":
            return _atom(f"({_sum_in_words(a)})**({_sum_in_words(b)})")
        case _:
            words = ", ".join(_sum_in_words(each) for each in operands)
            return _atom(f"{NAMES_OF_FUNCTIONS.get(operation, operation)}({words})")


def _number(value: Fraction) -> Sum:
    return {ONE: value} if value else {}


def _atom(name: str) -> Sum:
    if len(name) > LONGEST_FORMULA:
        raise InputError(
            f"a formula has more than {LONGEST_FORMULA} characters; ask for fewer derivatives, or a smaller model"
        )
    return {((name, Fraction(1)),): Fraction(1)}


def _add_terms(a: Sum, b: Sum, sign: int) -> Sum:
    total = defaultdict(Fraction, a)
    for product, value in b.items():
        total[product] += sign * value
    return {product: value for product, value in total.items() if value}


def _scale_sum(a: Sum, factor: Fraction) -> Sum:
    return {product: value * factor for product, value in a.items()}


def _product(a: Sum, b: Sum) -> Sum:
    if min(len(a), len(b)) > 1 and len(a) * len(b) > MOST_TERMS:
        a, b = (_in_parentheses(each) for each in (a, b))
    total: dict[Product, Fraction] = defaultdict(Fraction)
    for left, x in a.items():
        for right, y in b.items():
            powers = defaultdict(Fraction, left)
            for atom, power in right:
                powers[atom] += power
            total[tuple(sorted((atom, power) for atom, power in powers.items() if power))] += x * y
    return {product: value for product, value in total.items() if value}


def _power(a: Sum, exponent: Fraction) -> Sum:
    if exponent.denominator == 1 and 0 <= exponent <= 4:
        result: Sum = {ONE: Fraction(1)}
        for _ in range(int(exponent)):
            result = _product(result, a)
        return result
    if len(a) != 1:
        a = _in_parentheses(a)
    ((product, value),) = a.items()
    if exponent.denominator != 1 and (value != 1 or any(power != 1 for _, power in product)):
        ((product, value),) = _atom(f"({_sum_in_words(a)})").items()
    # Integer powers of a coefficient stay exact; a root is taken of atoms alone.
    size = value**exponent.numerator if exponent.denominator == 1 else Fraction(1)
    return {tuple((atom, power * exponent) for atom, power in product): size}


def _in_parentheses(a: Sum) -> Sum:
    """A sum as one atom times what its terms have in common."""
    if not a:
        return _atom("0")
    common, factor, rest = _split(a)
    inner = _plain(rest)
    return _product({common: factor}, _atom(f"({inner})"))


def _split(a: Sum) -> tuple[Product, Fraction, Sum]:
    """Atoms and coefficient that all terms have in common, the first term positive, and the rest."""
    shared = set.intersection(*[{atom for atom, _ in product} for product in a])
    powers = [dict(product) for product in a]
    common = tuple(sorted((atom, min(each[atom] for each in powers)) for atom in shared))
    negative = {atom: -power for atom, power in common}
    # Powers below 0 are taken out of all terms, so that they make one denominator.
    for each in powers:
        for atom, power in each.items():
            if power < 0 and atom not in shared:
                negative[atom] = max(negative.get(atom, Fraction(0)), -power)
    common = tuple(sorted((atom, -power) for atom, power in negative.items() if power))
    divisor = Fraction(
        gcd(*[value.numerator for value in a.values()]), lcm(*[value.denominator for value in a.values()])
    )
    rest = _product({tuple(sorted(negative.items())): 1 / divisor}, a)
    first = min(rest, key=_order)
    if rest[first] < 0 and all(value < 0 for value in rest.values()):
        divisor, rest = -divisor, _scale_sum(rest, Fraction(-1))
    return common, divisor, rest


def _order(product: Product) -> tuple[Fraction, Product]:
    return -sum((power for _, power in product), Fraction(0)), product


def _plain(a: Sum) -> str:
    """A sum term by term, a positive one first."""
    ordered = sorted(a.items(), key=lambda item: _order(item[0]))
    first = next((k for k, (_, value) in enumerate(ordered) if value > 0), 0)
    ordered.insert(0, ordered.pop(first))
    return " + ".join(_term(product, value) for product, value in ordered).replace("+ -", "- ")


def _sum_in_words(a: Sum) -> str:
    if not a:
        return "0"
    if len(a) == 1:
        ((product, value),) = a.items()
        return _term(product, value)
    common, factor, rest = _split(a)
    if not common and abs(factor) == 1:
        return _plain(a)
    words = _plain(rest)
    if len(words) > LONGEST_FORMULA:
        raise InputError(
            f"a formula has more than {LONGEST_FORMULA} characters; ask for fewer derivatives, or a smaller model"
        )
    return _term(
        tuple(sorted((*common, (f"({words})", Fraction(1))), key=lambda pair: pair[0].startswith("("))),
        factor,
    )


def _term(product: Product, value: Fraction) -> str:
    above = [_raise_power(atom, power) for atom, power in product if power > 0]
    below = [_raise_power(atom, -power) for atom, power in product if power < 0]
    size = abs(value)
    exact = size.denominator <= LARGEST_DENOMINATOR
    if size.numerator != 1 or not exact:
        above.insert(0, str(size.numerator) if exact else repr(float(size)))
    if size.denominator != 1 and exact:
        below.insert(0, str(size.denominator))
    words = "*".join(above) or "1"
    if below:
        words += f"/{below[0]}" if len(below) == 1 else f"/({'*'.join(below)})"
    return words if value > 0 else f"-{words}"


def _raise_power(atom: str, power: Fraction) -> str:
    if power == 1:
        return atom
    if power == Fraction(1, 2):
        return f"sqrt{atom}" if atom.startswith("(") else f"sqrt({atom})"
    return f"{atom}**{power}" if power.denominator == 1 else f"{atom}**({power})"
