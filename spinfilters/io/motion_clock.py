"""The clock of a motion table: which column it is, in what unit, and the times of the rows, s.

A clock is known by its heading, else by its numbers. Its unit is that which the heading or the user states, else the only one in
which the table is sampled as gyros and trackers are. Counters that begin again go on.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.io.headings import SECONDS, TICKS, TIME_UNITS, is_unit_of_time, parts_of, words_of
from spinfilters.io.input_file import path_text
from spinfilters.io.motion_columns import MotionColumns
from spinfilters.io.named_columns import NamedColumns
from spinfilters.io.sensor_tables import require_clock, require_turns
from spinfilters.io.stated_values import CLOCK_UNITS, ReadingOptions, to_state
from spinfilters.io.text_table import Table
from spinfilters.io.unnamed_columns import MOST_COLUMNS

SLOWEST: Final = 1.0
FASTEST: Final = 8000.0
"""Hz: gyros and trackers whose clock has no unit sample between these."""
LARGEST_ROTATION: Final[float] = np.pi
"""Between samples in the median, rad: a gyro that is sampled more slowly determines no motion."""
LONGEST_STEP: Final[float] = 2.0
"""s: larger steps of a clock without a unit are not seconds."""
LONGEST_CLOCK_STEP: Final[float] = 3600.0
"""s: a clock that steps by more than an hour is not in seconds."""
_CALENDAR = (8e8, 4.2e9)  # s from 1970 of the years 1995 to 2100
_YEARS: Final = (1.0e9, 4.1e9)
"""Seconds from 1970 to 2001 and to 2099."""
COUNTERS: Final = ("frame", "frame#", "packetcounter")
"""Columns that count the samples, also those that are lost."""
SAMPLES: Final = "samples"
"""Unit of a counter that is the clock, because the header states the rate."""
LONGEST_DOT_TICK: Final = 8000
"""Steps of a clock of Xsens: longer ones are of 1 us, of a Dot at 120 Hz at most, shorter ones of 100 us, of a unit at 1.25 Hz at
least."""
_TURNS: Final[tuple[float, ...]] = (2.0**16, 86400.0, 2.0**32)
"""Where clocks begin again: counters of 16 and 32 bits, and the time of the day, s."""
_CLOCKS: Final = {**SECONDS, "100 us": 1e-4}
_SAME_COURSE: Final = 1e-3
"""Of a step, by which two clocks of the same samples may differ once their units and beginnings are the same."""
_FEWEST_ALIKE: Final = 20
"""Rows, in fewer of which a rate may run as a clock does."""
_CLOCK_WORD: Final = re.compile(
    r".*(?:time(?!out)|stamp|clock|epoch|elapsed|ticks).*|tow|itow|t|tt|tsec|mjd|jd|utc|gps|sec|secs|seconds|millis|micros|nanos"
)
"""Words of a clock, in any name."""
_NOT_CLOCK: Final = frozenset(
    {"delta", "dt", "diff", "period", "exposure", "rate", "step", "steps", "offset", "delay", "latency"}
)


def preferred_clocks(source: NamedColumns, columns: Sequence[int]) -> Sequence[int]:
    """Of several columns called as clocks those of dates, else only the first if all of them rise and run alike."""
    if dated := [column for column in columns if _is_date(source, column)]:
        return dated
    tables = {column: table for column in columns if (table := _clock_column(source, column)) is not None}
    rising = {k: table.values[:, 0] for k, table in tables.items() if _rises(table.values[:, 0])}
    if len(rising) < len(columns) or min(map(len, rising.values())) < _FEWEST_ALIKE:
        return columns
    courses = [(stamps - stamps[0]) / (stamps[-1] - stamps[0]) for stamps in rising.values()]
    limit = _SAME_COURSE / len(courses[0])
    are_alike = all(len(c) == len(courses[0]) and np.abs(c - courses[0]).max() < limit for c in courses)
    return columns[:1] if are_alike else columns


def _is_date(source: NamedColumns, column: int) -> bool:
    """Whether the first and last stamps of a column are of the years 1995 to 2100 in one unit."""
    try:
        table = source.read([column], keys=1)
    except InputError:
        try:
            table = source.read([column])
        except InputError:
            return False
    ends = np.abs(table.values[[0, -1], 0])
    return any(
        ((_CALENDAR[0] < ends * second) & (ends * second < _CALENDAR[1])).all()
        for second in CLOCK_UNITS.values()
    )


def clock_by_numbers(source: NamedColumns, columns: MotionColumns) -> tuple[int, str] | None:
    """Index and unit of the only column of dates, or of one that rises and has the word for a clock in its name, or no name at all.

    None where no column is such, or several are. Of those that state their unit, and of them in seconds, the first is taken.
    Without any it is the only column of instants in whole ms, us or ns.
    """
    taken = {k for vector in columns.vectors.values() for k in vector.indices}
    free = [k for k in range(min(len(source.names), MOST_COLUMNS)) if k not in taken]
    named, dated, instants = [], [], []
    for k in free:
        words, unit = words_of(source.names[k]), parts_of(source.names[k])[1]
        if unit and not is_unit_of_time(unit):
            continue
        is_named = any(map(_CLOCK_WORD.fullmatch, words)) and not _NOT_CLOCK & set(words)
        is_index = k == 0 and (not words or words[0] in ("index", "unnamed"))
        table = _clock_column(source, k)
        if table is None or not _rises(table.values[:, 0]):
            continue
        if table.is_dated:
            dated.append((k, ""))
        elif not is_named and (since_1970 := _unit_since_1970(table.values[:, 0])):
            instants.append((k, since_1970))
        elif is_named or (is_index and (table.values[:, 0] != np.round(table.values[:, 0])).any()):
            spelled = {
                TIME_UNITS[word] for word in words_of(source.names[k].replace("(", " ")) if word in TIME_UNITS
            }
            named.append((k, spelled.pop() if len(spelled) == 1 else ""))
    for found in (
        [each for each in named if each[1] == "s"],
        [each for each in named if each[1]],
        dated,
        named,
    ):
        if len(found) == 1 or (found and found[0][1]):
            return found[0]
    return instants[0] if len(instants) == 1 and not named and not dated else None


def _unit_since_1970(stamps: Float[np.ndarray, " n"]) -> str:
    """Unit in which whole stamps that always rise are instants of this century; empty of others, and of whole seconds."""
    if (stamps != np.round(stamps)).any() or (np.diff(stamps) <= 0).any():
        return ""
    for unit in ("ms", "us", "ns"):
        if _YEARS[0] < SECONDS[unit] * stamps[0] < SECONDS[unit] * stamps[-1] < _YEARS[1]:
            return unit
    return ""


def _rises(stamps: Float[np.ndarray, " n"]) -> bool:
    """Whether stamps never fall, but where a counter begins again, and do not stay."""
    steps = np.diff(_unwrapped(stamps))
    return bool((steps >= 0).all() and 2 * np.count_nonzero(steps) > len(steps))


def _clock_column(source: NamedColumns, column: int) -> Table | None:
    """A column that may be a clock; None of one with other cells than numbers or dates."""
    try:
        table = source.read([column], keys=1)
    except InputError:
        return None
    return table if len(table.values) > 2 else None


def with_counter(
    source: NamedColumns, columns: MotionColumns, options: ReadingOptions
) -> tuple[MotionColumns, ReadingOptions]:
    """Columns and options of a table whose header states its rate in place of a clock: a counter of the samples, if any, is one."""
    if source.stated_rate is None or options.rate is not None or _has_clock(source, columns):
        return columns, options
    counters = [(k, SAMPLES) for k, name in enumerate(source.names) if name.lower() in COUNTERS]
    columns = replace(columns, time=next(iter(counters), None))
    return columns, replace(options, rate=None if counters else source.stated_rate)


def _has_clock(source: NamedColumns, columns: MotionColumns) -> bool:
    """Whether a column is a clock, with numbers in it: the loggers of Xsens leave it empty where they have none."""
    if columns.time is None:
        return False
    try:
        source.read([columns.time[0]])
    except InputError:
        return False
    return True


def timed(
    table: Table,
    source: NamedColumns,
    columns: MotionColumns,
    options: ReadingOptions,
    speed: Float[np.ndarray, " n"] | None = None,
) -> tuple[Table, str]:
    """Table with time in s as its first column, and a remark on the clock's unit (just "s" for seconds).

    Parameters
    ----------
    speed : Float[np.ndarray, ' n'] | None
        rad/s at the rows, None where not known.

    Raises
    ------
    InputError
        A clock that does not rise, steps too far, or whose unit is in doubt or contradicts what is stated.
    """
    if columns.time is None:
        time, _ = clock_seconds(table, source, columns, options)
        table = replace(table, names=("time", *table.names), values=np.column_stack([time, table.values]))
        require_clock(table)
        whose = "as stated" if source.stated_rate is None else "as its header says"
        return table, f"clock of {options.rate:g} Hz {whose}"
    named = "s" if table.is_dated else columns.time[1]
    if named not in ("", TICKS, SAMPLES) and options.clock not in (None, named):
        raise InputError(
            f"{path_text(table.path)}: its clock is named in {named}, and the stated unit is {options.clock}; "
            "state none, or rename it"
        )
    time, unit = clock_seconds(table, source, columns, options, speed)
    table = replace(table, values=np.column_stack([time, table.values[:, 1:]]))
    require_clock(table)
    if unit == SAMPLES:
        return table, f"clock of {source.stated_rate:g} Hz as its header says, with its {table.names[0]}"
    if speed is not None:
        require_turns(table, speed)
    step = float(np.median(np.diff(time)))
    if step > LONGEST_CLOCK_STEP:
        raise InputError(
            f"{path_text(table.path)}: its clock steps by {step:.3g} s, so it is hardly in seconds; name its unit, such as time_ns"
        )
    return table, unit if unit == "s" else f"clock in {unit}"


def clock_seconds(
    table: Table,
    source: NamedColumns,
    columns: MotionColumns,
    options: ReadingOptions,
    speed: Float[np.ndarray, " n"] | None = None,
) -> tuple[Float[np.ndarray, " n"], str]:
    """Times of the rows, s from any origin, and the unit of the clock, which is the first column; without a clock by the rate.

    Parameters
    ----------
    speed : Float[np.ndarray, ' n'] | None
        rad/s at the rows, None where not known.

    Raises
    ------
    InputError
        As `clock_unit`.
    """
    if columns.time is None:
        return np.arange(len(table.values)) / (options.rate or 1.0), "s"
    index, unit = columns.time
    unit, stamps = "s" if table.is_dated else unit, _unwrapped(table.values[:, 0])
    if unit == SAMPLES and source.stated_rate is not None:
        return (stamps - stamps[0]) / source.stated_rate, SAMPLES
    if unit == TICKS:
        unit = options.clock or tick_of_xsens(stamps)
    unit = unit or options.clock or clock_unit(table.path, source.names[index], stamps, speed)
    return stamps * _CLOCKS[unit], unit


def clock_unit(
    path: Path, name: str, time: Float[np.ndarray, " n"], speed: Float[np.ndarray, " n"] | None
) -> str:
    """Unit of a clock that states none, by calendar date or plausible sampling.

    Parameters
    ----------
    time : Float[np.ndarray, ' n']
        Stamps.
    speed : Float[np.ndarray, ' n'] | None
        rad/s at them, None where not known.

    Raises
    ------
    InputError
        Several units or none are plausible.
    """
    step = float(np.median(np.abs(np.diff(time)))) if len(time) > 1 else 0.0
    dated = [
        unit
        for unit, second in CLOCK_UNITS.items()
        if _CALENDAR[0] < abs(float(time[0])) * second < _CALENDAR[1] and step * second <= LONGEST_CLOCK_STEP
    ]
    if dated:
        return dated[0]
    plausible = _plausible_units(time, step)
    possible = [
        u
        for u in plausible
        if speed is None or float(np.median(speed)) * step * CLOCK_UNITS[u] <= LARGEST_ROTATION
    ]
    if len(possible) == 1:
        return possible[0]
    listed = " or ".join(possible or CLOCK_UNITS)
    raise InputError(
        f"{path_text(path)}: the clock '{name[:40]}' steps by {step:.6g}, and does not say in what; give "
        f"{to_state('clock', listed)}, or name it so, such as time_ms"
    )


def _plausible_units(time: Float[np.ndarray, " n"], step: float) -> list[str]:
    """Units at which the sampling rate is plausible."""
    whole = bool((time == np.round(time)).all())
    if not step or (step < LONGEST_STEP and not whole):
        return ["s"]
    return [unit for unit, second in CLOCK_UNITS.items() if SLOWEST <= 1.0 / (step * second) <= FASTEST]


def tick_of_xsens(stamps: Float[np.ndarray, " n"]) -> str:
    """Unit of a clock of Xsens, by its steps."""
    step = float(np.median(np.abs(np.diff(stamps)))) if len(stamps) > 1 else 0.0
    return "us" if step > LONGEST_DOT_TICK else "100 us"


def _unwrapped(stamps: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Stamps of a clock that begins again, as one that goes on: those that fall by nearly a whole turn.

    A fall of more than nine tenths of a turn, which leads to a step of less than a tenth, is no disorder.
    """
    steps = np.diff(stamps)
    for turn in _TURNS:
        if (np.abs(stamps) < turn).all() and (steps < -0.9 * turn).any():
            return stamps + np.concatenate([[0.0], turn * np.cumsum(steps < -0.9 * turn)])
    return stamps
