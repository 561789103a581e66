"""What columns without names are, as far as their numbers show it, so that a refusal says what to state.

- The clock is the first column that rises from row to row.
- Four columns whose squares sum to 1 are a quaternion.
- Three columns are body rates if they are the derivative of the quaternion: q' = q (x) (0, w) / 2. This holds for one order of the
  quaternion alone, and for one unit.
"""

import math
import re
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.io.attitude_direction import FEWEST_ROWS, Direction, factor_of_rates, quaternion_direction
from spinfilters.io.calendar_clock import seconds_of_clock
from spinfilters.io.input_file import parse_number
from spinfilters.io.stated_values import CLOCK_UNITS, RATE_UNITS, to_state

ROWS: Final = 400
"""Rows that are looked at."""
MOST_COLUMNS: Final = 64
"""Of a table for which names are proposed."""
_ABSURD: Final = 1e100
"""Numbers that are none of a measurement, and whose squares overflow."""
_UNIT_NORM: Final = 1e-3
"""Of the squares of a quaternion, which the digits of a text cause at most."""
_OTHER_UNIT: Final = 0.1
"""Share by which a unit may differ from what the fit says."""
_PARTS: Final = ["stamp.sec", "stamp.nanosec"]
"""Names of a clock in two columns."""
_ORDERS: Final = ("xyzw", "wxyz")
RATE_NAMES: Final = {"rad/s": ("wx", "wy", "wz"), "deg/s": ("gx_dps", "gy_dps", "gz_dps")}
_MOST_PROPOSED: Final = 3
AT_REST: Final = {"m/s^2": (5.0, 15.0), "g": (0.5, 1.5)}
"""Medians of an accelerometer at rest, by its unit."""


def how_to_name(rows: Float[np.ndarray, "n m"], clock: int | None = None, unit: str = "") -> str:
    """What to state of rows without names, for a message; the general form where their numbers do not show what they are.

    Parameters
    ----------
    rows : Float[np.ndarray, 'n m']
        First rows, NaN in cells that are no numbers.
    clock : int | None
        Column that is known to be the clock.
    unit : str
        Of the clock, which its new name keeps; empty where none is known.
    """
    proposed = proposed_columns(rows, clock)
    if not proposed:
        return f"give {to_state('columns', 't,x,y,z')}, with - for those to leave out"
    own = f"t_{unit}" if unit in CLOCK_UNITS else "t"
    listed = [",".join(own if name == "t" else name for name in names) for names in proposed]
    words = f"give {to_state('columns', ' or '.join(listed))}"
    if "x" in proposed[0]:
        words += f", where x,y,z are the body rates, and {to_state('unit', 'deg/s or rad/s')}"
    elif len(proposed) > 1:
        words += ", by the place of the scalar"
    if not {"t", _PARTS[0]} & set(proposed[0]):
        words += f" with {to_state('rate', 'HZ')}"
    return words


def is_certain(proposed: Sequence[Sequence[str]]) -> bool:
    """Whether names are proposed that follow from the numbers, as those of an attitude do, and not three columns of any kind."""
    return bool(proposed) and "x" not in proposed[0]


def proved_columns(rows: Float[np.ndarray, "n m"], clock: int | None = None) -> list[str] | None:
    """Names of the columns, - for those to leave out, where rates beside a quaternion prove what both are; None of others."""
    proposed = proposed_columns(rows, clock)
    is_proved = (
        len(proposed) == 1 and is_certain(proposed) and bool({"qw", "wx", "gx_dps"} & set(proposed[0]))
    )
    is_proved = is_proved and bool({"t", _PARTS[0]} & set(proposed[0]))
    return proposed[0] if is_proved else None


