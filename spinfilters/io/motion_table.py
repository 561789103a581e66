"""Motion tables: gyro, accelerometer and poses by the names of their columns, with the unit of their clock."""

import math
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import DATASET_FILE, LANDMARK_FILE, Dataset
from spinfilters.io.dataset_reader import StatedReader
from spinfilters.io.input_file import path_text, printable, value_text
from spinfilters.io.measurement_log import Acceleration, MeasurementLog, MeasurementStream
from spinfilters.io.motion_columns import (
    EXAMPLE,
    KNOWN_UNITS,
    MotionColumns,
    Quantity,
    VectorColumns,
    motion_columns,
)
from spinfilters.io.sensor_format import sensor_format, sensor_formats
from spinfilters.io.sensor_tables import require_clock, require_turns
from spinfilters.io.stated_values import (
    CLOCK_UNITS,
    LENGTH,
    RATE,
    RATE_UNITS,
    ReadingOptions,
)
from spinfilters.io.text_table import Table, TableLayout, read_columns, read_layout
from spinfilters.io.truth import TRUTH_TABLE

SLOWEST: Final = 1.0
FASTEST: Final = 8000.0
"""Hz: gyros and trackers whose clock has no unit sample between these."""
LARGEST_ROTATION: Final[float] = np.pi
"""Between samples in the median, rad: a gyro that is sampled more slowly tells no motion."""
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
    dated = [
        unit
        for unit, second in CLOCK_UNITS.items()
        if _CALENDAR[0] < abs(float(time[0])) * second < _CALENDAR[1]
    ]
    if dated:
        return dated[0]
    step = float(np.median(np.abs(np.diff(time)))) if len(time) > 1 else 0.0
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
        f"{path_text(path)}: the clock '{name[:40]}' steps by {step:.6g}, and does not say in what; give --clock {listed}, "
        "or name it so, such as time_ms"
    )


def _plausible_units(time: Float[np.ndarray, " n"], step: float) -> list[str]:
    """Units at which the sampling rate is plausible."""
    whole = bool((time == np.round(time)).all())
    if not step or (step < LONGEST_STEP and not whole):
        return ["s"]
    return [unit for unit, second in CLOCK_UNITS.items() if SLOWEST <= 1.0 / (step * second) <= FASTEST]


MOTION_TABLE_FASTEST: Final[float] = 75.0
FASTEST_OF_ALL: Final[float] = 400.0
"""Largest |rate| that gyros of phones and inertial units measure, about 4000 deg/s, and that any gyro does, rad/s."""
MOTION_TABLE_LONGEST_STEP: Final[float] = 3600.0
"""s: a clock that steps by more than an hour is not in seconds."""
LARGEST_FORCE: Final[float] = 1e6
"""Of an accelerometer, in any unit: one that says more is not believed."""
_AT_REST = {"m/s^2": (5.0, 15.0), "g": (0.5, 1.5)}
"""Medians of an accelerometer without a unit that tell it."""


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
    """Poses, attitudes or body rates of a table, whichever of them comes first.

    Parameters
    ----------
    options : ReadingOptions
        What its user states.
    bare : Quantity | None
        Quantity of columns that are called x, y and z only.

    Raises
    ------
    InputError
        As `read_layout`, `motion_columns`, `read_columns` and `require_clock`; no such columns; a unit that is in
        doubt or contradicts what is stated; numbers out of their range.
    """
    options.require_only(("unit", "clock", "rate"), "a table")
    layout = read_layout(path)
    columns = motion_columns(path, layout.names, options, bare)
    quantities = _quantities(path, columns, layout.names, options)
    if "rate" in quantities:
        return _rates(path, layout, columns, options)
    return _poses(path, layout, columns, options)


def read_acceleration(path: Path, options: ReadingOptions) -> Acceleration | None:
    """Accelerometer of a table of its own.

    Its columns may be called x, y and z. InputError: as `read_motion_table`.
    """
    layout = read_layout(path)
    columns = motion_columns(path, layout.names, replace(options, rate=None), "acceleration")
    return _acceleration(path, layout, columns, options)


