"""Motion tables: gyro, accelerometer and poses by the names of their columns, with the unit of their clock."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.absolute_orientation import nearest_rotation
from spinfilters.core.attitude_conversions import quaternion_from_matrix, quaternion_from_mrp
from spinfilters.core.errors import InputError
from spinfilters.io.attitude_direction import CONJUGATE, Direction, quaternion_direction
from spinfilters.io.headings import ROTATIONS, Quantity
from spinfilters.io.input_file import path_text, value_text
from spinfilters.io.long_table import long_columns
from spinfilters.io.measurement_log import Acceleration, MeasurementStream
from spinfilters.io.motion_clock import (
    clock_by_numbers,
    clock_seconds,
    preferred_clocks,
    tick_of_xsens,
    timed,
    with_counter,
)
from spinfilters.io.motion_columns import EXAMPLE, KNOWN_UNITS, MotionColumns, VectorColumns, motion_columns
from spinfilters.io.named_columns import NamedColumns, RenamedColumns, TextColumns, as_measured
from spinfilters.io.stated_values import (
    LENGTH,
    LENGTH_UNITS,
    RATE,
    RATE_UNITS,
    NumberRange,
    ReadingOptions,
    to_state,
)
from spinfilters.io.table_layout import read_layout
from spinfilters.io.text_table import Table
from spinfilters.io.unnamed_columns import (
    AT_REST,
    MOST_COLUMNS,
    RATE_NAMES,
    how_to_name,
    is_certain,
    proposed_columns,
    proved_columns,
)

MOTION_TABLE_FASTEST: Final[float] = 75.0
FASTEST_OF_ALL: Final[float] = 400.0
"""Largest |rate| that gyros of phones and inertial units measure, about 4000 deg/s, and that any gyro does, rad/s."""
MRP: Final = NumberRange(-1e6, 1e6)
"""Of a component of modified Rodrigues parameters, tan(angle / 4) n: a whole turn has none."""
LARGEST_FORCE: Final[float] = 1e6
"""Of an accelerometer, in any unit: one that says more is not believed."""


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
        source.path, source.names, options, bare, lambda found: preferred_clocks(source, found)
    )
    if columns.time is None and options.rate is None and source.stated_rate is None:
        columns = replace(columns, time=clock_by_numbers(source, columns))
    if not columns.describe_motion and options.columns is None and source.takes_names:
        names = _proved_names(source, columns)
        if names is not None:
            own = "t" if columns.time is None else source.names[columns.time[0]]
            called = tuple(own if name == "t" else "" if name == "-" else name for name in names)
            table = motion_of(RenamedColumns(source, called), options, bare)
            remark = "columns named by their numbers: the rates are the derivative of the quaternion"
            return replace(table, remarks=(*table.remarks, remark))
    columns, options = with_counter(source, columns, options)
    quantity = _quantity(source, columns, options, bare)
    return (
        _rates(source, columns, options) if quantity == "rate" else _poses(source, columns, options, quantity)
    )


def _head(source: NamedColumns) -> Float[np.ndarray, "n m"]:
    """First rows of a table, none of one of thousands of columns, whose names nobody states."""
    return source.head() if len(source.names) <= MOST_COLUMNS else np.empty((0, 0))


def _proved_names(source: NamedColumns, columns: MotionColumns) -> list[str] | None:
    """Names of all columns where their numbers prove them: rates are the derivative of the quaternion beside them."""
    return proved_columns(_head(source), None if columns.time is None else columns.time[0])


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
        proved = _proved_names(source, columns) or []
        called = {proved[k] for k in vector.indices} if proved else set()
        by_logger = next((unit for unit, names in RATE_NAMES.items() if called == set(names)), "")
    unit = _rate_unit(table, vector, options, by_logger)
    if ROTATIONS & columns.vectors.keys():
        remarks.append("attitudes left out: an inertial unit makes them of its rates")
    _require_measurable(table, unit, bool(vector.unit) or options.unit is not None)
    values = table.values.copy()
    values[:, -3:] *= RATE_UNITS[unit]
    table, speed = replace(table, values=values), np.linalg.norm(values[:, -3:], axis=1)
    table, clock = timed(table, source, columns, options, speed)
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
        return "deg/s" if table.values.shape[1] > 3 and tick_of_xsens(table.values[:, 0]) == "us" else "rad/s"
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
    if rotation != "quaternion":
        table = _with_quaternions(table, rotation)
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
    table, clock = timed(table, source, columns, options)
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
    if not (np.abs(turned) <= MRP.largest).all():
        return "unknown"
    if rotation == "matrix":
        turned = quaternion_from_matrix(nearest_rotation(turned.reshape(-1, 3, 3)))
    elif rotation == "mrp":
        turned = quaternion_from_mrp(4.0 * turned)
    return quaternion_direction(time, turned, rows[:, list(found["rate"].indices)])


def _with_quaternions(table: Table, rotation: Quantity) -> Table:
    """A table whose last columns, R_ib row by row or Rodrigues parameters s of q_ib, are a quaternion.

    InputError: see `rotations_of`; parameters of almost a whole turn, with their line.
    """
    if rotation == "matrix":
        width, q = 9, quaternion_from_matrix(rotations_of(table, table.values[:, -9:].reshape(-1, 3, 3)))
    else:
        table.require(slice(-3, None), MRP)
        width, q = 3, quaternion_from_mrp(4.0 * table.values[:, -3:])
    names = (*table.names[:-width], "qx", "qy", "qz", "qw")
    return replace(table, names=names, values=np.column_stack([table.values[:, :-width], q]))


ROTATION_ERROR: Final = 1e-3
"""Of an element of R R', which the digits of a text cause at most."""
ENOUGH_DECIMALS: Final = 4
"""Decimals of a rotation matrix whose rounding, 2 sqrt(3) halves of the last digit in R R', stays below `ROTATION_ERROR`."""


