"""Numbers in text files: tables, and arrays of keys."""

import csv
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from spinfilters.data.atomic_write import atomic_file
from spinfilters.data.ignored_warnings import ignored_warnings
from spinfilters.data.input_file import path_text, reason, require_text_table, value_text
from spinfilters.data.stated_values import NumberRange
from spinfilters.errors import InputError

_WRITE_ROWS = 4096  # rows turned into text at a time, which bounds the memory of a writer


@dataclass(frozen=True)
class TableFormat:
    """Layout of a table.

    Delimiter (None: blanks), comment mark, header line, comma as decimal mark.
    """

    delimiter: str | None
    comment: str | None = None
    header: bool = True
    decimal_comma: bool = False

    def cells(self, line: str) -> list[str]:
        """Cells of one line as text.

        An empty list for a line that is blank or only a comment.
        """
        text = line.split(self.comment, 1)[0] if self.comment else line.rstrip("\r\n")
        if not text.strip() and (self.delimiter is None or not text):
            return []
        cells = [cell.strip() for cell in text.split(self.delimiter)]
        return [cell.replace(",", ".") for cell in cells] if self.decimal_comma else cells


TUM_FORMAT = TableFormat(delimiter=None, comment="#", header=False)
"""Blank-separated numbers without a header; '#' starts a comment."""
_LARGEST_ID = 2.0**53  # above it float64 does not tell whole numbers apart


@dataclass(frozen=True, eq=False)
class Table:
    """Finite numbers of a file with column names.

    One row per line that is neither blank nor a comment.
    """

    path: Path
    names: tuple[str, ...]
    values: Float[np.ndarray, "n m"]
    layout: TableFormat

    def line(self, row: int) -> int:
        """Line number (from 1) of a row (from 0), for error messages."""
        for index, (number, _) in enumerate(_data_lines(self.path, self.layout)):
            if index == row:
                return number
        raise IndexError(f"{path_text(self.path)} has no row {row}")

    def error(self, row: int, text: str) -> InputError:
        """An InputError that names the file and the line of the row."""
        return InputError(f"{path_text(self.path)}: line {self.line(row)}: {text}")

    def require(self, columns: slice, allowed: NumberRange) -> None:
        """Require all numbers of the columns to be in range.

        InputError: one that is not, with line, column and range.
        """
        chosen = self.values[:, columns]
        outside = np.argwhere((chosen < allowed.smallest) | (chosen > allowed.largest))
        if outside.size:
            row, column = map(int, outside[0])
            name = self.names[columns][column]
            raise self.error(
                row,
                f"{value_text(name)} is {float(chosen[row, column])!r}; correct or delete the line, give {allowed}",
            )

    def landmark_ids(self, column: int) -> Int[np.ndarray, " n"]:
        """Landmark ids of a column. InputError: one that is no whole number."""
        ids = self.values[:, column]
        bad = np.flatnonzero((ids != np.round(ids)) | (np.abs(ids) > _LARGEST_ID))
        if bad.size:
            raise self.error(
                int(bad[0]), f"landmark_id {float(ids[bad[0]])!r} is not a whole number; renumber it"
            )
        return ids.astype(np.int64)


def read_header(path: Path) -> tuple[str, ...]:
    """Column names in the first line of a delimited table (comma, semicolon or tab).

    Raises
    ------
    InputError: not a text table, or a first line of numbers.
    """
    require_text_table(path)
    return _header(path)[0]


def read_csv(path: Path, names: Sequence[str] | None = None) -> Table:
    """Table with a header line, delimited by comma, semicolon or tab (then also with decimal commas).

    Parameters
    ----------
    names: the exact column names that the file must have, or None for any.

    Raises
    ------
    InputError: missing, binary, empty or too large a file, another header, no rows, a line with another
    number of cells, a cell that is not a finite number.
    """
    require_text_table(path)
    found, layout = _header(path)
    if names is not None and found != tuple(names):
        raise InputError(
            f"{path_text(path)}: line 1: the header is {value_text(','.join(found))}, expected '{','.join(names)}'; "
            "rename or reorder the columns and convert their units"
        )
    return _table(path, found, layout)


def read_blank_separated(path: Path, names: Sequence[str]) -> Table:
    """Table of blank-separated numbers without header, '#' starting a comment; errors as `read_csv`."""
    require_text_table(path)
    return _table(path, tuple(names), TUM_FORMAT)


def write_csv(path: Path, names: Sequence[str], columns: Sequence[np.ndarray]) -> None:
    """Write columns of equal length, comma separated, so that reading gives the same bits. Atomic."""
    with atomic_file(path) as stream:
        stream.write((",".join(names) + "\n").encode())
        for start in range(0, len(columns[0]), _WRITE_ROWS):
            lists = [column[start : start + _WRITE_ROWS].tolist() for column in columns]
            lines = [",".join(map(repr, row)) + "\n" for row in zip(*lists, strict=True)]
            stream.write("".join(lines).encode())