def _rates(path: Path, layout: TableLayout, columns: MotionColumns, options: ReadingOptions) -> MotionTable:
    vector, remarks = columns.vectors["rate"], []
    table = _read(path, layout, columns, ("rate",))
    unit = _rate_unit(table, vector, options, "seconds_elapsed" in layout.names)
    _require_measurable(table, unit, bool(vector.unit) or options.unit is not None)
    values = table.values.copy()
    values[:, -3:] *= RATE_UNITS[unit]
    table, speed = replace(table, values=values), np.linalg.norm(values[:, -3:], axis=1)
    table, clock = _timed(table, columns, options, layout, speed)
    table.require(slice(1, 4), RATE)
    if table.incomplete:
        remarks.append(f"{table.incomplete} rows without rates left out")
    if clock != "s":
        remarks.append(clock)
    with table.naming_lines():
        stream = MeasurementStream("gyro", table.values[:, 0], table.values[:, 1:])
    return MotionTable(stream, _acceleration(path, layout, columns, options), tuple(remarks))


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
        cure = "give --unit deg/s (or mrad/s, mdeg/s, rpm), say it in the header ('wx (deg/s)'), or correct the line"
    value, name = float(table.values[row, column]), value_text(table.names[column])
    raise table.error(
        row,
        f"a rate of {speed:.4g} rad/s is more than a gyro measures ({name} is {value:.6g} {unit}); {cure}",
    )


def _poses(path: Path, layout: TableLayout, columns: MotionColumns, options: ReadingOptions) -> MotionTable:
    """Poses, or attitudes where no position is there.

    Rates beside them are taken as derived and left out.
    """
    options.require_only(("clock", "rate"), "a table of poses")
    has_position = "position" in columns.vectors
    table = _read(path, layout, columns, ("position", "quaternion") if has_position else ("quaternion",))
    table, clock = _timed(table, columns, options, layout, None)
    if has_position:
        values = table.values.copy()
        values[:, 1:4] *= KNOWN_UNITS["position"][columns.vectors["position"].unit or "m"]
        table = replace(table, values=values)
        table.require(slice(1, 4), LENGTH)
    with table.naming_lines():
        stream = MeasurementStream(
            "pose" if has_position else "attitude", table.values[:, 0], table.values[:, 1:]
        )
    return MotionTable(stream, None, () if clock == "s" else (clock,))


def _read(path: Path, layout: TableLayout, columns: MotionColumns, quantities: tuple[Quantity, ...]) -> Table:
    """Clock, where there is one, and quantities."""
    chosen = [k for quantity in quantities for k in columns.vectors[quantity].indices]
    clock = [] if columns.time is None else [columns.time[0]]
    return read_columns(path, layout, [*clock, *chosen], keys=len(clock))


def _rate_unit(table: Table, vector: VectorColumns, options: ReadingOptions, is_known_export: bool) -> str:
    """Unit of body rates, from the header, the user, or the convention of the name.

    Raises
    ------
    InputError
        No unit, or two that differ.
    """
    if vector.unit and options.unit not in (None, vector.unit):
        raise InputError(
            f"{path_text(table.path)}: its header says {vector.unit}, --unit says {options.unit}; "
            "leave --unit out, or correct the header"
        )
    unit = vector.unit or options.unit or ("rad/s" if vector.is_si or is_known_export else "")
    if not unit:
        largest = float(np.abs(table.values[:, -3:]).max())
        raise InputError(
            f"{path_text(table.path)}: columns {value_text(', '.join(table.names[-3:]))} do not say their unit "
            f"(largest {largest:.4g}); give --unit deg/s or --unit rad/s, or name them so (gyro_x_dps)"
        )
    return unit


def _timed(
    table: Table,
    columns: MotionColumns,
    options: ReadingOptions,
    layout: TableLayout,
    speed: Float[np.ndarray, " n"] | None,
) -> tuple[Table, str]:
    """Table with time in s as its first column, and a remark on the clock's unit (just "s" for seconds)."""
    if columns.time is None:
        time = np.arange(len(table.values)) / (options.rate or 1.0)
        table = replace(table, names=("time", *table.names), values=np.column_stack([time, table.values]))
        require_clock(table)
        return table, f"clock of {options.rate:g} Hz as stated"
    index, stated = columns.time
    if stated and options.clock not in (None, stated):
        raise InputError(
            f"{path_text(table.path)}: its clock is named in {stated}, --clock says {options.clock}; "
            "leave --clock out, or rename it"
        )
    stamps = table.values[:, 0]
    unit = stated or options.clock or clock_unit(table.path, layout.names[index], stamps, speed)
    table = replace(table, values=np.column_stack([stamps * CLOCK_UNITS[unit], table.values[:, 1:]]))
    require_clock(table)
    if speed is not None:
        require_turns(table, speed)
    step = float(np.median(np.diff(table.values[:, 0])))
    if step > MOTION_TABLE_LONGEST_STEP:
        raise InputError(
            f"{path_text(table.path)}: its clock steps by {step:.3g} s, so it is hardly in seconds; name its unit, such as time_ns"
        )
    return table, unit if unit == "s" else f"clock in {unit}"


