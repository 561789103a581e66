"""Motion tables: gyro, accelerometer and poses by the names of their columns, with the unit of their clock."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import quaternion_from_matrix
from spinfilters.core.errors import InputError
from spinfilters.io.headings import SECONDS, TICKS, TIME_UNITS, Quantity, is_unit_of_time, parts_of, words_of
from spinfilters.io.input_file import path_text, value_text
from spinfilters.io.long_table import long_columns
from spinfilters.io.measurement_log import Acceleration, MeasurementStream
from spinfilters.io.motion_columns import EXAMPLE, KNOWN_UNITS, MotionColumns, VectorColumns, motion_columns
from spinfilters.io.named_columns import NamedColumns, RenamedColumns, TextColumns, as_measured
from spinfilters.io.sensor_tables import require_clock, require_turns
from spinfilters.io.stated_values import (
    CLOCK_UNITS,
    LENGTH,
    LENGTH_UNITS,
    RATE,
    RATE_UNITS,
    ReadingOptions,
    to_state,
)
from spinfilters.io.table_layout import read_layout
from spinfilters.io.text_table import Table
from spinfilters.io.unnamed_columns import (
    CONJUGATE,
    MOST_COLUMNS,
    RATE_NAMES,
    Direction,
    how_to_name,
    is_certain,
    proposed_columns,
    proved_columns,
    quaternion_direction,
)

SLOWEST: Final = 1.0
FASTEST: Final = 8000.0
"""Hz: gyros and trackers whose clock has no unit sample between these."""
LARGEST_ROTATION: Final[float] = np.pi
"""Between samples in the median, rad: a gyro that is sampled more slowly determines no motion."""
LONGEST_STEP: Final[float] = 2.0
"""s: larger steps of a clock without a unit are not seconds."""
_CALENDAR = (8e8, 4.2e9)  # s from 1970 of the years 1995 to 2100


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
        if _CALENDAR[0] < abs(float(time[0])) * second < _CALENDAR[1]
        and step * second <= MOTION_TABLE_LONGEST_STEP
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


def _plausible_units(time: Float[np.ndarray, " n"], step: float) -> list[str]:
    """Units at which the sampling rate is plausible."""
    whole = bool((time == np.round(time)).all())
    if not step or (step < LONGEST_STEP and not whole):
        return ["s"]
    return [unit for unit, second in CLOCK_UNITS.items() if SLOWEST <= 1.0 / (step * second) <= FASTEST]


LONGEST_DOT_TICK: Final = 8000
"""Steps of a clock of Xsens: longer ones are of 1 us, of a Dot at 120 Hz at most, shorter ones of 100 us, of a unit at 1.25 Hz at
least."""
_TURNS: Final[tuple[float, ...]] = (2.0**16, 86400.0, 2.0**32)
"""Where clocks begin again: counters of 16 and 32 bits, and the time of the day, s."""
COUNTERS: Final = ("frame", "frame#", "packetcounter")
"""Columns that count the samples, also those that are lost."""
SAMPLES: Final = "samples"
"""Unit of a counter that is the clock, because the header states the rate."""
MOTION_TABLE_FASTEST: Final[float] = 75.0
FASTEST_OF_ALL: Final[float] = 400.0
"""Largest |rate| that gyros of phones and inertial units measure, about 4000 deg/s, and that any gyro does, rad/s."""
MOTION_TABLE_LONGEST_STEP: Final[float] = 3600.0
"""s: a clock that steps by more than an hour is not in seconds."""
LARGEST_FORCE: Final[float] = 1e6
"""Of an accelerometer, in any unit: one that says more is not believed."""
_AT_REST = {"m/s^2": (5.0, 15.0), "g": (0.5, 1.5)}
"""Medians of an accelerometer without a unit that show it."""


@dataclass(frozen=True)
class MotionTable:
    """Measurements of a motion table.

    Attributes
    ----------
    stream : MeasurementStream
        Of the gyro, of poses or of attitudes.
    acceleration : Acceleration | None
        Of the accelerometer, None without one.
    remarks : tuple[str, ...]
        What was understood of it that its header does not say.
    """

    stream: MeasurementStream
    acceleration: Acceleration | None
    remarks: tuple[str, ...]


def read_motion_table(path: Path, options: ReadingOptions, bare: Quantity | None = None) -> MotionTable:
    """Poses, attitudes or body rates of a text table. See `motion_of`; InputError: as `read_layout`, too."""
    options.require_only(("unit", "clock", "rate", "columns", "topic"), "a table")
    layout = read_layout(path, options.column_names)
    source: NamedColumns | None = None if options.columns is not None else long_columns(path, layout)
    source = source or TextColumns(path, layout)
    letters = re.sub(r"[^a-z]", "", path.stem.lower())
    if bare == "rate" and "angularvelocity" in letters:  # by convention in rad/s
        axes = {axis: f"angular_velocity_{axis}" for axis in "xyz"}
        source = RenamedColumns(source, tuple(axes.get(name.lower(), name) for name in source.names))
    return motion_of(source, options, bare if options.columns is None else bare or "rate")


def motion_of(source: NamedColumns, options: ReadingOptions, bare: Quantity | None = None) -> MotionTable:
    """Poses, attitudes or body rates of named columns, whichever of them comes first.

    Parameters
    ----------
    source : NamedColumns
        A text file or arrays.
    options : ReadingOptions
        What its user states.
    bare : Quantity | None
        Quantity of columns that are called x, y and z only.

    Raises
    ------
    InputError
        As `motion_columns`, `NamedColumns.read` and `require_clock`; no such columns; a unit that is in
        doubt or contradicts what is stated; numbers out of their range.
    """
    source = as_measured(source)
    columns = motion_columns(
        source.path, source.names, options, bare, lambda found: _preferred_clocks(source, found)
    )
    if columns.time is None and options.rate is None and source.stated_rate is None:
        columns = replace(columns, time=_clock_by_numbers(source, columns))
    if not {"rate", "quaternion", "matrix", "mrp"} & columns.vectors.keys() and options.columns is None:
        renamed = _proved(source, columns)
        if renamed is not None:
            return _with_remark(motion_of(renamed, options, bare))
    if source.stated_rate is not None and options.rate is None and not _has_clock(source, columns):
        counters = [(k, SAMPLES) for k, name in enumerate(source.names) if name.lower() in COUNTERS]
        columns = replace(columns, time=next(iter(counters), None))
        options = replace(options, rate=None if counters else source.stated_rate)
    quantity = _quantity(source, columns, options, bare)
    return (
        _rates(source, columns, options) if quantity == "rate" else _poses(source, columns, options, quantity)
    )


_SAME_COURSE: Final = 1e-3
"""Of a step, by which two clocks of the same samples may differ once their units and beginnings are the same."""


_FEWEST_ALIKE: Final = 20
"""Rows, in fewer of which a rate may run as a clock does."""


def _preferred_clocks(source: NamedColumns, columns: Sequence[int]) -> Sequence[int]:
    """Of several columns called as clocks those of dates, else only the first if all of them rise and run alike."""
    if dated := [column for column in columns if _is_date(source, column)]:
        return dated
    tables = {column: table for column in columns if (table := _keys(source, column)) is not None}
    rising = {k: table.values[:, 0] for k, table in tables.items() if _rises(table.values[:, 0])}
    if len(rising) < len(columns) or min(map(len, rising.values())) < _FEWEST_ALIKE:
        return columns
    courses = [(stamps - stamps[0]) / (stamps[-1] - stamps[0]) for stamps in rising.values()]
    limit = _SAME_COURSE / len(courses[0])
    are_alike = all(len(c) == len(courses[0]) and np.abs(c - courses[0]).max() < limit for c in courses)
    return columns[:1] if are_alike else columns


_CLOCK_WORD: Final = re.compile(
    r".*(?:time(?!out)|stamp|clock|epoch|elapsed|ticks).*|tow|itow|t|tt|tsec|mjd|jd|utc|gps|sec|secs|seconds|millis|micros|nanos"
)
"""Words of a clock, in any name."""
_NOT_CLOCK: Final = frozenset(
    {"delta", "dt", "diff", "period", "exposure", "rate", "step", "steps", "offset", "delay", "latency"}
)


def _clock_by_numbers(source: NamedColumns, columns: MotionColumns) -> tuple[int, str] | None:
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
        table = _keys(source, k)
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


_YEARS: Final = (1.0e9, 4.1e9)
"""Seconds from 1970 to 2001 and to 2099."""


def _unit_since_1970(stamps: Float[np.ndarray, " n"]) -> str:
    """Unit in which whole stamps that always rise are instants of this century; empty of others, and of whole seconds."""
    if (stamps != np.round(stamps)).any() or (np.diff(stamps) <= 0).any():
        return ""
    for unit in ("ms", "us", "ns"):
        if _YEARS[0] < SECONDS[unit] * stamps[0] < SECONDS[unit] * stamps[-1] < _YEARS[1]:
            return unit
    return ""


def _keys(source: NamedColumns, column: int) -> Table | None:
    """A column that may be a clock; None of one with other cells than numbers or dates."""
    try:
        table = source.read([column], keys=1)
    except InputError:
        return None
    return table if len(table.values) > 2 else None


def _rises(stamps: Float[np.ndarray, " n"]) -> bool:
    """Whether stamps never fall, but where a counter begins again, and do not stay."""
    steps = np.diff(_unwrapped(stamps))
    return bool((steps >= 0).all() and 2 * np.count_nonzero(steps) > len(steps))


def _proved(source: NamedColumns, columns: MotionColumns) -> NamedColumns | None:
    """Columns by the names that their numbers prove: rates are the derivative of the quaternion beside them, in one order only."""
    if not source.takes_names:
        return None
    clock = None if columns.time is None else columns.time[0]
    names = proved_columns(_head(source), clock)
    if names is None:
        return None
    own = "t" if clock is None else source.names[clock]
    return RenamedColumns(
        source, tuple(own if name == "t" else "" if name == "-" else name for name in names)
    )


def _head(source: NamedColumns) -> Float[np.ndarray, "n m"]:
    """First rows of a table, none of one of thousands of columns, whose names nobody states."""
    return source.head() if len(source.names) <= MOST_COLUMNS else np.empty((0, 0))


def _proved_unit(source: NamedColumns, columns: MotionColumns) -> str:
    """Unit of rates in which they are the derivative of the quaternion beside them; empty where that shows none."""
    clock = None if columns.time is None else columns.time[0]
    names = proved_columns(_head(source), clock)
    if names is None:
        return ""
    own = {names[k] for k in columns.vectors["rate"].indices}
    return next((unit for unit, called in RATE_NAMES.items() if own == set(called)), "")


def _with_remark(table: MotionTable) -> MotionTable:
    return replace(
        table,
        remarks=(
            *table.remarks,
            "columns named by their numbers: the rates are the derivative of the quaternion",
        ),
    )


def read_acceleration(path: Path, options: ReadingOptions) -> Acceleration | None:
    """Accelerometer of a table of its own.

    Its columns may be called x, y and z. InputError: as `read_motion_table`.
    """
    source = TextColumns(path, read_layout(path))
    columns = motion_columns(path, source.names, replace(options, rate=None), "acceleration")
    return _acceleration(source, columns, options)


def _rates(source: NamedColumns, columns: MotionColumns, options: ReadingOptions) -> MotionTable:
    vector, remarks = columns.vectors["rate"], []
    table = _read_quantities(source, columns, ("rate",))
    by_logger = _unit_of_logger(source.names, table)
    if not (vector.unit or options.unit or by_logger):
        by_logger = _proved_unit(source, columns)
    unit = _rate_unit(table, vector, options, by_logger)
    if {"quaternion", "matrix", "mrp"} & columns.vectors.keys():
        remarks.append("attitudes left out: an inertial unit makes them of its rates")
    _require_measurable(table, unit, bool(vector.unit) or options.unit is not None)
    values = table.values.copy()
    values[:, -3:] *= RATE_UNITS[unit]
    table, speed = replace(table, values=values), np.linalg.norm(values[:, -3:], axis=1)
    table, clock = _timed(table, columns, options, source, speed)
    table.require(slice(1, 4), RATE)
    if table.incomplete:
        remarks.append(f"{table.incomplete} rows without rates left out")
    if clock != "s":
        remarks.append(clock)
    if not (vector.unit or options.unit or vector.is_si or by_logger):
        remarks.append(f"rates in {unit}, because no gyro measures as many rad/s")
    with table.naming_lines():
        stream = MeasurementStream("gyro", table.values[:, 0], table.values[:, 1:])
    return MotionTable(stream, _acceleration(source, columns, options), tuple(remarks))


def _require_measurable(table: Table, unit: str, is_stated: bool) -> None:
    """Require rates that a gyro measures.

    InputError: one that is faster, with its cell; degrees are no cure of what is too fast in degrees, too.
    """
    rates, fastest = table.values[:, -3:], FASTEST_OF_ALL if is_stated else MOTION_TABLE_FASTEST
    scale = max(float(np.abs(rates).max()), 1.0)  # squares of absurd numbers are none
    row = int(np.linalg.norm(rates / scale, axis=1).argmax())
    speed = math.hypot(*rates[row]) * RATE_UNITS[unit]
    if speed <= fastest:
        return
    column = int(np.abs(rates[row]).argmax()) - 3
    if speed * RATE_UNITS["deg/s"] > FASTEST_OF_ALL:
        cure = "correct or delete the line"
    elif is_stated:
        cure = "correct the unit, or the line"
    else:
        cure = (
            f"give {to_state('unit', 'deg/s')}, or another unit, name it ('wx (deg/s)'), or correct the line"
        )
    value, name = float(table.values[row, column]), value_text(table.names[column])
    raise table.error(
        row,
        f"a rate of {speed:.4g} rad/s is more than a gyro measures ({name} is {value:.6g} {unit}); {cure}",
    )


_UNITS_OF_LOGGERS: Final = (
    (frozenset({"rtcTime", "output_Hz"}), "deg/s"),  # OpenLog Artemis
    (frozenset({"gyro_uncalib_x", "game_rv[0]"}), "rad/s"),  # RoNIN, as Android's
    (frozenset({"HeadBandOn", "Elements"}), "deg/s"),  # Mind Monitor
    (frozenset({"Unix Time", "Microseconds", "IMU Temperature"}), "rad/s"),  # Advanced Navigation
    (frozenset({"rotationRate.x", "userAcceleration.x"}), "rad/s"),  # Core Motion of iOS
)
"""Columns that only one logger has, and the unit of its rates."""


def _unit_of_logger(names: Sequence[str], table: Table) -> str:
    """Unit of body rates that a logger is known to write, by columns that only it has; empty of others."""
    is_android = "accuracy" in names and table.names[-3:] == ("x", "y", "z")
    if "seconds_elapsed" in names or is_android:
        return "rad/s"
    for own, unit in _UNITS_OF_LOGGERS:
        if own <= set(names):
            return unit
    if {"PacketCounter", "SampleTimeFine"} <= set(names):
        return "deg/s" if table.values.shape[1] > 3 and _tick(table.values[:, 0]) == "us" else "rad/s"
    return ""


def _poses(
    source: NamedColumns, columns: MotionColumns, options: ReadingOptions, rotation: Quantity
) -> MotionTable:
    """Poses, or attitudes where no position is there.

    Rates in the same table are taken as derived and left out.
    """
    has_position = "position" in columns.vectors
    if not has_position:
        options.require_only(("clock", "rate", "columns", "topic"), "a table of attitudes")
    table = _read_quantities(source, columns, ("position", rotation) if has_position else (rotation,))
    if rotation == "matrix":
        table = _with_quaternions(table)
    elif rotation == "mrp":
        table = _with_quaternions_of_mrp(table)
    direction = _shown_direction(source, columns, rotation)
    if direction == "contradiction":
        raise InputError(
            f"{path_text(source.path)}: its rates are minus the derivative of its attitude, so one of them is in other axes; "
            f"correct it, or leave the rates out: {to_state('columns', _names_without_rates(source, columns))}"
        )
    if direction == "to body":
        table = replace(
            table, values=np.column_stack([table.values[:, :-4], table.values[:, -4:] * CONJUGATE])
        )
    table, clock = _timed(table, columns, options, source, None)
    if has_position:
        values = table.values.copy()
        values[:, 1:4] *= LENGTH_UNITS[_length_unit(table, columns.vectors["position"], options)]
        table = replace(table, values=values)
        table.require(slice(1, 4), LENGTH)
    with table.naming_lines():
        stream = MeasurementStream(
            "pose" if has_position else "attitude", table.values[:, 0], table.values[:, 1:]
        )
    remarks = () if clock == "s" else (clock,)
    turned = ("its attitude maps from inertial to body axes, as the rates beside it show: turned round",)
    return MotionTable(stream, None, (*remarks, *(turned if direction == "to body" else ())))


def _names_without_rates(source: NamedColumns, columns: MotionColumns) -> str:
    """Names of the columns that are read, with - for all others, as the user may state them."""
    kept = {k for quantity, vector in columns.vectors.items() if quantity != "rate" for k in vector.indices}
    kept |= set() if columns.time is None else {columns.time[0]}
    kept |= set() if columns.fraction is None else {columns.fraction[0]}
    return ",".join(name if k in kept else "-" for k, name in enumerate(source.names))


def _shown_direction(source: NamedColumns, columns: MotionColumns, rotation: Quantity) -> Direction:
    """Direction of the rotation of a table that the rates beside it show; unknown without rates."""
    found = columns.vectors
    if "rate" not in found or columns.time is None or not (rows := _head(source)).size:
        return "unknown"
    time = rows[:, columns.time[0]]
    if columns.fraction is not None:
        place, unit = columns.fraction
        time = time + unit * rows[:, place]
    turned = rows[:, list(found[rotation].indices)]
    if not np.isfinite(turned).all():
        return "unknown"
    if rotation == "matrix":
        turned = quaternion_from_matrix(turned.reshape(-1, 3, 3))
    elif rotation == "mrp":
        turned = _quaternions_of_mrp(turned)
    return quaternion_direction(time, turned, rows[:, list(found["rate"].indices)])


def _with_quaternions(table: Table) -> Table:
    """A table whose last nine columns, a rotation matrix R_ib row by row, are a quaternion. InputError: see `rotations_of`."""
    R = rotations_of(table, table.values[:, -9:].reshape(-1, 3, 3))
    names = (*table.names[:-9], "qx", "qy", "qz", "qw")
    return replace(
        table, names=names, values=np.column_stack([table.values[:, :-9], quaternion_from_matrix(R)])
    )


def _quaternions_of_mrp(s: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 4"]:
    """Quaternions, scalar last, of modified Rodrigues parameters."""
    square = np.sum(s * s, axis=1, keepdims=True)
    return np.hstack([2.0 * s, 1.0 - square]) / (1.0 + square)


def _with_quaternions_of_mrp(table: Table) -> Table:
    """A table whose last three columns, modified Rodrigues parameters s of q_ib, are a quaternion: (2 s, 1 - s s) / (1 + s s)."""
    q = _quaternions_of_mrp(table.values[:, -3:])
    names = (*table.names[:-3], "qx", "qy", "qz", "qw")
    return replace(table, names=names, values=np.column_stack([table.values[:, :-3], q]))


ROTATION_ERROR: Final = 1e-3
"""Of an element of R R', which the digits of a text cause at most."""


