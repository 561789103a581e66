"""Measurements that a program holds in memory: a data frame, a mapping of columns, or arrays, checked as files are."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.io.argument_checks import refuse
from spinfilters.io.headings import Quantity, is_clock
from spinfilters.io.input_file import MAX_TABLE_ROWS, path_text, reason, value_text
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.motion_table import MotionTable, motion_of
from spinfilters.io.named_columns import ArrayColumns
from spinfilters.io.repeated_rows import without_repeated_rows
from spinfilters.io.sensor_format import SensorFormat, dataset_kinds, kind_called
from spinfilters.io.sensor_tables import stream_of_table
from spinfilters.io.stated_values import CLOCK_UNITS, LENGTH_UNITS, RATE_UNITS, ReadingOptions

TABLE: Final = "the table"
"""What messages call a table in memory."""
MOTION_KINDS: Final = ("gyro", "pose", "attitude")
"""Kinds that a motion table can hold, whatever its columns are called."""
WHAT_TO_GIVE: Final = (
    "a path, a data set, a DataFrame, a mapping of columns, or an array with kind=... such as 'gyro'"
)


def is_table(value: object) -> bool:
    """Whether a value may be a table in memory: a data frame, a mapping, an array, or a pair of times and values."""
    if isinstance(value, Mapping | tuple | list):
        return len(value) > 0 and not any(
            isinstance(each, str) for each in value if not isinstance(value, Mapping)
        )
    return isinstance(value, np.ndarray) or _is_frame(value)


def _is_frame(value: object) -> bool:
    """Whether a value has named columns, as the data frames of pandas and polars do."""
    return getattr(value, "columns", None) is not None and not isinstance(value, type)


def reading_options(units: str | Mapping[str, str] | None, rate: float | None = None) -> ReadingOptions:
    """Reading options that state the units of a table in memory.

    Parameters
    ----------
    units : str, Mapping or None
        Of body rates or positions, such as "deg/s"; or by quantity: ``{"time": "ms", "rate": "deg/s"}``.
    rate : float or None
        Samples a second, Hz, in place of a clock.

    Raises
    ------
    InputError
        An unknown quantity or unit.
    """
    if units is None:
        return ReadingOptions(rate=rate)
    if isinstance(units, str):
        is_clock = units in CLOCK_UNITS and units not in LENGTH_UNITS
        return ReadingOptions(clock=units, rate=rate) if is_clock else ReadingOptions(unit=units, rate=rate)
    if not isinstance(units, Mapping) or not units:
        refuse("units", units, "a unit such as 'deg/s', or units by quantity such as {'time': 'ms'}")
    allowed: dict[str, Mapping[str, float]] = {
        "time": CLOCK_UNITS,
        "rate": RATE_UNITS,
        "position": LENGTH_UNITS,
    }
    for quantity, unit in units.items():
        if quantity not in allowed:
            raise InputError(f"units of {value_text(quantity)} are unknown; use {', '.join(allowed)}")
        if unit not in allowed[quantity]:
            raise InputError(
                f"units of {quantity} are {value_text(unit)}; give one of {', '.join(allowed[quantity])}"
            )
    stated = [unit for quantity, unit in units.items() if quantity != "time"]
    if len(stated) > 1:
        raise InputError(
            "units name rates and positions; a table is read as one of them: leave the other out"
        )
    return ReadingOptions(unit=next(iter(stated), None), clock=units.get("time"), rate=rate)


def measured_table(table: Any, kind: str | None, options: ReadingOptions) -> MotionTable:
    """Measurements of one sensor, from a table in memory.

    Body rates, poses and attitudes are found by the names of their columns, as in a file; the table of another sensor has the
    columns of its format. Rows are counted from 0 in messages.

    Parameters
    ----------
    table : data frame, mapping, array or pair
        A mapping is of names to columns. An array has the columns of the kind's format, beginning with the time; a pair is of times
        and values.
    kind : str or None
        Of `dataset_kinds`; None to recognise it by the names.
    options : ReadingOptions
        Unit, clock and rate.

    Raises
    ------
    InputError
        As for a file of the same numbers.
    """
    kinds = dataset_kinds()
    kind = None if kind is None else kind_called(kind)
    if kind is not None and kind not in kinds:
        raise InputError(f"kind {value_text(kind)} is unknown; use {', '.join(kinds)}")
    columns = _columns(table, None if kind is None else kinds[kind], options)
    form = kinds[kind] if kind is not None else _form_of(columns, list(kinds.values()))
    if form is not None and form.kind not in MOTION_KINDS:
        return MotionTable(_strict(columns, form, options), None, ())
    bare: Quantity | None = {"gyro": "rate", "pose": "position"}.get(kind or "")  # pyright: ignore[reportAssignmentType]
    measured = motion_of(columns, options, bare)
    if form is not None and measured.stream.sensor != form.name:
        raise InputError(
            f"{path_text(columns.path)}: its columns {value_text(', '.join(columns.names))} are those of {measured.stream.sensor} "
            f"measurements, and kind is {form.kind}; correct one of them"
        )
    stream, remark = without_repeated_rows(measured.stream)
    remarks = (*measured.remarks, *([remark] if remark else []))
    return MotionTable(stream, measured.acceleration, remarks)


def _form_of(columns: ArrayColumns, forms: list[SensorFormat]) -> SensorFormat | None:
    """The format whose columns are all there and which no motion table holds; None for a motion table."""
    others = [form for form in forms if form.kind not in MOTION_KINDS]
    return next((form for form in others if set(form.header) <= set(columns.names)), None)


def _strict(columns: ArrayColumns, form: SensorFormat, options: ReadingOptions) -> MeasurementStream:
    """Stream of the columns of a sensor's format. InputError: one is missing."""
    options.require_only((), f"{form.kind} measurements, which are in the units of their columns")
    missing = [name for name in form.header if name not in columns.names]
    if missing:
        raise InputError(
            f"{path_text(columns.path)}: has no column {missing[0]}; a table of kind {form.kind} has {', '.join(form.header)}"
        )
    return stream_of_table(form, columns.read([columns.names.index(name) for name in form.header]))