def _acceleration(
    path: Path, layout: TableLayout, columns: MotionColumns, options: ReadingOptions
) -> Acceleration | None:
    """Accelerometer of a table; None without one, or where its unit is in doubt."""
    if "acceleration" not in columns.vectors:
        return None
    table = _read(path, layout, columns, ("acceleration",))
    force, spelled = table.values[:, -3:], columns.vectors["acceleration"].unit
    if np.abs(force).max() > LARGEST_FORCE:
        return None
    middle = float(np.median(np.linalg.norm(force, axis=1)))
    spelled = spelled or next((u for u, (low, high) in _AT_REST.items() if low < middle < high), "")
    time = _acceleration_times(table, columns, options)
    if not spelled or len(time) < 2 or (np.diff(time) <= 0).any():
        return None
    return Acceleration(time, force * KNOWN_UNITS["acceleration"][spelled])


def _acceleration_times(
    table: Table, columns: MotionColumns, options: ReadingOptions
) -> Float[np.ndarray, " n"]:
    """Times of an accelerometer's samples, s.

    They are of their clock, or of the rate that is stated, if no row is left out.
    """
    if columns.time is None:
        return np.arange(0 if table.incomplete else len(table.values)) / (options.rate or 1.0)
    stamps, stated = table.values[:, 0], columns.time[1]
    unit = stated or options.clock or clock_unit(table.path, table.names[0], stamps, None)
    return stamps * CLOCK_UNITS[unit]


def _quantities(
    path: Path, columns: MotionColumns, names: tuple[str, ...], options: ReadingOptions
) -> tuple[Quantity, ...]:
    """The quantities read of a table.

    InputError where it does not tell a motion or its clock.
    """
    found = columns.vectors
    if columns.time is None and options.rate is None:
        raise InputError(
            f"{path_text(path)}: header {value_text(', '.join(names))}: no column is a clock; name it time_s, or give --rate HZ"
        )
    if "quaternion" in found:
        return ("quaternion",)
    if "rate" in found:
        return ("rate",)
    raise InputError(
        f"{path_text(path)}: header {value_text(', '.join(names))}: tells no body rate about each of x, y, z; name the columns "
        f"such as {EXAMPLE} (rad/s) or time_s,wx_dps,wy_dps,wz_dps"
    )


_SUFFIXES = (".csv", ".tsv")
_ALONE = "gyro.csv"  # the one table of a folder that is a data set without it


class MotionFileReader(StatedReader):
    """Reader of a motion table; see `spinfilters.io.motion_table`."""

    name, order = "motion-table", 95
    words = "a gyro .csv"

    def recognises(self, path: Path) -> bool:
        """Whether a file is a single table, by suffix and name, and not a part of a data set folder."""
        return path.suffix.lower() in _SUFFIXES and path.name not in _parts() and not os.path.isdir(path)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Data set of the table; its columns are known by their names."""
        bare: Quantity | None = "rate" if path.stem.lower().startswith("gyro") else None
        return motion_dataset(path, path.name, read_motion_table(path, self.options, bare))


def motion_dataset(path: Path, name: str, table: MotionTable) -> Dataset:
    """Data set of a motion table or of an export."""
    description = "; ".join((printable(name), *table.remarks))
    return Dataset(
        kind=sensor_format(table.stream.sensor).kind,
        log=MeasurementLog((table.stream,)),
        path=path,
        description=description,
        acceleration=table.acceleration,
    )


def _parts() -> set[str]:
    """Tables of data set folders, which tell nothing alone."""
    files = {form.file for form in sensor_formats().values() if not form.suffixes} - {_ALONE}
    return files | {DATASET_FILE, LANDMARK_FILE, TRUTH_TABLE}
