"""Root of a function of one number.

SciPy's `brentq` is the same method, step by step. The import of `scipy.optimize` takes a third of a second: more than all that a
comparison needs it for.
"""

from collections.abc import Callable
from math import copysign, isnan
from typing import Final

_ABSOLUTE: Final = 2e-12
_RELATIVE: Final = 8.881784197001252e-16  # four units in the last place
_MOST_STEPS: Final = 100


def root_between(function: Callable[[float], float], low: float, high: float) -> float:
    """Root of a continuous function within an interval at whose ends its signs differ (Brent 1973, chapter 4).

    Parameters
    ----------
    function : Callable[[float], float]
        Its root is sought to 2e-12 and to rounding of the root.
    low, high : float
        Ends of the interval.

    Returns
    -------
    float
        The root.

    Raises
    ------
    ArithmeticError
        The signs at both ends are equal, a value is not a number, or 100 steps are not enough.
    """
    # x is the best point, `opposite` the last one of the other sign, `before` the one before x; y are the values there.
    before, x = low, high
    y_before, y = _number(function, before), _number(function, x)
    if y_before == 0:
        return before
    if y == 0:
        return x
    if _same_sign(y_before, y):
        raise ArithmeticError(f"no two signs: {y_before:g} at {low:g} and {y:g} at {high:g}")
    opposite = y_opposite = last_step = step = 0.0
    for _ in range(_MOST_STEPS):
        if y_before != 0 and y != 0 and not _same_sign(y_before, y):
            opposite, y_opposite = before, y_before
            last_step = step = x - before
        if abs(y_opposite) < abs(y):
            before, x, opposite = x, opposite, x
            y_before, y, y_opposite = y, y_opposite, y
        tolerance = (_ABSOLUTE + _RELATIVE * abs(x)) / 2
        half = (opposite - x) / 2
        if y == 0 or abs(half) < tolerance:
            return x
        tried = half
        if abs(last_step) > tolerance and abs(y) < abs(y_before):
            if before == opposite:  # a secant
                tried = -y * (x - before) / (y - y_before)
            else:  # inverse quadratic interpolation through all three points
                to_before, to_opposite = (y_before - y) / (before - x), (y_opposite - y) / (opposite - x)
                tried = -y * (y_opposite * to_opposite - y_before * to_before)
                tried /= to_opposite * to_before * (y_opposite - y_before)
        if 2 * abs(tried) < min(abs(last_step), 3 * abs(half) - tolerance):
            last_step, step = step, tried
        else:  # bisection
            last_step = step = half
        before, y_before = x, y
        x += step if abs(step) > tolerance else copysign(tolerance, half)
        y = _number(function, x)
    raise ArithmeticError(f"no root found between {low:g} and {high:g} in {_MOST_STEPS} steps")


def _number(function: Callable[[float], float], x: float) -> float:
    """Value of a function; ArithmeticError where it is not a number."""
    value = function(x)
    if isnan(value):
        raise ArithmeticError(f"the value at {x:g} is not a number")
    return value


def _same_sign(one: float, other: float) -> bool:
    return copysign(1.0, one) == copysign(1.0, other)
