"""Clocks that are written as dates, times of the day or durations: seconds of a text and of an array."""

import re
from datetime import UTC, datetime
from typing import Final

import numpy as np
from jaxtyping import Float

_CLOCK: Final = re.compile(
    r"(?:(\d{4})[-/](\d{1,2})[-/](\d{1,2})[T ]\s*|([+-]?\d+) days?,? [+]?)?"
    r"(\d{1,2}):(\d{2}):(\d{2})(?:[.,](\d+))?\s*(?:Z|UTC|([+-])(\d{2}(?::?\d{2})?))?",
    re.IGNORECASE,
)
"""A date or a number of days, each with a time of the day; or the latter alone."""


def seconds_of_clock(cell: str) -> float | None:
    """Seconds of a date with a time of the day, of a duration in days, or of a time of the day alone; None of any other text.

    A date counts from 1970, UTC unless it states its zone, as in 2026-11-26T12:00:00.25+01:00; a time of the day from midnight.
    """
    found = _CLOCK.fullmatch(cell.strip())
    if found is None:
        return None
    year, month, day, days, hour, minute, second, fraction, sign, zone = found.groups()
    if int(hour) > 23 or int(minute) > 59:
        return None
    whole = 86400 * int(days or 0) + 3600 * int(hour) + 60 * int(minute) + int(second)
    if zone:
        ahead = 3600 * int(zone[:2]) + 60 * int(zone[2:].lstrip(":") or 0)
        whole -= -ahead if sign == "-" else ahead
    if year is not None:
        try:
            whole += int(datetime(int(year), int(month), int(day), tzinfo=UTC).timestamp())
        except ValueError:  # a month of 13
            return None
    # one rounding, so that an array of the same instants has the same bits
    return float(whole) + float(f"0.{fraction or 0}")


def seconds_of_dates(dates: np.ndarray) -> Float[np.ndarray, " n"]:
    """Seconds of NumPy's dates and durations, the bits of `seconds_of_clock` of their texts; NaN of those that are none."""
    whole = dates.astype(f"{dates.dtype.kind}8[s]")  # rounded down, before 1970 too
    rest = (dates - whole).astype("m8[ns]").astype(np.int64)
    return np.where(np.isnat(dates), np.nan, whole.astype(np.int64).astype(np.float64) + rest / 1e9)
