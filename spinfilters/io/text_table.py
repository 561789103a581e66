"""Tables of numbers in text files, read and written: encodings, delimiters, comments, decimal commas, lines of errors."""

import codecs
import csv
import math
import os
from array import array
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.errors import InputError
from spinfilters.io.input_file import (
    MAX_LINE_BYTES,
    MAX_TABLE_BYTES,
    MAX_TABLE_ROWS,
    ignored_warnings,
    path_text,
    printable,
    reason,
    require_file,
    require_text_table,
    value_text,
)
from spinfilters.io.output_files import atomic_file
from spinfilters.io.stated_values import NumberRange

COMMENTS: Final = ("#", "//", "!")
"""Marks of a line that is a comment; '%' begins the header of some exports and is dropped there."""
PREAMBLE_LINES: Final = 200
"""Lines before the header, at most: a flight log tells its settings first."""
_DELIMITERS = ",;\t|"
_BYTE_ORDER_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)


@dataclass(frozen=True)
class TextLayout:
    """Layout of a text table.

    Attributes
    ----------
    encoding : str
        Of the text.
    header_line : int
        Number of the line of column names, from 1.
    delimiter : str | None
        None for blanks.
    decimal_comma : bool
        Whether the decimal mark is a comma.
    names : tuple[str, ...]
        Of the columns.
    """

    encoding: str
    header_line: int
    delimiter: str | None
    decimal_comma: bool
    names: tuple[str, ...]

    def cells(self, line: str) -> list[str]:
        """Cells of a line, without quotes and blanks around them."""
        if '"' in line and self.delimiter is not None:
            with suppress(csv.Error):  # of a cell beyond all measure
                return [cell.strip() for cell in next(csv.reader([line], delimiter=self.delimiter), [])]
        return [cell.strip() for cell in line.split(self.delimiter)]


@dataclass(frozen=True, eq=False)
class TextTable:
    """Finite numbers of some columns of a table.

    Attributes
    ----------
    values : Float[np.ndarray, 'n m']
        Of the rows that have them.
    lines : Sequence[int]
        Of the file, from 1, on which they stand.
    incomplete : int
        Rows left out because every chosen column but the first ones was empty.
    """

    path: Path
    names: tuple[str, ...]
    values: Float[np.ndarray, "n m"]
    lines: Sequence[int]
    incomplete: int

    def error(self, row: int, text: str) -> InputError:
        """An InputError that names the file and the line of the row."""
        return InputError(f"{path_text(self.path)}: line {self.lines[row]}: {text}")


def read_layout(path: Path) -> TextLayout:
    """Layout of a table by its header.

    That is its first line with letters behind comments, settings and blank lines.

    Raises
    ------
    InputError
        As `require_file`; not text; no line of column names.
    """
    require_file(path, MAX_TABLE_BYTES)
    encoding = _encoding(path)
    held: list[tuple[int, str]] = []
    for number, line in _lines(path, encoding):
        if number > PREAMBLE_LINES:
            break
        if line.strip():
            held.append((number, line))
    for index, (number, line) in enumerate(held):
        found = _header(line, held[index + 1][1] if index + 1 < len(held) else "")
        if found is not None:
            return TextLayout(encoding, number, *found)
        if _is_numbers(line):
            raise InputError(
                f"{path_text(path)}: line {number}: {value_text(line.strip())} is no header; add a line of column names"
            )
    raise InputError(f"{path_text(path)}: has no line of column names; add one, such as time_s,wx,wy,wz")


def read_columns(path: Path, layout: TextLayout, columns: Sequence[int], keys: int = 0) -> TextTable:
    """Numbers of some columns.

    Parameters
    ----------
    columns : Sequence[int]
        Indices.
    keys : int
        How many of the first of them stand in every row; a row whose others are all empty is left out.

    Raises
    ------
    InputError
        No rows, a row without one of the columns, a cell that is not a finite number, a table that is too large.
    """
    names = tuple(layout.names[k] for k in columns)
    fast = _plain_columns(path, layout, columns)
    if fast is not None:
        return TextTable(path, names, *fast, 0)
    lines, incomplete, numbers = array("q"), 0, array("d")
    for number, line in _data_lines(path, layout):
        where = f"{path_text(path)}: line {number}: "
        cells = _whole_row(where, line, layout)
        chosen = [cells[k] for k in columns]
        if not any(chosen[keys:]):
            incomplete += 1
            continue
        numbers.extend([_number(where, name, cell, layout) for name, cell in zip(names, chosen, strict=True)])
        lines.append(number)
        if len(lines) > MAX_TABLE_ROWS:
            raise InputError(
                f"{path_text(path)}: has more than {MAX_TABLE_ROWS} rows; cut it into smaller files"
            )
    if not lines:
        raise InputError(f"{path_text(path)}: has no rows of numbers; export or copy it again")
    values = np.frombuffer(numbers, dtype=np.float64).reshape(len(lines), len(columns)).copy()
    return TextTable(path, names, values, lines, incomplete)