def rotations_of(table: Table, R: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "n 3 3"]:
    """Rotations nearest to the matrices of a table, which have only the digits of a text: U V' of R = U S V'.

    InputError: a matrix that is none, R R' = 1 and det R = 1 to `ROTATION_ERROR`, with its line.
    """
    away = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    wrong = np.flatnonzero(~(away <= ROTATION_ERROR) | (np.linalg.det(R) < 0))
    if wrong.size:
        raise table.error(int(wrong[0]), "its matrix is no rotation; correct or delete the line")
    U, _, Vt = np.linalg.svd(R)
    return U @ Vt


def _read_quantities(source: NamedColumns, columns: MotionColumns, quantities: tuple[Quantity, ...]) -> Table:
    """Clock, where there is one, and quantities."""
    chosen = [k for quantity in quantities for k in columns.vectors[quantity].indices]
    clock = [] if columns.time is None else [columns.time[0]]
    if columns.fraction is None or columns.time is None:
        return source.read([*clock, *chosen], keys=len(clock))
    place, unit = columns.fraction
    table = source.read([*clock, place, *chosen], keys=2)
    seconds, rest = table.values[:, 0], unit * table.values[:, 1]
    if (
        (seconds == np.floor(seconds)).all()
        and ((rest >= 0) & (rest < 1)).all()
        and (np.diff(seconds) <= 1).all()
    ):
        seconds = seconds + rest
    return replace(
        table,
        names=(table.names[0], *table.names[2:]),
        values=np.column_stack([seconds, table.values[:, 2:]]),
    )


