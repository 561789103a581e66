"""Numbers of tables in text files, read and written: cells, rows without values, lines of errors.

A regular table is read at once by NumPy, any other line by line. What a table looks like says its layout
(`spinfilters.io.table_layout`).
"""

import itertools
import math
import os
import re
from array import array
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.errors import InputError, RowError
from spinfilters.io.calendar_clock import seconds_of_clock
from spinfilters.io.input_file import (
    ignored_warnings,
    is_number,
    parse_number,
    path_text,
    printable,
    require_text_table,
    value_text,
)
from spinfilters.io.output_files import atomic_file
from spinfilters.io.stated_values import NumberRange, to_state
from spinfilters.io.table_layout import TableLayout, data_lines, not_text, other_header, own_layout

_LARGEST_ID = 2.0**53  # above it float64 does not distinguish whole numbers
WRITE_ROWS = 4096  # rows turned into text at a time, which bounds the memory of a writer


@dataclass(frozen=True, eq=False)
class Table:
    """Finite numbers of the columns of a table, one row per line that has them.

    Attributes
    ----------
    path : Path
        The file.
    layout : TableLayout
        Of the file.
    names : tuple[str, ...]
        Of the columns that are read.
    values : Float[np.ndarray, 'n m']
        Of the rows.
    lines : Sequence[int] | None
        Numbers of their lines in the file, from 1; None where no row is left out, so that a second walk finds them.
    incomplete : int
        Rows left out because every column but the key columns was empty.
    counted : str
        What a row is called in messages: a line of a text, a row of arrays.
    is_dated : bool
        Whether its first column was written as dates or times of the day, and is in s.
    """

    path: Path
    layout: TableLayout
    names: tuple[str, ...]
    values: Float[np.ndarray, "n m"]
    lines: Sequence[int] | None = None
    incomplete: int = 0
    counted: str = "line"
    is_dated: bool = False

    def line(self, row: int) -> int:
        """Line number (from 1) of a row (from 0), for error messages."""
        if self.lines is not None:
            return self.lines[row]
        for index, (number, _) in enumerate(data_lines(self.path, self.layout)):
            if index == row:
                return number
        raise IndexError(f"{path_text(self.path)} has no row {row}")

    def error(self, row: int, text: str) -> InputError:
        """An InputError that names the file and the line of the row."""
        return InputError(f"{path_text(self.path)}: {self.counted} {self.line(row)}: {text}")

    @contextmanager
    def naming_lines(self) -> Iterator[None]:
        """Within it a `RowError` becomes an InputError that names the file and the line of the row."""
        try:
            yield
        except RowError as error:
            raise self.error(error.row, error.text) from None

    def require(self, columns: slice, allowed: NumberRange) -> None:
        """Require all numbers of the columns to be in range.

        Raises
        ------
        InputError
            One that is not, with its line, its column and the range.
        """
        chosen = self.values[:, columns]
        outside = np.argwhere((chosen < allowed.smallest) | (chosen > allowed.largest))
        if outside.size:
            row, column = map(int, outside[0])
            name = value_text(self.names[columns][column])
            value = float(chosen[row, column])
            raise self.error(row, f"{name} is {value!r}, not {allowed}; correct or delete the {self.counted}")

    def landmark_ids(self, column: int) -> Int[np.ndarray, " n"]:
        """Landmark ids of a column. InputError: one that is no whole number."""
        ids = self.values[:, column]
        bad = np.flatnonzero((ids != np.round(ids)) | (np.abs(ids) > _LARGEST_ID))
        if bad.size:
            raise self.error(
                int(bad[0]), f"landmark_id {float(ids[bad[0]])!r} is not a whole number; renumber it"
            )
        return ids.astype(np.int64)


def read_csv(path: Path, names: Sequence[str] | None = None) -> Table:
    """Table of our own formats: a header line, cells delimited by comma, semicolon or tab (then also with decimal commas).

    Parameters
    ----------
    path : Path
        The file.
    names : Sequence[str] | None
        The exact column names that the file must have, or None for any.

    Raises
    ------
    InputError
        Missing, binary, empty or too large a file, another header, no rows, a line with another number of cells,
        a cell that is not a finite number.
    """
    layout = own_layout(path)
    if names is not None and layout.names != tuple(names):
        raise other_header(path, layout.names, names)
    return _read_rows(path, layout)


def read_blank_separated(path: Path, names: Sequence[str]) -> Table:
    """Table of blank-separated numbers without header, '#' starting a comment. InputError: as `read_csv`."""
    require_text_table(path)
    return _read_rows(path, TableLayout(tuple(names), header_line=0, delimiter=None, comments=("#",)))


