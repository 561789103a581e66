"""Numbers with their uncertainty as text."""

import math
from collections.abc import Iterable

_MOST_DECIMALS = 9


def with_uncertainty(value: float, std: float) -> str:
    """``value ± std`` to two significant digits of the standard deviation.

    Between 2 and 9 decimals; "unknown" of no number.
    """
    if not math.isfinite(value):
        return "unknown"
    decimals = 1 - math.floor(math.log10(std)) if math.isfinite(std) and std > 0 else 4
    decimals = max(2, min(decimals, _MOST_DECIMALS))
    spread = f"{std:.{decimals}f}" if math.isfinite(std) else "unknown"
    return f"{value:.{decimals}f} ± {spread}"


def numbers(values: Iterable[float], form: str) -> str:
    """Numbers side by side in one format; "unknown" where one is none."""
    listed = list(values)
    return " ".join(format(value, form) for value in listed) if all(map(math.isfinite, listed)) else "unknown"