def proposed_columns(rows: Float[np.ndarray, "n m"], clock: int | None = None) -> list[list[str]]:
    """Names of the columns, - for those to leave out: one list, or one for each order of a quaternion; none if nothing is found."""
    rows = np.asarray(rows, dtype=np.float64)[:ROWS]
    rows = np.where(np.abs(rows) < _ABSURD, rows, np.nan)
    if rows.ndim != 2 or len(rows) < FEWEST_ROWS or not 3 <= rows.shape[1] <= MOST_COLUMNS:
        return []
    free = [bool(np.isfinite(column).all()) for column in rows.T]
    place = next((k for k in range(rows.shape[1] - 3) if all(free[k : k + 4]) and _is_unit(rows, k)), None)
    if place is not None:
        free[place : place + 4] = [False] * 4
        if place == 3 and all(free[:3]) and clock is None:  # a position that drifts rises as a clock does
            return [
                ["px", "py", "pz", *(f"q{axis}" for axis in order), *["-"] * (len(free) - 7)]
                for order in _ORDERS
            ]
    elif (matrix := _matrix(rows, free)) is not None:
        return [matrix if clock is None else [*matrix[:clock], "t", *matrix[clock + 1 :]]]
    names, seconds = ["-"] * rows.shape[1], _parted_clock(rows, free) if clock is None else None
    clock = _clock(rows, free) if clock is None else clock
    if seconds is not None:
        names[seconds : seconds + 2], free[seconds : seconds + 2] = _PARTS, [False, False]
        rows, clock = rows.copy(), seconds
        rows[:, seconds] += 1e-9 * rows[:, seconds + 1]
    elif clock is not None:
        names[clock], free[clock] = "t", False
    else:
        free = [is_free and not _is_counter(rows[:, k]) for k, is_free in enumerate(free)]
    if place is None:
        return _with_rates(rows, free, names)
    rates = None if clock is None else _derived_rates(rows, clock, place, free)
    orders = list(_ORDERS) if rates is None else [rates[1]]
    if rates is None and clock is not None:
        of_quaternion = _directions(rows, clock, place, free)
        if {"to body", "contradiction"} & {each for _, each in of_quaternion}:
            return []  # no names can say that it maps the other way
        for column, _ in of_quaternion:  # rates in inertial axes, and no position
            free[column : column + 3] = [False] * 3
    if rates is not None:
        column, _, unit = rates
        free[column : column + 3] = [False] * 3
        # without a position it is an inertial unit, whose attitudes are made of its rates
        if place < 3 or not all(free[place - 3 : place]):
            names[column : column + 3] = RATE_NAMES[unit]
            return [names]
    if place >= 3 and all(free[place - 3 : place]):
        names[place - 3 : place] = ["px", "py", "pz"]
    elif (
        len(free) >= place + 7
        and all(free[place + 4 : place + 7])
        and np.ptp(rows[:, place + 4 : place + 7], axis=0).any()
    ):
        names[place + 4 : place + 7] = ["px", "py", "pz"]
    found = []
    for order in orders:
        names[place : place + 4] = [f"q{axis}" for axis in order]
        found.append(list(names))
    return found


def numbers_of_lines(lines: Sequence[str], delimiter: str | None) -> Float[np.ndarray, "n m"]:
    """Numbers of lines of as many cells as the first, a date in seconds, and NaN for other words; without an empty last cell."""
    if delimiter is not None and all(line.rstrip().endswith(delimiter) for line in lines[:ROWS]):
        lines = [line.rstrip().removesuffix(delimiter) for line in lines[:ROWS]]
    cells = [[cell.strip().strip('"') for cell in line.split(delimiter)] for line in lines[:ROWS]]
    return np.array([[number_of_cell(cell) for cell in row] for row in cells if len(row) == len(cells[0])])


def number_of_cell(cell: str) -> float:
    """Number of a cell, seconds of a date, NaN of a word."""
    try:
        return parse_number(cell)
    except ValueError:
        seconds = seconds_of_clock(cell)
        return math.nan if seconds is None else seconds


_SEPARATORS: Final = re.compile(r"[,;\t|]")


def first_rows(lines: Sequence[str]) -> tuple[int, str | None]:
    """Index of the first of three lines of as many cells, each with three numbers or more, and their delimiter; -1 without them."""
    shapes = [_shape(line) for line in lines]
    for k in range(len(lines) - 2):
        if shapes[k] is not None and shapes[k] == shapes[k + 1] == shapes[k + 2]:
            return k, shapes[k][1]  # pyright: ignore[reportOptionalSubscript]
    return -1, None


def _shape(line: str) -> tuple[int, str | None] | None:
    """Number of cells and delimiter of a line with at least three numbers; None of another."""
    marks = _SEPARATORS.findall(line)
    delimiter = max(dict.fromkeys(marks), key=marks.count) if marks else None
    cells = line.split(delimiter)
    numbers = sum(not math.isnan(number_of_cell(cell.strip().strip('"'))) for cell in cells)
    return (len(cells), delimiter) if numbers >= 3 else None


def _clock(rows: Float[np.ndarray, "n m"], free: Sequence[bool]) -> int | None:
    """The first column that rises, one that is no count of the rows if there is one."""
    rising = [k for k, is_free in enumerate(free) if is_free and (np.diff(rows[:, k]) > 0).all()]
    return next((k for k in rising if not _is_counter(rows[:, k])), None)


def _parted_clock(rows: Float[np.ndarray, "n m"], free: Sequence[bool]) -> int | None:
    """The first of two whole columns, seconds and the nanoseconds of each, that together rise; None without them."""
    for k in range(rows.shape[1] - 1):
        seconds, rest = rows[:, k], rows[:, k + 1]
        is_whole = (
            free[k]
            and free[k + 1]
            and bool((seconds == np.round(seconds)).all() and (rest == np.round(rest)).all())
        )
        is_rest = is_whole and bool((rest >= 0).all() and (rest < 1e9).all() and rest.max() > 1e6)
        steps = np.diff(seconds) + 1e-9 * np.diff(rest) if is_rest else np.zeros(1)
        if (
            is_rest
            and bool((np.diff(rest) < 0).any() or np.ptp(seconds) == 0)
            and bool((steps > 0).all() and (steps < 1).all())
        ):
            return k
    return None


