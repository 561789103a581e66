"""Formulas of a model as text: a small grammar, read without evaluating anything as code."""

import math
import re
from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Final

import casadi as ca

from observability.exact_numbers import near_simple
from spinfilters.core.errors import InputError

LONGEST_FORMULA: Final = 20_000
"""Characters."""
DEEPEST: Final = 100
"""Parentheses and signs within one another."""
LARGEST_EXPONENT: Final = 30
"""Powers of ten in a number."""
LARGEST_VALUE: Final = 300
"""Powers of ten in the value of an unknown."""
LONGEST_NUMBER: Final = 400
"""Characters of a value."""
FUNCTIONS: Final[Mapping[str, tuple[int, Callable[..., ca.SX]]]] = {
    "exp": (1, ca.exp),
    "log": (1, ca.log),
    "sqrt": (1, ca.sqrt),
    "sin": (1, ca.sin),
    "cos": (1, ca.cos),
    "tan": (1, ca.tan),
    "asin": (1, ca.asin),
    "acos": (1, ca.acos),
    "atan": (1, ca.atan),
    "atan2": (2, ca.atan2),
    "sinh": (1, ca.sinh),
    "cosh": (1, ca.cosh),
    "tanh": (1, ca.tanh),
    "abs": (1, ca.fabs),
    "min": (2, ca.fmin),
    "max": (2, ca.fmax),
}
"""Functions of a formula with the number of their arguments."""
CONSTANTS: Final[Mapping[str, float]] = {"pi": math.pi}
"""Numbers with a name, where a model has no symbol of that name."""
LONGEST_FRACTION: Final = 4096
"""Bits of a number that is computed exactly."""
CANCELLED: Final = 2.0**-50
"""Part of the terms of a sum of irrational numbers below which it is 0."""
Value = ca.SX | Fraction | float
"""An expression, an exact constant, or a constant that is rounded."""
MISPLACED: Final[Mapping[str, str]] = {
    ",": "write numbers with a decimal point, and commas only between a function's arguments",
    ")": "leave it out, or write its '(' or what is in between",
}
"""Cure for a sign where nothing of the kind may stand."""
NAME: Final = re.compile(r"[A-Za-z_][A-Za-z_0-9]*")
_TOKEN: Final = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z_][A-Za-z_0-9]*)"
    r"|(?P<sign>\*\*|[-+*/^(),]))",
    re.ASCII,
)


def formula(text: str | float, symbols: Mapping[str, ca.SX], where: str) -> ca.SX:
    """The expression of a formula.

    Parameters
    ----------
    text : str or float
        With + - * / ** (or ^), parentheses, numbers, names, and the functions of `FUNCTIONS`.
    symbols : Mapping[str, casadi.SX]
        Expressions by name.
    where : str
        Of what, for complaints: "the equation of x1".

    Raises
    ------
    InputError
        With the place and the cure.
    """
    return _Formula(str(text), symbols, where).expression()


def exact_number(text: str | float, where: str) -> Fraction:
    """A number of a model as a fraction: "3/2", "0.25", 1e-3.

    Raises
    ------
    InputError
        For what is no number.
    """
    try:
        written = repr(text) if isinstance(text, float) else str(text).strip()
        powers = re.split("[eE]", written)[1:]
        if len(written) > LONGEST_NUMBER or any(abs(int(power)) > LARGEST_VALUE for power in powers):
            raise ValueError  # the fraction of a huge power of ten takes all memory
        return Fraction(written)
    except (ValueError, ZeroDivisionError):
        raise InputError(
            f"{where} is {str(text)[:40]!r}, which is no number; give one such as 0.5 or 3/2, of at most {LONGEST_NUMBER} "
            f"characters, between 1e-{LARGEST_VALUE} and 1e{LARGEST_VALUE}"
        ) from None