def _columns(table: Any, form: SensorFormat | None, options: ReadingOptions) -> ArrayColumns:
    """Named columns of a table in memory. InputError: no table; an array without a kind, or of another width."""
    if isinstance(table, Mapping):
        return array_columns(dict(table))
    if isinstance(table, np.ndarray) and table.dtype.names is not None:
        return array_columns({name: table[name] for name in table.dtype.names})
    if _is_frame(table):
        return array_columns(_frame_columns(table))
    if form is None:
        raise InputError(f"an array has no column names; give kind=..., one of {', '.join(dataset_kinds())}")
    header = _header(form, options)
    return array_columns(dict(zip(header, _array(table, form, header, options), strict=True)))


def _header(form: SensorFormat, options: ReadingOptions) -> tuple[str, ...]:
    """Names of an array's columns, which has none of its own: the clock is in the unit that is stated, else in seconds."""
    if options.rate is not None:
        return form.header[1:]
    if options.clock is not None and form.kind in MOTION_KINDS:
        return (f"time_{options.clock}", *form.header[1:])
    return form.header


def _frame_columns(frame: Any) -> dict[str, Any]:
    """Columns of a data frame by their names, with its index where that is a clock. InputError: the frame does not give them."""
    try:
        return _index_of(frame) | {str(name): frame[name] for name in frame.columns}
    except Exception as error:  # whatever a foreign frame raises
        raise InputError(
            f"{TABLE}: its columns cannot be read ({reason(error)}); give arrays by name"
        ) from None


def _array(
    table: Any, form: SensorFormat, header: tuple[str, ...], options: ReadingOptions
) -> list[np.ndarray]:
    """Columns of an array, or of a pair of times and values. InputError: not as many as the kind has."""
    wanted = f"a table of kind {form.kind} has {len(header)} columns: {', '.join(header)}"
    if options.rate is not None:
        wanted += "; with a rate, leave the clock out"
    try:
        if isinstance(table, tuple | list) and len(table) == 2 and np.ndim(table[1]) == 2:
            time, values = _without_mask(table[0]), _without_mask(table[1])
            if time.shape != values.shape[:1]:
                raise InputError(
                    f"{TABLE}: has times of shape {time.shape} and values of shape {values.shape}; {wanted}"
                )
            columns = [time, *values.T]
        else:
            array = _without_mask(table)
            is_like = array.ndim == 2 and array.shape[1] == len(header)
            columns = list(array.T) if is_like else []
    except ValueError:
        raise InputError(f"{TABLE}: is no array of numbers; {wanted}") from None
    if len(columns) != len(header):
        raise InputError(f"{TABLE}: has shape {np.shape(table)}; {wanted}")
    return columns


def array_columns(columns: Mapping[Any, Any], path: Path = Path(TABLE)) -> ArrayColumns:
    """Named columns of arrays, lists or series; of dates a clock may be, whatever it is called.

    Parameters
    ----------
    columns : Mapping
        Names and columns.
    path : Path
        What messages call the table.

    Raises
    ------
    InputError
        No column; one that is no list of values; columns of different lengths.
    """
    names, arrays = [], []
    for name, values in columns.items():
        try:
            array = _without_mask(values)
        except Exception:  # lists that differ in length, or whatever a foreign array raises
            array = np.empty((0, 0))
        if array.ndim != 1:
            raise InputError(
                f"{path_text(path)}: {value_text(str(name))} is of shape {np.shape(array)}; give one value a row"
            )
        if len(array) > MAX_TABLE_ROWS:
            raise InputError(
                f"{path_text(path)}: has {len(array)} rows, at most {MAX_TABLE_ROWS} are read; cut it into smaller tables"
            )
        text = str(name)
        if array.dtype.kind in "mM" and not is_clock(text):
            text = f"{text} (s)"  # a column of dates is a clock
        names.append(text)
        arrays.append(array)
    if not names:
        raise InputError(f"{path_text(path)}: has no columns; give a clock and body rates, or poses")
    return ArrayColumns(path, tuple(names), tuple(arrays))


def _without_mask(values: Any) -> np.ndarray:
    """An array of the values: masked ones as NaN, instants of a time zone as UTC."""
    if getattr(getattr(values, "dtype", None), "tz", None) is not None:
        return np.asarray(values, dtype="M8[ns]")
    if isinstance(values, np.ma.MaskedArray) and values.dtype.kind in "biuf":
        return np.ma.filled(values.astype(np.float64), np.nan)
    return np.asarray(values)


def _index_of(table: Any) -> dict[str, np.ndarray]:
    """The index of a data frame where it is a clock: of dates or durations, or named as one."""
    index = getattr(table, "index", None)
    if index is None or callable(index):
        return {}
    values, name = _without_mask(index), getattr(index, "name", None)
    if values.dtype.kind in "mM" or (name is not None and is_clock(str(name))):
        return {str(name or "time"): values}
    return {}
