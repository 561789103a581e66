"""Tables with named columns, wherever their numbers come from: a text file, or arrays in memory."""

import itertools
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Protocol

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.io.calendar_clock import seconds_of_clock, seconds_of_dates
from spinfilters.io.input_file import parse_number, path_text, value_text
from spinfilters.io.table_layout import TableLayout, data_lines
from spinfilters.io.text_table import Table, read_columns
from spinfilters.io.unnamed_columns import ROWS, number_of_cell


class NamedColumns(Protocol):
    """A table whose columns are known by their names."""

    @property
    def path(self) -> Path:
        """The file, or what messages call a table without one."""
        ...

    @property
    def names(self) -> tuple[str, ...]:
        """Of all columns."""
        ...

    @property
    def stated_rate(self) -> float | None:
        """Samples a second, Hz, as the lines above the header say; None of others."""
        ...

    @property
    def takes_names(self) -> bool:
        """Whether the user may name its columns by their places."""
        ...

    def head(self) -> Float[np.ndarray, "n m"]:
        """First rows of all columns, dates in s, NaN in cells that are no numbers."""
        ...

    def read(self, columns: Sequence[int], keys: int = 0) -> Table:
        """Finite numbers of some columns, by their indices.

        A row is left out where all but its first ``keys`` columns are empty. InputError: a cell that is no finite number.
        """
        ...


@dataclass(frozen=True)
class TextColumns:
    """Columns of a text table (`spinfilters.io.table_layout.read_layout`)."""

    path: Path
    layout: TableLayout

    @property
    def names(self) -> tuple[str, ...]:
        """Of all columns."""
        return self.layout.names

    @property
    def stated_rate(self) -> float | None:
        """See `NamedColumns.stated_rate`."""
        return self.layout.rate

    @property
    def takes_names(self) -> bool:
        """See `NamedColumns.takes_names`."""
        return True

    def read(self, columns: Sequence[int], keys: int = 0) -> Table:
        """See `NamedColumns.read`."""
        return read_columns(self.path, self.layout, columns, keys)

    def head(self) -> Float[np.ndarray, "n m"]:
        """See `NamedColumns.head`."""
        lines = itertools.islice(data_lines(self.path, self.layout), ROWS)
        cells = [self.layout.cells(text) for _, text in lines]
        marks = ("," if self.layout.decimal_comma else ".", ".")
        whole = [
            [number_of_cell(cell.replace(*marks)) for cell in row]
            for row in cells
            if len(row) == len(self.names)
        ]
        return np.array(whole, dtype=np.float64).reshape(-1, len(self.names))


@dataclass(frozen=True, eq=False)
class ArrayColumns:
    """Columns in memory, of equal length; an empty cell is NaN, as a missing value of a data frame is.

    Attributes
    ----------
    path : Path
        What messages call the table.
    names : tuple[str, ...]
        Of the columns.
    columns : tuple[np.ndarray, ...]
        One array for each name, of any type; only those that are read need be numbers.
    rate : float | None
        Samples a second, Hz, as what stands beside the columns says; None of others.
    takes_names : bool
        See `NamedColumns.takes_names`.
    """

    path: Path
    names: tuple[str, ...]
    columns: tuple[np.ndarray, ...]
    rate: float | None = None
    takes_names: bool = False

    @property
    def stated_rate(self) -> float | None:
        """See `NamedColumns.stated_rate`."""
        return self.rate

    def head(self) -> Float[np.ndarray, "n m"]:
        """See `NamedColumns.head`."""
        rows = np.full((min(len(self.columns[0]), ROWS) if self.columns else 0, len(self.names)), np.nan)
        for k, column in enumerate(self.columns):
            first = column[:ROWS]
            with suppress(InputError):
                rows[:, k] = (_seconds if _is_dated(first) else _numbers)(self.path, self.names[k], first)
        return rows

    def __post_init__(self) -> None:
        lengths = {name: len(column) for name, column in zip(self.names, self.columns, strict=True)}
        if len(set(lengths.values())) > 1:
            listed = ", ".join(f"{value_text(name)} {length}" for name, length in lengths.items())
            raise InputError(
                f"{path_text(self.path)}: its columns differ in length ({listed}); give as many rows of each"
            )

    def read(self, columns: Sequence[int], keys: int = 0) -> Table:
        """See `NamedColumns.read`; rows are counted from 0."""
        names = tuple(self.names[k] for k in columns)
        is_dated = keys > 0 and _is_dated(self.columns[columns[0]])
        numbers = [_numbers(self.path, self.names[k], self.columns[k]) for k in columns[is_dated:]]
        if is_dated:
            numbers.insert(0, _seconds(self.path, names[0], self.columns[columns[0]]))
        values = np.column_stack(numbers) if numbers else np.empty((0, 0))
        measured = ~np.isnan(values[:, keys:]).all(axis=1) | (values.shape[1] <= keys)
        rows, values = np.flatnonzero(measured), values[measured]
        if not len(values):
            raise InputError(f"{path_text(self.path)}: has no rows of numbers; give at least two")
        wrong = np.argwhere(~np.isfinite(values))
        if wrong.size:
            row, column = map(int, wrong[0])
            raise InputError(
                f"{path_text(self.path)}: row {rows[row]}: {value_text(names[column])} is {values[row, column]}, "
                "not finite; correct or delete the row"
            )
        left_out = int(np.count_nonzero(~measured))
        layout = TableLayout(self.names, header_line=0)
        return Table(
            self.path, layout, names, values, rows.tolist(), left_out, counted="row", is_dated=is_dated
        )