class _Formula:
    """One formula, read from left to right."""

    def __init__(self, text: str, symbols: Mapping[str, ca.SX], where: str) -> None:
        self._symbols, self._where, self._next, self._depth = symbols, where, 0, 0
        if len(text) > LONGEST_FORMULA:
            raise InputError(f"{where} has {len(text)} characters; give at most {LONGEST_FORMULA}")
        self._tokens = self._split(text)

    def expression(self) -> ca.SX:
        """The whole."""
        result = self._sum()
        if self._next < len(self._tokens):
            word = self._tokens[self._next][1]
            cure = MISPLACED.get(word, "write an operator such as * before it")
            raise self._wrong_word_error(f"{word!r} is not expected here; {cure}")
        return _expression(result)

    def _split(self, text: str) -> list[tuple[str, str]]:
        tokens, at, text = [], 0, text.rstrip()
        while at < len(text):
            match = _TOKEN.match(text, at)
            if match is None:
                raise self._wrong_word_error(
                    f"{text[at:].strip()[:1]!r} has no meaning here; use names, numbers, + - * / ** and parentheses"
                )
            kind = str(match.lastgroup)
            tokens.append((kind, match[kind]))
            at = match.end()
        return tokens

    def _peek(self) -> str:
        return self._tokens[self._next][1] if self._next < len(self._tokens) else ""

    def _take(self, *wanted: str) -> str | None:
        if self._next < len(self._tokens) and self._tokens[self._next] in [("sign", each) for each in wanted]:
            self._next += 1
            return self._tokens[self._next - 1][1]
        return None

    def _sum(self) -> Value:
        self._depth += 1
        if self._depth > DEEPEST:
            raise self._wrong_word_error(
                f"more than {DEEPEST} parentheses lie within one another; write it with fewer"
            )
        result = self._product()
        while sign := self._take("+", "-"):
            other = self._product()
            result = _sum(result, other if sign == "+" else -other)
        self._depth -= 1
        return result

    def _product(self) -> Value:
        result = self._signed()
        while sign := self._take("*", "/"):
            other = self._signed()
            if sign == "/" and _expression(other).is_zero():
                raise self._wrong_word_error("something is divided by 0; change the divisor")
            result = self._finite(
                _product(result, other) if sign == "*" else _quotient(result, other), "a product"
            )
        return result

    def _signed(self) -> Value:
        negative = False
        while sign := self._take("+", "-"):
            negative ^= sign == "-"
        result = self._power()
        return -result if negative else result

    def _power(self) -> Value:
        base = self._atom()
        if self._take("**", "^"):
            self._depth += 1
            if self._depth > DEEPEST:
                raise self._wrong_word_error(
                    f"more than {DEEPEST} powers lie within one another; write it with fewer"
                )
            exponent = self._signed()
            self._depth -= 1
            return self._finite(_power(base, exponent), "a power")
        return base

    def _atom(self) -> Value:
        if self._next >= len(self._tokens):
            raise self._wrong_word_error(
                "it ends where something is still expected; complete it, or leave out the last sign"
            )
        kind, word = self._tokens[self._next]
        self._next += 1
        if kind == "number":
            return self._number(word)
        if kind == "name":
            return self._call_function(word) if self._peek() == "(" else self._symbol(word)
        if word == "(":
            result = self._sum()
            self._close()
            return result
        cure = MISPLACED.get(word, "write a name, a number or a parenthesis before it")
        raise self._wrong_word_error(f"{word!r} is not expected here; {cure}")

    def _number(self, word: str) -> Fraction:
        _, _, exponent = word.lower().partition("e")
        if len(word) > 2 * LARGEST_EXPONENT or abs(int(exponent or 0)) > LARGEST_EXPONENT:
            raise self._wrong_word_error(
                f"the number {word[:40]} is too long; keep it between 1e-30 and 1e30"
            )
        return Fraction(word)

    def _symbol(self, word: str) -> Value:
        if word in self._symbols:
            return self._symbols[word]
        if word in CONSTANTS:
            return CONSTANTS[word]
        raise self._wrong_word_error(
            f"{word!r} is unknown; declare it among states, parameters, inputs, unknown_inputs or known_constants"
        )

    def _call_function(self, word: str) -> Value:
        if word not in FUNCTIONS:
            raise self._wrong_word_error(
                f"the function {word!r} is unknown; use one of {', '.join(FUNCTIONS)}"
            )
        count, function = FUNCTIONS[word]
        self._take("(")
        arguments = [self._sum()]
        while self._take(","):
            arguments.append(self._sum())
        self._close()
        if len(arguments) != count:
            raise self._wrong_word_error(
                f"{word} takes {count} argument{'s' if count > 1 else ''}, got {len(arguments)}"
            )
        value = self._finite(function(*[_expression(each) for each in arguments]), word)
        if any(isinstance(each, ca.SX) for each in arguments):
            return value
        number = float(value)
        if word in ("sin", "cos", "tan") and abs(number) < CANCELLED * abs(arguments[0]):
            return Fraction(0)
        return _simplest(number)

    def _finite(self, value: Value, what: str) -> Value:
        try:
            expression = _expression(value)
            finite = not expression.is_constant() or math.isfinite(float(expression))
        except OverflowError:
            finite = False
        if not finite:
            raise self._wrong_word_error(f"{what} has no finite value here; change its argument")
        return value

    def _close(self) -> None:
        if not self._take(")"):
            raise self._wrong_word_error("a parenthesis is not closed; add ')'")

    def _wrong_word_error(self, words: str) -> InputError:
        return InputError(f"{self._where}: {words}")