def _whole_row(where: str, line: str, layout: TextLayout) -> list[str]:
    """Cells of a line, one per column, but an empty last one."""
    cells = layout.cells(line)
    if cells[-1:] == [""] and len(cells) == len(layout.names) + 1:
        cells.pop()
    if len(cells) != len(layout.names):
        raise InputError(
            f"{where}{value_text(line.strip())} has {len(cells)} cells, expected {len(layout.names)}; "
            "correct or delete the line"
        )
    return cells


def _plain_columns(
    path: Path, layout: TextLayout, columns: Sequence[int]
) -> tuple[Float[np.ndarray, "n m"], Sequence[int]] | None:
    """Numbers and line numbers of a table of complete rows, else None."""
    delimiter = layout.delimiter
    if delimiter is None:
        return None
    lines, width = array("q"), len(layout.names) - 1

    def texts() -> Iterator[str]:
        """Lines of numbers."""
        for number, line in _data_lines(path, layout):
            lines.append(number)
            if line.count(delimiter) != width or len(lines) > MAX_TABLE_ROWS:
                raise ValueError("a row that is looked at alone")
            yield line.replace(",", ".") if layout.decimal_comma else line

    try:
        with ignored_warnings(UserWarning):  # "no data": the caller says so
            values = np.loadtxt(
                texts(), delimiter=delimiter, usecols=columns, ndmin=2, comments=None, quotechar='"'
            )
    except (ValueError, OverflowError):
        return None
    return (
        (values, lines) if values.size and len(values) == len(lines) and np.isfinite(values).all() else None
    )


def _number(where: str, name: str, cell: str, layout: TextLayout) -> float:
    text = cell.replace(",", ".") if layout.decimal_comma else cell
    try:
        value = float(text) if text.isascii() and "_" not in text else None
    except ValueError:
        value = None
    if value is None or not math.isfinite(value):
        fault = "not a number" if value is None else "not finite"
        cure = "give seconds, or --rate HZ" if cell.count(":") > 1 else "correct or delete the line"
        raise InputError(f"{where}{printable(name[:60])} is {value_text(cell)}, {fault}; {cure}")
    return value


def _data_lines(path: Path, layout: TextLayout) -> Iterator[tuple[int, str]]:
    for number, line in _lines(path, layout.encoding):
        if number > layout.header_line and line.strip(" \t\r\n;,|"):
            yield number, line


def _lines(path: Path, encoding: str) -> Iterator[tuple[int, str]]:
    """Numbered lines without comments. InputError: bytes of another encoding, endless lines."""
    number = 0
    try:
        with open(path, encoding=encoding, newline=None) as stream:
            while line := stream.readline(MAX_LINE_BYTES):
                number += 1
                if "\0" in line:
                    raise InputError(
                        f"{path_text(path)}: line {number}: holds NUL bytes, so it is not UTF-8 text; export it so"
                    )
                if len(line) >= MAX_LINE_BYTES:
                    raise InputError(
                        f"{path_text(path)}: has a line of more than {MAX_LINE_BYTES} bytes; give a table of numbers"
                    )
                text = line.rstrip("\r\n")
                yield number, "" if text.lstrip().startswith(COMMENTS) else text.split(" #", 1)[0]
    except UnicodeError as error:
        raise _not_text(path, encoding, number, error) from None
    except OSError as error:
        raise InputError(f"{path_text(path)}: cannot be read ({reason(error)}); copy it again") from None


def _not_text(path: Path, encoding: str, number: int, error: UnicodeError) -> InputError:
    """InputError for the first byte that is not of the encoding."""
    if not encoding.startswith("utf-8"):
        return InputError(
            f"{path_text(path)}: line {number + 1}: is not UTF-16 ({reason(error)}); save it as UTF-8 text"
        )
    with open(path, "rb") as stream:
        for index, line in enumerate(stream, start=1):
            try:
                line.decode("utf-8")
            except UnicodeDecodeError as bad:
                where = f"{path_text(path)}: line {index}: byte 0x{line[bad.start]:02x}"
                return InputError(f"{where} is not UTF-8; save the file as UTF-8 text")
    return InputError(f"{path_text(path)}: is not UTF-8; save it as UTF-8 text")