def numbers(path: Path, key: str, value: object, shape: tuple[int, ...]) -> Float[np.ndarray, "..."]:
    """Finite numbers of a key as an array of this shape.

    Text such as '1e-3', no number in YAML, counts.

    Raises
    ------
    InputError: another shape, a cell that is no finite number; the text names the file, the key and the
    value.
    """
    items = value if isinstance(value, list) else [value]
    if len(shape) == 2:
        if len(items) != shape[0]:
            raise _wrong_shape(path, key, value, shape)
        rows = [numbers(path, key, row, shape[1:]) for row in items]
        return np.array(rows)
    if (len(items),) != (shape or (1,)) or (isinstance(value, list) != bool(shape)):
        raise _wrong_shape(path, key, value, shape)
    return np.array([_number(path, key, item) for item in items]).reshape(shape)


def _table(path: Path, names: tuple[str, ...], layout: TableFormat) -> Table:
    try:
        values = _load(path, layout)
    except UnicodeDecodeError:
        raise _not_utf8(path) from None
    except (ValueError, OverflowError) as error:
        raise _first_bad_line(path, names, layout) or _unreadable(path, error) from None
    if values.size == 0:
        raise InputError(f"{path_text(path)}: has no rows of numbers; export or copy it again")
    if values.shape[1] != len(names) or not np.isfinite(values).all():
        raise _first_bad_line(path, names, layout) or _unreadable(path, ValueError("unequal rows"))
    return Table(path, names, values, layout)


def _load(path: Path, layout: TableFormat) -> Float[np.ndarray, "n m"]:
    # "no data" is reported by the caller as an error
    with open(path, encoding="utf-8-sig") as stream, ignored_warnings(UserWarning):
        if layout.header:
            stream.readline()
        lines = (line.replace(",", ".") for line in stream) if layout.decimal_comma else stream
        return np.loadtxt(lines, delimiter=layout.delimiter, comments=layout.comment, ndmin=2)


def _header(path: Path) -> tuple[tuple[str, ...], TableFormat]:
    with open(path, encoding="utf-8-sig", errors="surrogateescape") as stream:
        first, second = stream.readline(), stream.readline()
    if any("\ud800" <= character <= "\udfff" for character in first):
        raise _not_utf8(path)
    delimiter = max(",;\t", key=first.count)
    try:
        names = tuple(
            cell.strip() for cell in next(csv.reader([first.rstrip("\r\n")], delimiter=delimiter), [])
        )
    except csv.Error as error:
        raise InputError(
            f"{path_text(path)}: line 1: is no header ({error}); give a line of column names"
        ) from None
    if not any(names) or all(_is_number(name) for name in names):
        raise InputError(
            f"{path_text(path)}: line 1: {value_text(first.strip())} is no header; add a line of column names"
        )
    decimal_comma = delimiter != "," and "," in second and "." not in second
    return names, TableFormat(delimiter, decimal_comma=decimal_comma)


def _data_lines(path: Path, layout: TableFormat) -> Iterator[tuple[int, list[str]]]:
    with open(path, encoding="utf-8-sig", errors="surrogateescape") as stream:
        for number, line in enumerate(stream, start=1):
            if number == 1 and layout.header:
                continue
            if cells := layout.cells(line):
                yield number, cells


def _first_bad_line(path: Path, names: tuple[str, ...], layout: TableFormat) -> InputError | None:
    for number, cells in _data_lines(path, layout):
        where = f"{path_text(path)}: line {number}: "
        if len(cells) != len(names):
            row = value_text((layout.delimiter or " ").join(cells))
            return InputError(
                f"{where}{row} has {len(cells)} cells, expected {len(names)}; correct or delete the line"
            )
        for name, cell in zip(names, cells, strict=True):
            if not _is_number(cell):
                return InputError(
                    f"{where}{name} is {value_text(cell)}, not a number; correct or delete the line"
                )
            if not math.isfinite(float(cell)):
                return InputError(
                    f"{where}{name} is {value_text(cell)}, not finite; correct or delete the line"
                )
    return None


def _unreadable(path: Path, error: Exception) -> InputError:
    return InputError(f"{path_text(path)}: is no table of numbers ({reason(error)}); export it again as CSV")


def _not_utf8(path: Path) -> InputError:
    with open(path, "rb") as stream:
        for number, line in enumerate(stream, start=1):
            try:
                line.decode()
            except UnicodeDecodeError as error:
                where = f"{path_text(path)}: line {number}: byte 0x{line[error.start]:02x}"
                return InputError(f"{where} is not UTF-8; save the file as UTF-8 text")
    return InputError(f"{path_text(path)}: is not UTF-8; save it as UTF-8 text")


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return cell.isascii() and "_" not in cell  # Python reads more than a file format should


def _number(path: Path, key: str, item: object) -> float:
    number = math.nan
    if isinstance(item, int | float | str) and not isinstance(item, bool):
        try:
            number = float(item)
        except (ValueError, OverflowError):
            number = math.nan
    if not math.isfinite(number):
        raise InputError(
            f"{path_text(path)}: {key} holds {value_text(item)}, not a finite number; correct it"
        )
    return number


def _wrong_shape(path: Path, key: str, value: object, shape: tuple[int, ...]) -> InputError:
    expected = "x".join(map(str, shape)) + " numbers" if shape else "a number"
    return InputError(f"{path_text(path)}: {key} is {value_text(value)}, expected {expected}; correct it")