def _rate_unit(table: Table, vector: VectorColumns, options: ReadingOptions, by_logger: str) -> str:
    """Unit of body rates, from the header, the user, or the convention of the name or logger.

    Raises
    ------
    InputError
        No unit, or two that differ.
    """
    if vector.unit and options.unit not in (None, vector.unit):
        raise InputError(
            f"{path_text(table.path)}: its header says {vector.unit}, and the stated unit is {options.unit}; "
            "state none, or correct the header"
        )
    if options.unit in LENGTH_UNITS:
        raise InputError(
            f"{path_text(table.path)}: holds body rates, and the stated unit is {options.unit}; give one of {', '.join(RATE_UNITS)}"
        )
    unit = (
        vector.unit or options.unit or by_logger or ("rad/s" if vector.is_si else _only_plausible_unit(table))
    )
    if not unit:
        largest = float(np.abs(table.values[:, -3:]).max())
        raise InputError(
            f"{path_text(table.path)}: columns {value_text(', '.join(table.names[-3:]))} do not say their unit "
            f"(largest {largest:.4g}); give {to_state('unit', 'deg/s or rad/s')}, or name them so (gyro_x_dps)"
        )
    return unit


_OF_COUNTS: Final = re.compile(r"adc|raw|count|lsb", re.IGNORECASE)