def _expression(value: Value) -> ca.SX:
    return value if isinstance(value, ca.SX) else ca.SX(float(value))


def _simplest(value: float) -> Fraction | float:
    """A rounded number, or the simple fraction it is nearly equal to."""
    found = near_simple(value) if math.isfinite(value) else None
    return value if found is None else found


# Expressions are put together by SX.binary, which takes a seventh of the time of Python's operators of CasADi.
def _sum(a: Value, b: Value) -> Value:
    if isinstance(a, ca.SX) or isinstance(b, ca.SX):
        return ca.SX.binary(ca.OP_ADD, _expression(a), _expression(b))
    if isinstance(a, Fraction) and isinstance(b, Fraction):
        return _short(a + b)
    total = float(a) + float(b)
    if abs(total) <= CANCELLED * max(abs(float(a)), abs(float(b))):
        return Fraction(0)
    return _simplest(total)


def _product(a: Value, b: Value) -> Value:
    if isinstance(a, ca.SX) or isinstance(b, ca.SX):
        return ca.SX.binary(ca.OP_MUL, _expression(a), _expression(b))
    if isinstance(a, Fraction) and isinstance(b, Fraction):
        return _short(a * b)
    return _simplest(float(a) * float(b))


def _quotient(a: Value, b: Value) -> Value:
    if isinstance(a, ca.SX) or isinstance(b, ca.SX):
        return ca.SX.binary(ca.OP_DIV, _expression(a), _expression(b))
    return _product(a, 1 / b)


def _power(base: Value, exponent: Value) -> Value:
    """Exact for whole exponents of numbers that stay short."""
    if isinstance(base, Fraction) and isinstance(exponent, Fraction) and exponent.denominator == 1:
        bits = max(base.numerator.bit_length(), base.denominator.bit_length())
        if bits * abs(exponent.numerator) < LONGEST_FRACTION and (base or exponent >= 0):
            return base**exponent.numerator
    value = _expression(base) ** _expression(exponent)
    return value if isinstance(base, ca.SX) or isinstance(exponent, ca.SX) else _simplest(float(value))


def _short(value: Fraction) -> Fraction | float:
    """A fraction, rounded where it is long."""
    bits = max(value.numerator.bit_length(), value.denominator.bit_length())
    return value if bits < LONGEST_FRACTION else float(value)
