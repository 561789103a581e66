"""Tables of numbers in text files, read and written: encodings, delimiters, comments, decimal commas, lines of errors.

Two kinds of table share one reader. Our own formats have their header on the first line and nothing but numbers below; tables
that others export begin with settings, have comment lines, quoted cells and rows without values.
"""

import codecs
import csv
import math
import os
import re
from array import array
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.errors import InputError, RowError
from spinfilters.io.calendar_clock import seconds_of_clock
from spinfilters.io.input_file import (
    MAX_TABLE_BYTES,
    ignored_warnings,
    parse_number,
    path_text,
    printable,
    reason,
    require_file,
    require_text_table,
    value_text,
)
from spinfilters.io.output_files import atomic_file
from spinfilters.io.stated_values import SAMPLING_RATE, NumberRange, to_state

COMMENTS: Final = ("#", "//", "!")
"""Marks of comment lines in tables of others; '%' begins the header of some exports and is dropped there."""
PREAMBLE_LINES: Final = 200
"""Lines before the header, at most: a flight log begins with its settings."""
_DELIMITERS = ",;\t|"
_OWN_DELIMITERS = ",;\t"
_BYTE_ORDER_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_DEGREES = re.compile(r"(?<![a-z])(deg(ree)?s?|dps|degps)(?![a-z])|°(?!\s*[CF])", re.IGNORECASE)
"""Degrees as a whole word: deg/s, deg_s, dps, but neither radps nor degC."""
_LARGEST_ID = 2.0**53  # above it float64 does not distinguish whole numbers
_WRITE_ROWS = 4096  # rows turned into text at a time, which bounds the memory of a writer


class _NumberedLine(NamedTuple):
    """A line with its number in the file, from 1."""

    number: int
    text: str