def _only_plausible_unit(table: Table) -> str:
    """Degrees, of rates that are too fast for a gyro in rad/s and not in deg/s; empty of others, of counts and of spikes."""
    rates = table.values[:, -3:]
    largest = float(np.abs(rates).max())
    is_count = bool((rates == np.round(rates)).all()) or any(
        _OF_COUNTS.search(name) for name in table.names[-3:]
    )
    if is_count or largest >= MOTION_TABLE_FASTEST / RATE_UNITS["deg/s"]:
        return ""
    fast = np.flatnonzero((np.abs(rates) > MOTION_TABLE_FASTEST).any(axis=1))
    # what turns fast does so for more than a sample; an outlier does not
    lasting = np.count_nonzero(np.diff(fast) == 1)
    return "deg/s" if lasting >= max(3, len(fast) / 2) else ""


def _length_unit(table: Table, vector: VectorColumns, options: ReadingOptions) -> str:
    """Unit of positions, from the header or the user, else m. InputError: two that differ, or one of rates."""
    if options.unit in RATE_UNITS:
        raise InputError(
            f"{path_text(table.path)}: the unit {options.unit} does not apply to a table of poses; leave it out, or give one of "
            f"{', '.join(LENGTH_UNITS)}"
        )
    if vector.unit and options.unit not in (None, vector.unit):
        raise InputError(
            f"{path_text(table.path)}: its header says {vector.unit}, and the stated unit is {options.unit}; "
            "state none, or correct the header"
        )
    return vector.unit or options.unit or "m"