def read_columns(path: Path, layout: TableLayout, columns: Sequence[int], keys: int = 0) -> Table:
    """Numbers of some columns of a table that others export.

    Parameters
    ----------
    path : Path
        The file.
    layout : TableLayout
        See `read_layout`.
    columns : Sequence[int]
        Indices.
    keys : int
        How many of the first of them stand in every row; a row whose others are all empty is left out.

    Raises
    ------
    InputError
        No rows, a row without one of the columns, a cell that is not a finite number.
    """
    return _read_rows(path, layout, columns, keys)


def _read_rows(path: Path, layout: TableLayout, columns: Sequence[int] | None = None, keys: int = 0) -> Table:
    """Numbers of some columns, or of all: at once where the table is regular, else line by line."""
    names = layout.names if columns is None else tuple(layout.names[k] for k in columns)
    try:
        values = _load(path, layout, columns)
    except UnicodeError as error:
        raise not_text(path, layout.encoding, error) from None
    except (ValueError, OverflowError):
        values = None
    if values is None or values.shape[1] != len(names) or not np.isfinite(values).all():
        return _read_each_line(path, layout, columns, keys)
    if len(values) > 1 and layout.comments and _is_cut(path, layout):
        values = values[:-1]
    return Table(path, layout, names, values)


_TAIL: Final = 1 << 14
"""Bytes at the end of a file that show whether its last line is whole."""