@dataclass(frozen=True)
class _OfColumns:
    """Columns that are made of others, of the same table.

    Attributes
    ----------
    source : NamedColumns
        The others.
    """

    source: NamedColumns

    @property
    def path(self) -> Path:
        """See `NamedColumns.path`."""
        return self.source.path

    @property
    def stated_rate(self) -> float | None:
        """See `NamedColumns.stated_rate`."""
        return self.source.stated_rate


@dataclass(frozen=True)
class RatesOfIncrements(_OfColumns):
    """Columns with the mean rate over each period, d / T, in the place of angles d by which the body turned in it.

    Attributes
    ----------
    angles : tuple[int, ...]
        Indices of the angles about x, y and z, rad.
    period : int
        Index of T, us.
    """

    angles: tuple[int, ...]
    period: int

    @property
    def names(self) -> tuple[str, ...]:
        """See `NamedColumns.names`."""
        called = dict(zip(self.angles, ("omega_x", "omega_y", "omega_z"), strict=True))
        return tuple(called.get(k, name) for k, name in enumerate(self.source.names))

    @property
    def takes_names(self) -> bool:
        """See `NamedColumns.takes_names`."""
        return self.source.takes_names

    def head(self) -> Float[np.ndarray, "n m"]:
        """See `NamedColumns.head`."""
        return self.source.head()

    def read(self, columns: Sequence[int], keys: int = 0) -> Table:
        """See `NamedColumns.read`. InputError: a period that is not positive, too."""
        table = self.source.read([*columns, self.period], keys)
        values, period = table.values[:, :-1].copy(), 1e-6 * table.values[:, -1]
        wrong = np.flatnonzero(~(period > 0))
        if wrong.size:
            raise table.error(
                int(wrong[0]), f"{table.names[-1]} is not above 0; correct or delete the {table.counted}"
            )
        for place, column in enumerate(columns):
            if column in self.angles:
                values[:, place] /= period
        return replace(table, names=tuple(self.names[k] for k in columns), values=values)


@dataclass(frozen=True)
class RenamedColumns(_OfColumns):
    """Columns under other names, as many as they are.

    Attributes
    ----------
    names : tuple[str, ...]
        See `NamedColumns.names`; empty of columns that are not wanted.
    """

    names: tuple[str, ...]

    @property
    def takes_names(self) -> bool:
        """See `NamedColumns.takes_names`; they are known."""
        return False

    def head(self) -> Float[np.ndarray, "n m"]:
        """See `NamedColumns.head`."""
        return self.source.head()

    def read(self, columns: Sequence[int], keys: int = 0) -> Table:
        """See `NamedColumns.read`."""
        table = self.source.read(columns, keys)
        return replace(table, names=tuple(self.names[k] for k in columns))