def _timed(
    table: Table,
    columns: MotionColumns,
    options: ReadingOptions,
    source: NamedColumns,
    speed: Float[np.ndarray, " n"] | None,
) -> tuple[Table, str]:
    """Table with time in s as its first column, and a remark on the clock's unit (just "s" for seconds)."""
    if columns.time is None:
        time = np.arange(len(table.values)) / (options.rate or 1.0)
        table = replace(table, names=("time", *table.names), values=np.column_stack([time, table.values]))
        require_clock(table)
        whose = "as stated" if source.stated_rate is None else "as its header says"
        return table, f"clock of {options.rate:g} Hz {whose}"
    index, stated = columns.time
    stated = "s" if table.is_dated else stated
    if stated == SAMPLES and source.stated_rate is not None:
        counts = _unwrapped(table.values[:, 0])
        time = (counts - counts[0]) / source.stated_rate
        table = replace(table, values=np.column_stack([time, table.values[:, 1:]]))
        require_clock(table)
        return table, f"clock of {source.stated_rate:g} Hz as its header says, with its {table.names[0]}"
    if stated == TICKS:
        stated = options.clock or _tick(table.values[:, 0])
    if stated and options.clock not in (None, stated):
        raise InputError(
            f"{path_text(table.path)}: its clock is named in {stated}, and the stated unit is {options.clock}; "
            "state none, or rename it"
        )
    stamps = _unwrapped(table.values[:, 0])
    unit = stated or options.clock or clock_unit(table.path, source.names[index], stamps, speed)
    table = replace(table, values=np.column_stack([stamps * _CLOCKS[unit], table.values[:, 1:]]))
    require_clock(table)
    if speed is not None:
        require_turns(table, speed)
    step = float(np.median(np.diff(table.values[:, 0])))
    if step > MOTION_TABLE_LONGEST_STEP:
        raise InputError(
            f"{path_text(table.path)}: its clock steps by {step:.3g} s, so it is hardly in seconds; name its unit, such as time_ns"
        )
    return table, unit if unit == "s" else f"clock in {unit}"


