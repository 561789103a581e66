"""Clocks that are written as dates, times of the day or durations: seconds of a text and of an array."""

import re
from datetime import UTC, datetime
from typing import Final

import numpy as np
from jaxtyping import Float

_DATE: Final = (
    r"(?P<year>\d{4})[-/.](?P<month>\d{1,2})[-/.](?P<day>\d{1,2})",
    r"(?P<year_of_days>\d{4})-(?P<day_of_year>\d{3})",
    r"(?P<first>\d{1,2})(?P<mark>[-/.])(?P<second_number>\d{1,2})(?P=mark)(?P<last_year>\d{4})",
    r"(?P<day_number>\d{1,2})[- ](?P<month_name>[A-Za-z]{3})[a-z]*[- ](?P<named_year>\d{4})",
)
_MONTHS: Final = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_CLOCK: Final = re.compile(
    rf"(?:(?:{'|'.join(_DATE)})(?:T|,? +)|(?P<days>[+-]?\d+) days?,? [+]?)?"
    r"(?P<hour>\d{1,2}):(?P<minute>\d{2}):(?P<seconds>\d{2})(?:[.,:](?P<fraction>\d+))?\s*(?P<half>[AP]M)?"
    r"(?:Z|UTC|(?P<sign>[+-])(?P<zone>\d{2}(?::?\d{2})?))?",
    re.IGNORECASE,
)
"""A date or a number of days, each with a time of the day; or the latter alone."""
_DURATION: Final = re.compile(r"([+-]?\d+(?:\.\d+)?(?:e[+-]?\d+)?) sec")
"""A duration as MATLAB writes it."""


def seconds_of_clock(cell: str) -> float | None:
    """Seconds of a date with a time of the day, of a duration in days, or of a time of the day alone; None of any other text.

    A date counts from 1970, UTC unless it states its zone, as in 2026-11-26T12:00:00.25+01:00; a time of the day from midnight.
    Dates may be written as 2026-330, 26 Nov 2026, 26.11.2026 and 11/26/2026, too; 06/01/2026 is none, because either number may be
    its month. A duration may also be written as 0.25 sec.
    """
    if duration := _DURATION.fullmatch(cell.strip()):
        return float(duration[1])
    found = _CLOCK.fullmatch(cell.strip())
    if found is None:
        return None
    hour, minute, half = int(found["hour"]), int(found["minute"]), (found["half"] or "").upper()
    if hour > 23 or minute > 59 or (half and not 1 <= hour <= 12):
        return None
    hour = hour % 12 + (12 if half == "PM" else 0) if half else hour
    whole = 86400 * int(found["days"] or 0) + 3600 * hour + 60 * minute + int(found["seconds"])
    if zone := found["zone"]:
        ahead = 3600 * int(zone[:2]) + 60 * int(zone[2:].lstrip(":") or 0)
        whole -= -ahead if found["sign"] == "-" else ahead
    try:
        whole += _midnight(found)
    except ValueError:  # a month of 13
        return None
    # one rounding, so that an array of the same instants has the same bits
    return float(whole) + float(f"0.{found['fraction'] or 0}")


def _midnight(found: re.Match[str]) -> int:
    """Seconds from 1970 to the midnight before; 0 where no date is written. ValueError: no date of the calendar."""
    if found["year"]:
        year, month, day = (int(found[name]) for name in ("year", "month", "day"))
    elif found["year_of_days"]:
        year, month, day = int(found["year_of_days"]), 1, 1
    elif found["last_year"]:
        year, month, day = (int(found[name]) for name in ("last_year", "first", "second_number"))
        if month > 12 or found["mark"] == ".":
            month, day = day, month
        elif day <= 12:
            raise ValueError
    elif found["named_year"]:
        year, day = int(found["named_year"]), int(found["day_number"])
        month = _MONTHS.index(found["month_name"].lower()) + 1
    else:
        return 0
    days = int(found["day_of_year"]) - 1 if found["day_of_year"] else 0
    if not 0 <= days < 366:
        raise ValueError
    return 86400 * days + int(datetime(year, month, day, tzinfo=UTC).timestamp())


def seconds_of_dates(dates: np.ndarray) -> Float[np.ndarray, " n"]:
    """Seconds of NumPy's dates and durations, the bits of `seconds_of_clock` of their texts; NaN of those that are none."""
    whole = dates.astype(f"{dates.dtype.kind}8[s]")  # rounded down, before 1970 too
    rest = (dates - whole).astype("m8[ns]").astype(np.int64)
    return np.where(np.isnat(dates), np.nan, whole.astype(np.int64).astype(np.float64) + rest / 1e9)