def _encoding(path: Path) -> str:
    """Encoding by byte order mark, UTF-16 without one by NUL bytes, else UTF-8."""
    try:
        with open(path, "rb") as stream:
            head = stream.read(64)
    except OSError as error:
        raise InputError(f"{path_text(path)}: cannot be read ({reason(error)}); copy it again") from None
    for mark, encoding in _BYTE_ORDER_MARKS:
        if head.startswith(mark):
            return encoding
    if len(head) >= 8 and os.path.getsize(path) % 2 == 0:
        for start, encoding in ((1, "utf-16-le"), (0, "utf-16-be")):
            if not any(head[start::2]) and all(head[1 - start :: 2]):
                return encoding
    return "utf-8"


def _header(line: str, below: str) -> tuple[str | None, bool, tuple[str, ...]] | None:
    """Delimiter, decimal comma and names of a header above numbers, or None."""
    text = line.strip().lstrip("%").strip()
    delimiter = max(_DELIMITERS, key=text.count)
    separator = delimiter if delimiter in text else None
    try:
        cells = next(csv.reader([text], delimiter=separator)) if separator else text.split()
    except csv.Error:
        return None
    names = tuple(cell.strip().strip('"').strip() for cell in cells)
    if len(names) < 3 or _is_numbers(line) or not any(character.isalpha() for character in text):
        return None
    decimal_comma = separator != "," and "," in below and "." not in below
    count = len(below.split(separator))
    # settings in front of a header have two cells or no numbers below
    return (separator, decimal_comma, names) if not below or count >= min(3, len(names)) else None


def _is_numbers(line: str) -> bool:
    """Whether a line holds numbers and no more."""
    cells = [cell.strip() for cell in line.replace(";", ",").replace("\t", ",").replace(" ", ",").split(",")]
    filled = [cell for cell in cells if cell]
    try:
        for cell in filled:
            float(cell)
    except ValueError:
        return False
    return bool(filled)


_WRITE_ROWS = 4096  # rows turned into text at a time, which bounds the memory of a writer


@dataclass(frozen=True)
class TableFormat:
    """Format of a table: delimiter (None for blanks), comment mark, header line, and whether decimals have a comma."""

    delimiter: str | None
    comment: str | None = None
    header: bool = True
    decimal_comma: bool = False

    def cells(self, line: str) -> list[str]:
        """Cells of one line as text; empty for a line that is blank or only a comment."""
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
    """Finite numbers of a file with column names, one row per line that is neither blank nor a comment."""

    path: Path
    names: tuple[str, ...]
    values: Float[np.ndarray, "n m"]
    layout: TableFormat

    def line(self, row: int) -> int:
        """Line number (from 1) of a row (from 0), for error messages."""
        for index, (number, _) in enumerate(_table_files_data_lines(self.path, self.layout)):
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
    InputError
        Not a text table, or a first line of numbers.
    """
    require_text_table(path)
    return _table_files_header(path)[0]


def read_csv(path: Path, names: Sequence[str] | None = None) -> Table:
    """Table with a header line, delimited by comma, semicolon or tab (then also with decimal commas).

    Parameters
    ----------
    names : Sequence[str] | None
        The exact column names that the file must have, or None for any.

    Raises
    ------
    InputError
        Missing, binary, empty or too large a file, another header, no rows, a line with another number of cells,
        a cell that is not a finite number.
    """
    require_text_table(path)
    found, layout = _table_files_header(path)
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
    """Finite numbers of a key as an array of this shape; text such as '1e-3', which YAML reads as text, is accepted.

    Raises
    ------
    InputError
        Another shape, a cell that is no finite number; the text names the file, the key and the value.
    """
    items = value if isinstance(value, list) else [value]
    if len(shape) == 2:
        if len(items) != shape[0]:
            raise _wrong_shape(path, key, value, shape)
        rows = [numbers(path, key, row, shape[1:]) for row in items]
        return np.array(rows)
    if (len(items),) != (shape or (1,)) or (isinstance(value, list) != bool(shape)):
        raise _wrong_shape(path, key, value, shape)
    return np.array([_table_files_number(path, key, item) for item in items]).reshape(shape)


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


def _table_files_header(path: Path) -> tuple[tuple[str, ...], TableFormat]:
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


def _table_files_data_lines(path: Path, layout: TableFormat) -> Iterator[tuple[int, list[str]]]:
    with open(path, encoding="utf-8-sig", errors="surrogateescape") as stream:
        for number, line in enumerate(stream, start=1):
            if number == 1 and layout.header:
                continue
            if cells := layout.cells(line):
                yield number, cells


def _first_bad_line(path: Path, names: tuple[str, ...], layout: TableFormat) -> InputError | None:
    for number, cells in _table_files_data_lines(path, layout):
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


def _table_files_number(path: Path, key: str, item: object) -> float:
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