_CLOCKS: Final = {**SECONDS, "100 us": 1e-4}


def _tick(stamps: Float[np.ndarray, " n"]) -> str:
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


def _has_clock(source: NamedColumns, columns: MotionColumns) -> bool:
    """Whether a column is a clock, with numbers in it: the loggers of Xsens leave it empty where they have none."""
    if columns.time is None:
        return False
    try:
        source.read([columns.time[0]])
    except InputError:
        return False
    return True


def _acceleration(
    source: NamedColumns, columns: MotionColumns, options: ReadingOptions
) -> Acceleration | None:
    """Accelerometer of a table; None without one, or where its unit is in doubt."""
    if "acceleration" not in columns.vectors:
        return None
    table = _read_quantities(source, columns, ("acceleration",))
    force, spelled = table.values[:, -3:], columns.vectors["acceleration"].unit
    if np.abs(force).max() > LARGEST_FORCE:
        return None
    middle = float(np.median(np.linalg.norm(force, axis=1)))
    spelled = spelled or next((u for u, (low, high) in _AT_REST.items() if low < middle < high), "")
    time = _acceleration_times(table, columns, options, source.stated_rate)
    if not spelled or len(time) < 2 or (np.diff(time) <= 0).any():
        return None
    return Acceleration(time, force * KNOWN_UNITS["acceleration"][spelled])