def _is_counter(column: Float[np.ndarray, " n"]) -> bool:
    """Whether a column counts rows."""
    return bool((np.diff(column) == 1).all())


def _matrix(rows: Float[np.ndarray, "n m"], free: Sequence[bool]) -> list[str] | None:
    """Names of the columns of which twelve are [R t] row by row, R a rotation; None without such."""
    for k in range(rows.shape[1] - 11):
        if all(free[k : k + 12]):
            R = rows[:, k : k + 12].reshape(-1, 3, 4)[:, :, :3]
            if (np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)) < _UNIT_NORM).all():
                own = [f"r{i}{j}" if j < 4 else f"p{'xyz'[i - 1]}" for i in (1, 2, 3) for j in (1, 2, 3, 4)]
                return ["-"] * k + own + ["-"] * (rows.shape[1] - k - 12)
    return None


def _is_unit(rows: Float[np.ndarray, "n m"], place: int) -> bool:
    """Whether four columns are a unit quaternion, and not a constant one with a single element."""
    four = rows[:, place : place + 4]
    return bool((np.abs((four * four).sum(axis=1) - 1) < _UNIT_NORM).all()) and bool(
        np.count_nonzero(np.ptp(four, axis=0)) > 1
    )


def _derived_rates(
    rows: Float[np.ndarray, "n m"], clock: int, place: int, free: Sequence[bool]
) -> tuple[int, str, str] | None:
    """First column of the rates that are the derivative of a quaternion, the order of this, and their unit; None without any."""
    for order in _ORDERS:
        q = _in_order(rows[:, place : place + 4], order)
        for column in _triples(free):
            factor = factor_of_rates(rows[:, clock], q, rows[:, column : column + 3])
            if factor > 0 and (unit := _unit(factor)) is not None:
                return column, order, unit
    return None


def _in_order(four: Float[np.ndarray, "n 4"], order: str) -> Float[np.ndarray, "n 4"]:
    """A quaternion of columns in an order, scalar last."""
    return four if order == "xyzw" else four[:, [1, 2, 3, 0]]


def _directions(
    rows: Float[np.ndarray, "n m"], clock: int, place: int, free: Sequence[bool]
) -> list[tuple[int, Direction]]:
    """First columns of rates that belong to a quaternion in either order, with the direction that they show."""
    found: list[tuple[int, Direction]] = []
    for order in _ORDERS:
        q = _in_order(rows[:, place : place + 4], order)
        for column in _triples(free):
            shown = quaternion_direction(rows[:, clock], q, rows[:, column : column + 3])
            if shown != "unknown":
                found.append((column, shown))
    return found


def _unit(scale: float) -> str | None:
    """Unit of rates that are so many rad in a unit of the clock, of those that have names here."""
    return next(
        (
            unit
            for unit in RATE_NAMES
            for second in CLOCK_UNITS.values()
            if abs(scale / (RATE_UNITS[unit] * second) - 1) < _OTHER_UNIT
        ),
        None,
    )


def _triples(free: Sequence[bool]) -> Iterator[int]:
    """First columns of three that are free."""
    return (k for k in range(len(free) - 2) if all(free[k : k + 3]))


def _with_rates(
    rows: Float[np.ndarray, "n m"], free: Sequence[bool], names: Sequence[str]
) -> list[list[str]]:
    """Names with x, y, z for three columns: of each three that vary, those of an accelerometer at rest last."""
    varied = [is_free and float(np.ptp(rows[:, k])) > 0 for k, is_free in enumerate(free)]
    triples = _threes(free) or _threes(varied) or list(_triples(varied))[:1]
    triples = [k for k in triples if np.ptp(rows[:, k : k + 3], axis=0).any()]
    norms = {k: float(np.median(np.linalg.norm(rows[:, k : k + 3], axis=1))) for k in triples}
    triples.sort(key=lambda k: any(low < norms[k] < high for low, high in AT_REST.values()))
    return [[*names[:k], "x", "y", "z", *names[k + 3 :]] for k in triples[:_MOST_PROPOSED]]


def _threes(flags: Sequence[bool]) -> list[int]:
    """First columns of each three in the runs of flags; none if a run is of another length than three, six, nine and so on."""
    starts = [k for k in range(len(flags)) if flags[k] and (k == 0 or not flags[k - 1])]
    lengths = [_run(flags, start) for start in starts]
    if any(length % 3 for length in lengths):
        return []
    return [start + 3 * j for start, length in zip(starts, lengths, strict=True) for j in range(length // 3)]


def _run(flags: Sequence[bool], start: int) -> int:
    """Length of the run of flags that begins there."""
    return next((k for k in range(start, len(flags)) if not flags[k]), len(flags)) - start