@dataclass(frozen=True)
class OneOfSeveral(_OfColumns):
    """Rows of the first of several sensors that one table has in turn, by a column with their number.

    Attributes
    ----------
    number : int
        Index of the column.
    """

    number: int

    @property
    def names(self) -> tuple[str, ...]:
        """See `NamedColumns.names`."""
        return self.source.names

    @property
    def takes_names(self) -> bool:
        """See `NamedColumns.takes_names`."""
        return self.source.takes_names

    def head(self) -> Float[np.ndarray, "n m"]:
        """See `NamedColumns.head`."""
        rows = self.source.head()
        return rows[rows[:, self.number] == rows[0, self.number]] if len(rows) else rows

    def read(self, columns: Sequence[int], keys: int = 0) -> Table:
        """See `NamedColumns.read`."""
        table = self.source.read([*columns, self.number], keys)
        number = table.values[:, -1]
        own = np.flatnonzero(number == number[0])
        lines = table.lines
        if len(own) < len(number) and lines is None:
            lines = [line for line, _ in data_lines(table.path, table.layout)]
        lines = lines if lines is None or len(own) == len(number) else [lines[row] for row in own.tolist()]
        return replace(table, names=table.names[:-1], values=table.values[own, :-1], lines=lines)


_INCREMENTS: Final = ("delta_angle[0]", "delta_angle[1]", "delta_angle[2]")
_PERIOD: Final = "delta_angle_dt"
"""Names of PX4's vehicle_imu."""


def as_measured(source: NamedColumns) -> NamedColumns:
    """Columns as one sensor measured them: of several the first, and rates where the table has the angles of each period."""
    names = list(source.names)
    number = next((name for name in ("I", "C") if name in names), None)
    if (
        "TimeUS" in names and number is not None
    ):  # of ArduPilot, whose rows number the sensors, or the filters of its attitude
        source = OneOfSeveral(source, names.index(number))
    if {*_INCREMENTS, _PERIOD} <= set(names):
        source = RatesOfIncrements(source, tuple(map(names.index, _INCREMENTS)), names.index(_PERIOD))
    return source


def _is_dated(clock: np.ndarray) -> bool:
    """Whether a clock is one of dates, durations or times of the day; of texts and objects the first says how all are written."""
    if clock.dtype.kind in "mM":
        return True
    return clock.dtype.kind in "OUT" and len(clock) > 0 and _instant(clock[0]) is not None


def _instant(cell: object) -> float | None:
    """Seconds of a cell that is written as a clock, whatever object it is; None of any other."""
    try:
        return seconds_of_clock(str(cell))
    except Exception:  # whatever a foreign object raises, and a number of 5000 digits
        return None


def _seconds(path: Path, name: str, clock: np.ndarray) -> Float[np.ndarray, " n"]:
    """Seconds of a clock of dates. InputError: the first cell that is none."""
    if clock.dtype.kind in "mM":
        return seconds_of_dates(clock)
    cells = clock.tolist()
    seconds = [_instant(cell) for cell in cells]
    if None in seconds:
        row = seconds.index(None)
        raise InputError(
            f"{path_text(path)}: row {row}: {value_text(name)} is {value_text(cells[row])}, no date or time of the day as in the "
            "row above; correct or delete the row"
        )
    return np.array(seconds, dtype=np.float64)


def _numbers(path: Path, name: str, column: np.ndarray) -> Float[np.ndarray, " n"]:
    """Numbers of a column as float64. InputError: the first cell that is none."""
    if column.dtype.kind in "iuf":
        return column.astype(np.float64)
    values = np.full(len(column), np.nan)
    # the numbers of dates depend on their unit
    cells = column.astype(str) if column.dtype.kind in "mM" else column
    for row, cell in enumerate(cells.tolist()):
        if cell is None:
            continue
        try:
            if isinstance(cell, bool | complex):
                raise TypeError
            values[row] = parse_number(cell) if isinstance(cell, str | bytes) else float(cell)
        except (TypeError, ValueError, OverflowError):
            cure = "correct or delete the row" if _instant(cell) is None else "give seconds"
            raise InputError(
                f"{path_text(path)}: row {row}: {value_text(name)} is {value_text(cell)}, not a number; {cure}"
            ) from None
    return values