def _acceleration_times(
    table: Table, columns: MotionColumns, options: ReadingOptions, stated_rate: float | None
) -> Float[np.ndarray, " n"]:
    """Times of an accelerometer's samples, s.

    They are of their clock, or of the rate that is stated, if no row is left out.
    """
    if columns.time is None:
        return np.arange(0 if table.incomplete else len(table.values)) / (options.rate or 1.0)
    stamps, stated = _unwrapped(table.values[:, 0]), "s" if table.is_dated else columns.time[1]
    if stated == SAMPLES and stated_rate is not None:
        return (stamps - stamps[0]) / stated_rate
    stated = _tick(stamps) if stated == TICKS and options.clock is None else stated.replace(TICKS, "")
    unit = stated or options.clock or clock_unit(table.path, table.names[0], stamps, None)
    return stamps * _CLOCKS[unit]


def _quantity(
    source: NamedColumns, columns: MotionColumns, options: ReadingOptions, bare: Quantity | None
) -> Quantity:
    """The quantity read of a table: rates, or the kind of rotation.

    Attitudes beside rates and accelerations are those that an inertial unit makes of them: the rates are read then, unless the user
    asks for attitudes. InputError where the table does not describe a motion or its clock.
    """
    found, path, names = columns.vectors, source.path, source.names
    if columns.time is None and options.rate is None:
        raise InputError(
            f"{path_text(path)}: header {value_text(', '.join(names))}: no column is a clock; name it time_s, or give "
            f"{to_state('rate', 'HZ')}{_or_names(source, columns, options)}"
        )
    is_unit = {"rate", "acceleration"} <= found.keys() and "position" not in found
    if "quaternion" in found and (not is_unit or bare == "quaternion"):
        return "quaternion"
    if "matrix" in found and ("position" in found or "rate" not in found):
        return "matrix"
    if "mrp" in found and "rate" not in found:
        return "mrp"
    if "rate" in found:
        return "rate"
    if "position" in found:
        raise InputError(
            f"{path_text(path)}: header {value_text(', '.join(names))}: has positions without a quaternion; name its columns "
            f"qx,qy,qz,qw, or export quaternions, because three angles do not show their order{_or_names(source, columns, options)}"
        )
    raise InputError(
        f"{path_text(path)}: header {value_text(', '.join(names))}: contains no body rate about each of x, y, z; name the columns "
        f"such as {EXAMPLE} (rad/s) or time_s,wx_dps,wy_dps,wz_dps{_or_names(source, columns, options)}"
    )


def _or_names(source: NamedColumns, columns: MotionColumns, options: ReadingOptions) -> str:
    """What else to state: names of the columns, as far as their numbers show what they are; empty where they do not."""
    if (
        options.columns is not None
        or not source.takes_names
        or {"rate", "quaternion", "matrix", "mrp"} & columns.vectors.keys()
    ):
        return ""
    rows, are_numbered = _head(source), len({re.sub(r"\d+", "", name) for name in source.names}) == 1
    clock, unit = (None, "") if columns.time is None else columns.time
    proposed = proposed_columns(rows, clock)
    return (
        f"; or {how_to_name(rows, clock, unit)}"
        if is_certain(proposed) or (proposed and are_numbered)
        else ""
    )