def last_lines(path: Path, encoding: str) -> list[str]:
    """The last lines of a file without a line break behind the last; none of a file that ends with one."""
    with open(path, "rb") as stream:
        size = stream.seek(0, os.SEEK_END)
        stream.seek(max(size - _TAIL, 0) // 2 * 2)
        tail = stream.read()
    if any(mark in tail[-2:] for mark in (b"\n", b"\r")):
        return []
    return tail.decode(encoding.replace("-sig", ""), "replace").splitlines()


def _is_cut(path: Path, layout: TableLayout) -> bool:
    """Whether the last number of a table, without a line break behind it, has fewer digits than that above it."""
    lines = [text for line in last_lines(path, layout.encoding) if (text := layout.content(line))]
    *before, last = [layout.cells(line)[-1] for line in lines] or [""]
    return looks_cut(
        next(filter(None, reversed(before)), ""), last
    )  # an incomplete row says nothing of digits


def looks_cut(above: str, last: str) -> bool:
    """Whether the last number of a file without a line break at its end has fewer digits than the one above it."""
    return len(above) - len(last) > 1 and any(mark in above for mark in ".,")


def _load(path: Path, layout: TableLayout, columns: Sequence[int] | None) -> Float[np.ndarray, "n m"] | None:
    """Numbers of a table that NumPy reads; None of an empty one. ValueError: a row that must be read alone."""
    with open(path, encoding=layout.encoding) as stream, ignored_warnings(UserWarning):  # "no data"
        for _ in range(layout.header_line):
            stream.readline()
        lines = stream if columns is None and not layout.decimal_comma else _regular_lines(stream, layout)
        values = np.loadtxt(
            lines,
            delimiter=layout.delimiter,
            comments=layout.comment if lines is stream else None,
            quotechar=layout.quote,
            usecols=columns,
            ndmin=2,
        )
    return values if values.size else None


def _regular_lines(lines: Iterator[str], layout: TableLayout) -> Iterator[str]:
    """Lines of numbers with points as decimal marks. ValueError: one with more or fewer cells than columns."""
    delimiter, width, is_strict = layout.delimiter, len(layout.names) - 1, not layout.comments
    for line in lines:
        text = layout.content(line)
        if not text:
            continue
        if not is_strict and (delimiter is None or text.count(delimiter) != width):
            raise ValueError("this row must be read alone")  # NumPy counts no cells after those that it takes
        yield text.replace(",", ".") if layout.decimal_comma else text


def _read_each_line(path: Path, layout: TableLayout, columns: Sequence[int] | None, keys: int) -> Table:
    """Numbers of some columns, line by line. InputError: names the first line that is wrong.

    A header that stands again between the rows, words below the last of them and a last line that is cut off are left out.
    """
    indices = range(len(layout.names)) if columns is None else columns
    names = tuple(layout.names[k] for k in indices)
    lines, numbers, incomplete, is_dated, number = array("q"), array("d"), 0, False, 0
    odd: list[tuple[str, InputError]] = []
    for number, text in data_lines(path, layout):
        where = f"{path_text(path)}: line {number}: "
        cells = layout.cells(text)
        try:
            if len(cells) != len(layout.names):
                raise InputError(
                    f"{where}{value_text(text.strip())} has {len(cells)} cells, expected {len(layout.names)}; "
                    "correct or delete the line"
                )
            chosen = [cells[k] for k in indices]
            if layout.comments and len(chosen) > keys and not any(chosen[keys:]):
                incomplete += 1
                continue
            if keys and not lines:  # the first row says how all times are written
                is_dated = seconds_of_clock(chosen[0]) is not None
            row = [_seconds(where, names[0], chosen[0])] if is_dated else []
            behind = zip(names[is_dated:], chosen[is_dated:], strict=True)
            row += [_number(where, name, cell, layout) for name, cell in behind]
        except InputError as error:
            if not layout.comments or not lines:
                raise
            if text.strip() != _header_text(path, layout):
                odd.append((text, error))
            continue
        if odd:
            raise odd[0][1]
        numbers.extend(row)
        lines.append(number)
    if odd and not _are_below_a_table(path, layout, [text for text, _ in odd]):
        raise odd[0][1]
    if not lines:
        raise InputError(f"{path_text(path)}: has no rows of numbers; export or copy it again")
    if layout.comments and len(lines) > 1 and lines[-1] == number and _is_cut(path, layout):
        lines.pop()
        del numbers[-len(names) :]
    values = np.frombuffer(numbers, dtype=np.float64).reshape(len(lines), len(names)).copy()
    return Table(path, layout, names, values, lines, incomplete, is_dated=is_dated)


def _header_text(path: Path, layout: TableLayout) -> str:
    """The header as it is written, without a mark of a comment; empty without one."""
    if not layout.header_line:
        return ""
    with open(path, encoding=layout.encoding) as stream:
        line = next(itertools.islice(stream, layout.header_line - 1, None), "")
    return line.strip().lstrip("#%").strip()


_BEGUN: Final = re.compile(r"[-+]?(?:\d+[.,]?\d*)?(?:[eEdD][-+]?)?")
"""A number that is cut off."""


_MOST_BELOW: Final = 50
"""Lines of words below the last row."""


def _are_below_a_table(path: Path, layout: TableLayout, texts: Sequence[str]) -> bool:
    """Whether lines behind the last row are words, or the one line that was being written when the power went."""
    if len(texts) == 1 and last_lines(path, layout.encoding)[-1:] == texts:
        cells = layout.cells(texts[0])
        if len(cells) < len(layout.names) or (_BEGUN.fullmatch(cells[-1]) and not is_number(cells[-1])):
            return True
    are_words = all(text.lstrip(' \t"[(<*')[:1].isalpha() for text in texts)
    return (
        are_words
        and len(texts) <= _MOST_BELOW
        and not any(text.lower().startswith(("nan", "inf")) for text in texts)
    )


def _seconds(where: str, name: str, cell: str) -> float:
    """Seconds of a cell among dates. InputError: it is none, with its line and column."""
    seconds = seconds_of_clock(cell)
    if seconds is None:
        raise InputError(
            f"{where}{printable(name[:60])} is {value_text(cell)}, no date or time of the day as in the line above; correct or "
            "delete the line"
        )
    return seconds


def _number(where: str, name: str, cell: str, layout: TableLayout) -> float:
    """Finite number of a cell. InputError: another cell, with its line and column."""
    try:
        value = parse_number(cell.replace(",", ".") if layout.decimal_comma else cell)
    except ValueError:
        value = None
    if value is None or not math.isfinite(value):
        fault = "not a number" if value is None else "not finite"
        cure = (
            f"give seconds, or {to_state('rate', 'HZ')}"
            if cell.count(":") > 1
            else "correct or delete the line"
        )
        raise InputError(f"{where}{printable(name[:60])} is {value_text(cell)}, {fault}; {cure}")
    return value


def write_csv(path: Path, names: Sequence[str], columns: Sequence[np.ndarray]) -> None:
    """Write columns of equal length, comma separated, so that reading gives the same bits. Atomic."""
    with atomic_file(path) as stream:
        stream.write((",".join(names) + "\n").encode())
        for start in range(0, len(columns[0]), WRITE_ROWS):
            lists = [column[start : start + WRITE_ROWS].tolist() for column in columns]
            lines = [",".join(map(repr, row)) + "\n" for row in zip(*lists, strict=True)]
            stream.write("".join(lines).encode())