def rotations_of(table: Table, R: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "n 3 3"]:
    """Rotations nearest to the matrices of a table, which have only the digits of a text.

    InputError: a matrix that is none, R R' = 1 and det R = 1 to `ROTATION_ERROR`, with its line.
    """
    away = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    wrong = np.flatnonzero(~(away <= ROTATION_ERROR) | (np.linalg.det(R) < 0))
    if wrong.size:
        row = int(wrong[0])
        raise table.error(row, _what_is_wrong(R, row, float(away[row]), table.counted))
    return nearest_rotation(R)


def _what_is_wrong(R: Float[np.ndarray, "n 3 3"], row: int, away: float, counted: str) -> str:
    """Why a matrix of a table is no rotation, and the cure; `away` is how far R R' is from 1."""
    delete = f"or delete the {counted}"
    decimals = _decimals(R)
    half = 0.5 * 10.0**-decimals  # of a unit of the last digit, by which rounding moves each element at most
    is_rounded = decimals < ENOUGH_DECIMALS and away <= 2 * math.sqrt(3) * half + 3 * half**2
    if np.linalg.det(R[row]) < 0 and (is_rounded or away <= ROTATION_ERROR):
        return (
            "its matrix is a reflection (determinant -1), whose axes are left-handed; correct the signs or the order of "
            f"its elements, {delete}"
        )
    amount = f"its matrix is no rotation, as R R' differs from 1 by {away:.2g}"
    if is_rounded:
        places = "1 decimal" if decimals == 1 else f"{decimals} decimals"
        return f"{amount}, which rounding to {places} explains; write at least {ENOUGH_DECIMALS} decimals, {delete}"
    return f"{amount}; correct {delete}"


def _decimals(R: Float[np.ndarray, "n 3 3"]) -> int:
    """Decimals with which the elements of matrices are printed, from 1 to `ENOUGH_DECIMALS`."""
    for decimals in range(1, ENOUGH_DECIMALS):
        if np.allclose(R, R.round(decimals), rtol=0.0, atol=1e-9):
            return decimals
    return ENOUGH_DECIMALS


MOST_BEYOND: Final = 0.05
"""Of the parts of whole seconds those that are none, at most: of more, the column is something else."""


def _read_quantities(source: NamedColumns, columns: MotionColumns, quantities: tuple[Quantity, ...]) -> Table:
    """Clock, where there is one, and quantities."""
    chosen = [k for quantity in quantities for k in columns.vectors[quantity].indices]
    clock = [] if columns.time is None else [columns.time[0]]
    if columns.fraction is None or columns.time is None:
        return source.read([*clock, *chosen], keys=len(clock))
    place, unit = columns.fraction
    table = source.read([*clock, place, *chosen], keys=2)
    seconds, rest = table.values[:, 0], unit * table.values[:, 1]
    steps, is_whole = np.diff(seconds), (seconds == np.floor(seconds)).all()
    beyond = np.flatnonzero(~((rest >= 0) & (rest < 1)))
    if is_whole and (steps == 0).any() and 0 < len(beyond) < MOST_BEYOND * len(rest):
        row, part = int(beyond[0]), value_text(table.names[1])
        what = f"{part} is {table.values[row, 1]:.0f}, no part of a second"
        raise table.error(row, f"{what}; correct or delete the {table.counted}")
    is_part = is_whole and not len(beyond)
    # where one second stands in several rows the rest tells them apart, however long a dropout between others is
    if is_part and ((steps <= 1).all() or (steps == 0).any()):
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
    _require_same_unit(table, vector, options)
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


def _require_same_unit(table: Table, vector: VectorColumns, options: ReadingOptions) -> None:
    """InputError: the header says one unit, and the user another."""
    if vector.unit and options.unit not in (None, vector.unit):
        raise InputError(
            f"{path_text(table.path)}: its header says {vector.unit}, and the stated unit is {options.unit}; "
            "state none, or correct the header"
        )


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
    _require_same_unit(table, vector, options)
    return vector.unit or options.unit or "m"


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
    spelled = spelled or next((u for u, (low, high) in AT_REST.items() if low < middle < high), "")
    if columns.time is None and table.incomplete:
        return None  # a clock of the stated rate counts all rows
    time, _ = clock_seconds(table, source, columns, options)
    if not spelled or len(time) < 2 or (np.diff(time) <= 0).any():
        return None
    return Acceleration(time, force * KNOWN_UNITS["acceleration"][spelled])


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
    if options.columns is not None or not source.takes_names or columns.describe_motion:
        return ""
    rows, are_numbered = _head(source), len({re.sub(r"\d+", "", name) for name in source.names}) == 1
    clock, unit = (None, "") if columns.time is None else columns.time
    proposed = proposed_columns(rows, clock)
    return (
        f"; or {how_to_name(rows, clock, unit)}"
        if is_certain(proposed) or (proposed and are_numbered)
        else ""
    )