@dataclass(frozen=True)
class TableLayout:
    """Layout of a text table.

    Attributes
    ----------
    names : tuple[str, ...]
        Of the columns.
    encoding : str
        Of the text.
    header_line : int
        Number of the line of column names, from 1; 0 for a table without one.
    delimiter : str | None
        None for blanks.
    decimal_comma : bool
        Whether the decimal mark is a comma.
    comments : tuple[str, ...]
        Marks of comment lines. Without any the table is strict, as our own formats are: no quotes and no empty cells.
    rate : float | None
        Samples a second, Hz, as the lines above the header say; None where they do not.
    """

    names: tuple[str, ...]
    encoding: str = "utf-8-sig"
    header_line: int = 1
    delimiter: str | None = ","
    decimal_comma: bool = False
    comments: tuple[str, ...] = ()
    rate: float | None = None

    @property
    def comment(self) -> str | None:
        """Mark of a comment behind the cells of a line; None where there are no comments."""
        if not self.comments:
            return None
        return "#" if self.delimiter is None else " #"

    @property
    def quote(self) -> str | None:
        """Mark around cells; None where they have none."""
        return '"' if self.comments and self.delimiter is not None else None

    def content(self, line: str) -> str:
        """A line without its break and its comment; empty where no cells are left."""
        text = line.rstrip("\r\n")
        if self.comment is not None:
            text = "" if text.lstrip().startswith(self.comments) else text.split(self.comment, 1)[0]
            return text if text.strip(" \t;,|") else ""
        return text if text.strip() else ""

    def cells(self, text: str) -> list[str]:
        """Cells of a line's content, without quotes and blanks around them, with points as decimal marks.

        An empty cell behind all columns is left out where the table is not strict.
        """
        cells: list[str] | None = None
        if self.quote is not None and self.quote in text:
            with suppress(csv.Error):  # of a cell beyond all measure
                cells = next(csv.reader([text], delimiter=self.delimiter or " "), [])
        cells = [cell.strip() for cell in (text.split(self.delimiter) if cells is None else cells)]
        if self.delimiter is None and len(cells) > len(self.names) and self.comments:
            cells = re.split(r"\s{2,}|\t", text.strip())  # cells with blanks in them, such as dates
        if self.comments and cells[-1:] == [""] and len(cells) == len(self.names) + 1:
            cells.pop()
        return cells


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
        for index, (number, _) in enumerate(_data_lines(self.path, self.layout)):
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
            raise self.error(
                row, f"{name} is {float(chosen[row, column])!r}; correct or delete the line, give {allowed}"
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
    """Column names in the first line of a table of our own formats (delimited by comma, semicolon or tab).

    Raises
    ------
    InputError
        Not a text table, or a first line of numbers.
    """
    return _own_layout(path).names


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
    layout = _own_layout(path)
    if names is not None and layout.names != tuple(names):
        raise _other_header(path, layout.names, names)
    return _read_rows(path, layout)


def read_blank_separated(path: Path, names: Sequence[str]) -> Table:
    """Table of blank-separated numbers without header, '#' starting a comment. InputError: as `read_csv`."""
    require_text_table(path)
    return _read_rows(path, TableLayout(tuple(names), header_line=0, delimiter=None, comments=("#",)))


def read_layout(path: Path, stated: Sequence[str] = ()) -> TableLayout:
    """Layout of a table that others export, by its header: the first line of words above a line of numbers.

    The lines above it may state the rate of its samples.

    Parameters
    ----------
    path : Path
        The file.
    stated : Sequence[str]
        Names of the columns as the user states them, in place of those of a header; empty for those of the file.

    Raises
    ------
    InputError
        As `require_text_table`; not text; no line of column names.
    """
    require_file(path, MAX_TABLE_BYTES)
    encoding = _encoding(path)
    require_text_table(path, encoding)
    layout = _found_layout(path, stated, encoding)
    return replace(layout, rate=_stated_rate(path, layout))


_RATE_WORDS = re.compile(
    r"(?:(?:update|sample|sampling|output|capture)[ _]?(?:rate|frequency)|(?<![A-Za-z_])FREQUENCY)\W{0,3}(\d{1,6}(?:\.\d{1,9})?)\s*"
    r"(?:Hz|fps)?(?=[,;\s]|$)",
    re.IGNORECASE,
)
_VICON_GROUPS = ("Objects", "Segments", "Trajectories")
"""Lines of a table of Vicon, below which its rate stands alone."""


def _stated_rate(path: Path, layout: TableLayout) -> float | None:
    """Rate in the lines above a header, Hz; None where they state none, or two."""
    rates, before = set(), ""
    with open(path, encoding=layout.encoding) as stream:
        for _ in range(min(layout.header_line, PREAMBLE_LINES)):
            line = stream.readline().strip()
            rates |= {float(each) for each in _RATE_WORDS.findall(line)}
            if before in _VICON_GROUPS and _is_numbers(line) and len(line.split()) == 1:
                rates.add(float(line))
            before = line
    rate = rates.pop() if len(rates) == 1 else 0.0
    return rate if 0.0 < rate <= SAMPLING_RATE.largest else None


def _found_layout(path: Path, stated: Sequence[str], encoding: str) -> TableLayout:
    """Layout of a table in this encoding. InputError: see `read_layout`."""
    # no cell is known before the header is found, so that delimiters alone leave a line empty
    preamble = TableLayout((), encoding, header_line=0, comments=COMMENTS)
    held: list[_NumberedLine] = []
    marked: tuple[int, str] | None = None  # the comment in front of the first numbers may be their header
    for number, raw in _data_lines(path, replace(preamble, comments=())):
        if number > PREAMBLE_LINES:
            break
        if line := preamble.content(raw):
            held.append(_NumberedLine(number, line))
        elif not any(_is_numbers(each) for _, each in held):
            marked = (number, raw.strip().lstrip("#").strip())
    if stated:
        number, line = next((each for each in held if _has_stated(each[1], stated)), (0, ""))
        if not number:
            number, line = next((each for each in held if _is_numbers(each[1])), (0, ""))
        return _stated_layout(path, tuple(stated), number, line, encoding)
    first = next((k for k, (_, line) in enumerate(held) if _is_row(line)), 0)
    if first and (above := _header_above(held[:first], held[first][1])):
        return replace(above, encoding=encoding, comments=COMMENTS)
    for index, (number, line) in enumerate(held):
        found = _header(line, held[index + 1][1] if index + 1 < len(held) else "")
        if found is not None:
            return replace(found, encoding=encoding, header_line=number, comments=COMMENTS)
        if _is_numbers(line):
            found = None if marked is None else _header(marked[1], line)
            if found is not None and marked is not None:
                return replace(found, encoding=encoding, header_line=marked[0], comments=COMMENTS)
            raise _no_header(path, number, line)
    raise InputError(f"{path_text(path)}: has no line of column names; add one, such as time_s,wx,wy,wz")


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


def _own_layout(path: Path) -> TableLayout:
    """Layout of a table of our own formats by its first two lines. InputError: as `read_header`."""
    require_text_table(path)
    try:
        with open(path, encoding="utf-8-sig") as stream:
            first, second = stream.readline(), stream.readline()
    except UnicodeDecodeError as error:
        raise _not_text(path, "utf-8-sig", error) from None
    delimiter = max(_OWN_DELIMITERS, key=first.count)
    try:
        cells = next(csv.reader([first.rstrip("\r\n")], delimiter=delimiter), [])
    except csv.Error as error:
        raise InputError(
            f"{path_text(path)}: line 1: is no header ({error}); give a line of column names"
        ) from None
    names = tuple(cell.strip() for cell in cells)
    if not any(names) or _is_numbers(first):
        raise _no_header(path, 1, first)
    return TableLayout(names, delimiter=delimiter, decimal_comma=_has_decimal_comma(delimiter, second))


def _stated_layout(path: Path, names: tuple[str, ...], number: int, line: str, encoding: str) -> TableLayout:
    """Layout of a table whose columns the user names: all above its first line of numbers is left out."""
    if not number:
        raise InputError(f"{path_text(path)}: has no line of numbers; export or copy it again")
    delimiter = max(_DELIMITERS, key=line.count)
    separator = delimiter if delimiter in line else None
    cells = len(line.split(separator))
    if cells != len(names) + _ends_empty(line, separator):
        raise InputError(
            f"{path_text(path)}: line {number}: has {cells} cells, and the stated columns are {len(names)}; "
            "name every column, with - for those to leave out"
        )
    comma = _has_decimal_comma(separator, line)
    return TableLayout(names, encoding, number - 1, separator, comma, COMMENTS)


def _header(line: str, below: str) -> TableLayout | None:
    """Names, delimiter and decimal mark of a header above numbers; None of another line."""
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
    # settings in front of a header have two cells or no numbers below
    if below and len(below.split(separator)) < min(3, len(names)):
        return None
    return TableLayout(names, delimiter=separator, decimal_comma=_has_decimal_comma(separator, below))


_UNITS: Final = re.compile(
    r"(?:[mun]?s|m?rad|m?deg|[mc]?m|m/s|(?:m?rad|m?deg|d)/s|m?dps|rpm|m?g|m/s\^?2|m/s²)", re.IGNORECASE
)
_LENGTHS: Final = {"meters": "m", "centimeters": "cm", "millimeters": "mm"}
"""Units of length, as motion capture spells them."""


def _header_above(lines: Sequence[_NumberedLine], row: str) -> TableLayout | None:
    """Header above the first row of numbers: the last line of as many cells, joined with a line of units and one of groups.

    Motion capture and wearable sensors export several lines of names: of the body, of the quantity, of the axis, of the unit.

    Parameters
    ----------
    lines : Sequence[_NumberedLine]
        All lines above.
    row : str
        The first row.
    """
    delimiter = max(_DELIMITERS, key=row.count)
    if delimiter not in row:
        return None  # blanks separate the words of any sentence
    width, cells = len(row.split(delimiter)), [_split(line.text, delimiter) for line in lines]
    rows = [each for each in cells if len(each) == width]
    if len(cells[-1]) != width:
        return None
    units = [""] * width
    if len(rows) > 1 and _are_units(rows[-1]):
        units = [_bare_unit(cell) for cell in rows.pop()]
    place = len(rows) - 1
    while place > 0 and len(set(filter(None, rows[place]))) < 3:  # such as types of the columns
        place -= 1
    names = rows[place]
    kinds = next(
        (each for each in rows[:place] if "Type" in each[:2]), None
    )  # Motive, markers of the bodies among them
    if kinds is not None and "Rigid Body" in kinds:
        names = [
            name if kind in ("Rigid Body", "", "Type") else ""
            for name, kind in zip(names, kinds, strict=True)
        ]
    if sum(map(bool, names)) < 3 or not any(each.isalpha() for name in names for each in name):
        return None
    if len(set(filter(None, names))) < sum(map(bool, names)) and place:  # X, Y, Z of several groups
        names = [
            f"{group} {name}".strip() if name else ""
            for group, name in zip(rows[place - 1], names, strict=True)
        ]
        length = _stated_length(lines)
        names = [f"{name} ({length})" if length and name.startswith("Position ") else name for name in names]
    names = [f"{name} ({unit})" if unit else name for name, unit in zip(names, units, strict=True)]
    return TableLayout(
        tuple(names),
        header_line=lines[-1].number,
        delimiter=delimiter,
        decimal_comma=_has_decimal_comma(delimiter, row),
    )


def _split(line: str, delimiter: str) -> list[str]:
    """Cells of a line of words, without quotes; none of a line that is no such line."""
    try:
        return [cell.strip() for cell in next(csv.reader([line.lstrip().lstrip("%")], delimiter=delimiter))]
    except csv.Error:
        return []


def _are_units(cells: Sequence[str]) -> bool:
    """Whether at least half of the cells that hold something are units."""
    held = [_bare_unit(cell) for cell in cells if cell]
    return 2 * sum(_UNITS.fullmatch(cell) is not None for cell in held) >= max(len(held), 1)


def _bare_unit(cell: str) -> str:
    """A unit without brackets."""
    return re.sub(r"[()\[\]]", "", cell)


def _stated_length(lines: Sequence[_NumberedLine]) -> str:
    """Unit behind the words "Length Units" above a header; empty without them."""
    for _, line in lines:
        cells = _split(line, ",")
        if "Length Units" in cells[:-1]:
            return _LENGTHS.get(cells[cells.index("Length Units") + 1].lower(), "")
    return ""


def _is_row(line: str) -> bool:
    """Whether a line is a row of at least three numbers whose first cell is one, or is a date."""
    cells = _split(line, max(_DELIMITERS, key=line.count))
    if cells and seconds_of_clock(cells[0]) is not None:
        return sum(map(_is_numbers, cells[1:])) >= 3
    return (
        _is_numbers(line)
        and line.lstrip(" ")[:1] not in _DELIMITERS
        and len(re.split(r"[\s,;|]+", line.strip())) >= 3
    )


def _has_stated(line: str, names: Sequence[str]) -> bool:
    """Whether a line has as many cells as columns are stated, with a number in each that is not left out."""
    delimiter = max(_DELIMITERS, key=line.count)
    cells = _split(line, delimiter) if delimiter in line else line.split()
    chosen = [cell for cell, name in zip(cells, names, strict=False) if name != "-"]
    return (
        len(cells) == len(names) + _ends_empty(line, delimiter)
        and bool(chosen)
        and all(map(_is_numbers, chosen))
    )


def _ends_empty(line: str, delimiter: str | None) -> bool:
    """Whether the last cell of a line is empty, as behind a delimiter at its end."""
    return delimiter is not None and line.rstrip(" \r\n").endswith(delimiter)


def _has_decimal_comma(delimiter: str | None, line: str) -> bool:
    """Whether the numbers of a line have a comma as decimal mark."""
    return delimiter != "," and "," in line and "." not in line


def _is_numbers(line: str) -> bool:
    """Whether a line holds numbers and no more."""
    cells = re.sub("[;,|]", " ", line).split()
    try:
        for cell in cells:
            float(cell)
    except ValueError:
        return False
    return bool(cells)


def _no_header(path: Path, number: int, line: str) -> InputError:
    return InputError(
        f"{path_text(path)}: line {number}: {value_text(line.strip())} is no header; add a line of column names, "
        f"or give {to_state('columns', 't,x,y,z')}"
    )


def _other_header(path: Path, found: Sequence[str], expected: Sequence[str]) -> InputError:
    """InputError for columns of other names; those in degrees, a common mistake, are named."""
    degrees = next((name for name in found if _DEGREES.search(name)), None)
    if degrees is not None:
        return InputError(
            f"{path_text(path)}: line 1: column {value_text(degrees)} is in degrees; multiply it by pi/180 and name it rad/s"
        )
    missing = [name for name in expected if name not in found]
    if set(found) < set(expected):
        cure = f"add the missing {'columns' if len(missing) > 1 else 'column'} {', '.join(missing)}"
    elif missing:
        cure = "rename the columns and convert their units"
    else:
        cure = "leave out other columns" if len(found) > len(expected) else "reorder the columns"
    return InputError(
        f"{path_text(path)}: line 1: the header is {value_text(','.join(found))}, expected '{','.join(expected)}'; {cure}"
    )


def _read_rows(path: Path, layout: TableLayout, columns: Sequence[int] | None = None, keys: int = 0) -> Table:
    """Numbers of some columns, or of all: at once where the table is regular, else line by line."""
    names = layout.names if columns is None else tuple(layout.names[k] for k in columns)
    try:
        values = _load(path, layout, columns)
    except UnicodeError as error:
        raise _not_text(path, layout.encoding, error) from None
    except (ValueError, OverflowError):
        values = None
    if values is None or values.shape[1] != len(names) or not np.isfinite(values).all():
        return _read_each_line(path, layout, columns, keys)
    return Table(path, layout, names, values)


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
            raise ValueError(
                "this row must be read alone"
            )  # NumPy counts no cells behind those that it takes
        yield text.replace(",", ".") if layout.decimal_comma else text


def _read_each_line(path: Path, layout: TableLayout, columns: Sequence[int] | None, keys: int) -> Table:
    """Numbers of some columns, line by line. InputError: names the first line that is wrong."""
    indices = range(len(layout.names)) if columns is None else columns
    names = tuple(layout.names[k] for k in indices)
    lines, numbers, incomplete, is_dated = array("q"), array("d"), 0, False
    for number, text in _data_lines(path, layout):
        where = f"{path_text(path)}: line {number}: "
        cells = layout.cells(text)
        if len(cells) != len(layout.names):
            raise InputError(
                f"{where}{value_text(text.strip())} has {len(cells)} cells, expected {len(layout.names)}; "
                "correct or delete the line"
            )
        chosen = [cells[k] for k in indices]
        if layout.comments and not any(chosen[keys:]):
            incomplete += 1
            continue
        if keys and not lines:  # the first row says how all times are written
            is_dated = seconds_of_clock(chosen[0]) is not None
        if is_dated:
            numbers.append(_seconds(where, names[0], chosen[0]))
        behind = zip(names[is_dated:], chosen[is_dated:], strict=True)
        numbers.extend([_number(where, name, cell, layout) for name, cell in behind])
        lines.append(number)
    if not lines:
        raise InputError(f"{path_text(path)}: has no rows of numbers; export or copy it again")
    values = np.frombuffer(numbers, dtype=np.float64).reshape(len(lines), len(names)).copy()
    return Table(path, layout, names, values, lines, incomplete, is_dated=is_dated)


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


def _data_lines(path: Path, layout: TableLayout) -> Iterator[tuple[int, str]]:
    """Numbers and contents of the lines below the header that have cells. InputError: bytes of another encoding."""
    try:
        with open(path, encoding=layout.encoding) as stream:
            for number, line in enumerate(stream, start=1):
                if number > layout.header_line and (text := layout.content(line)):
                    yield number, text
    except UnicodeError as error:
        raise _not_text(path, layout.encoding, error) from None
    except OSError as error:
        raise InputError(f"{path_text(path)}: cannot be read ({reason(error)}); copy it again") from None


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


def _not_text(path: Path, encoding: str, error: UnicodeError) -> InputError:
    """InputError for the first byte that is not of the encoding."""
    if not encoding.startswith("utf-8"):
        return InputError(f"{path_text(path)}: is not UTF-16 ({reason(error)}); save it as UTF-8 text")
    with open(path, "rb") as stream:
        for number, line in enumerate(stream, start=1):
            try:
                line.decode("utf-8")
            except UnicodeDecodeError as bad:
                where = f"{path_text(path)}: line {number}: byte 0x{line[bad.start]:02x}"
                return InputError(f"{where} is not UTF-8; save the file as UTF-8 text")
    return InputError(f"{path_text(path)}: is not UTF-8; save it as UTF-8 text")


def write_csv(path: Path, names: Sequence[str], columns: Sequence[np.ndarray]) -> None:
    """Write columns of equal length, comma separated, so that reading gives the same bits. Atomic."""
    with atomic_file(path) as stream:
        stream.write((",".join(names) + "\n").encode())
        for start in range(0, len(columns[0]), _WRITE_ROWS):
            lists = [column[start : start + _WRITE_ROWS].tolist() for column in columns]
            lines = [",".join(map(repr, row)) + "\n" for row in zip(*lists, strict=True)]
            stream.write("".join(lines).encode())
