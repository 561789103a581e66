"""Layout of tables of numbers in text files, by their headers: encoding, delimiter, decimal mark, names of the columns.

Two kinds of table share one record. Our own formats have their header on the first line and nothing but numbers below; tables
that others export begin with settings, have comment lines, quoted cells and several lines of names.
"""

import codecs
import csv
import itertools
import math
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, NamedTuple

from spinfilters.core.errors import InputError
from spinfilters.io.calendar_clock import seconds_of_clock
from spinfilters.io.headings import parts_of
from spinfilters.io.input_file import (
    MAX_TABLE_BYTES,
    is_number,
    path_text,
    reason,
    require_file,
    require_text_table,
    value_text,
)
from spinfilters.io.stated_values import SAMPLING_RATE, to_state
from spinfilters.io.unnamed_columns import first_rows, how_to_name, numbers_of_lines, proved_columns

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


_RULE = re.compile(r"\s*(?=.*(?:---|===))[-=+|:\s]+")
"""A line drawn below a header."""
_WIDE_BLANKS = re.compile(r"\s{2,}|\t")
"""Between cells that have single blanks in them."""


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
    cell_units : tuple[str, ...]
        Unit behind the number in each cell of a column, empty of columns without one; no units at all in most tables.
    """

    names: tuple[str, ...]
    encoding: str = "utf-8-sig"
    header_line: int = 1
    delimiter: str | None = ","
    decimal_comma: bool = False
    comments: tuple[str, ...] = ()
    rate: float | None = None
    cell_units: tuple[str, ...] = ()

    @property
    def comment(self) -> str | None:
        """Mark of a comment after the cells of a line; None where there are no comments."""
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
            is_left_out = text.lstrip().startswith(self.comments) or _RULE.fullmatch(text)
            text = "" if is_left_out else self._without_comment(text)
            return text if text.strip(" \t;,|") else ""
        return text if text.strip() else ""

    def _without_comment(self, text: str) -> str:
        """A line in front of its comment; a mark within quotes begins none."""
        front = text.split(self.comment, 1)[0]
        return text if self.quote is not None and front.count(self.quote) % 2 else front

    def cells(self, text: str) -> list[str]:
        """Cells of a line's content, without quotes and blanks around them, with points as decimal marks.

        An empty cell after all columns is left out where the table is not strict.
        """
        cells: list[str] | None = None
        if self.quote is not None and self.quote in text:
            with suppress(csv.Error):  # of a cell beyond all measure
                cells = next(csv.reader([text], delimiter=self.delimiter or " "), [])
        cells = [cell.strip() for cell in (text.split(self.delimiter) if cells is None else cells)]
        if self.delimiter is None and len(cells) > len(self.names) and self.comments:
            cells = _WIDE_BLANKS.split(text.strip())  # cells with blanks in them, such as dates
        if self.comments and cells[-1:] == [""] and len(cells) == len(self.names) + 1:
            cells.pop()
        if self.cell_units and len(cells) == len(self.cell_units):
            cells = [
                cell.removesuffix(f" {unit}").rstrip() if unit else cell
                for cell, unit in zip(cells, self.cell_units, strict=True)
            ]
        return cells


def read_header(path: Path) -> tuple[str, ...]:
    """Column names in the first line of a table of our own formats (delimited by comma, semicolon or tab).

    Raises
    ------
    InputError
        Not a text table, or a first line of numbers.
    """
    return own_layout(path).names


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
    layout = replace(layout, names=_with_unit_of_counts(path, layout), rate=_stated_rate(path, layout))
    layout = _with_cell_units(path, layout)
    return layout if stated else replace(layout, names=_with_title(path, layout))


_GYRO_SCALE: Final = re.compile(r'"?gyroScale"?[,;]\s*"?([0-9.eE+-]{1,30})"?\s*')
"""Of the Blackbox Explorer, in rad/us a count."""
_COUNTS: Final = tuple(f"gyroADC[{axis}]" for axis in range(3))


def _with_unit_of_counts(path: Path, layout: TableLayout) -> tuple[str, ...]:
    """Names of the columns, those of Betaflight's gyro with deg/s where a count is one, as the lines above the header say."""
    if not set(_COUNTS) <= set(layout.names):
        return layout.names
    scales: list[float] = []
    with open(path, encoding=layout.encoding) as stream:
        for _ in range(min(layout.header_line, PREAMBLE_LINES)):
            if matched := _GYRO_SCALE.fullmatch(stream.readline().strip()):
                with suppress(ValueError):
                    scales.append(float(matched[1]))
    is_degrees = bool(scales) and all(abs(1e6 * scale * 180 / math.pi - 1) < 1e-4 for scale in scales)
    return tuple(f"{name} (deg/s)" if is_degrees and name in _COUNTS else name for name in layout.names)


_WITH_UNIT: Final = re.compile(r"[-+]?[\d.,]+(?:[eE][-+]?\d+)?\s+([A-Za-z°/^²0-9]+)")
"""A number with its unit in one cell, as Grafana writes it."""


def _with_cell_units(path: Path, layout: TableLayout) -> TableLayout:
    """Layout with the units that stand behind the numbers in the cells of the first row, which then are those of the columns.

    Raises
    ------
    InputError
        A column whose name states another unit.
    """
    first = next((text for _, text in data_lines(path, layout)), "")
    matched = [_WITH_UNIT.fullmatch(cell) for cell in layout.cells(first)]
    units = [each[1] if each is not None and _MAY_BE_UNIT.search(each[1]) else "" for each in matched]
    units = [unit if _UNITS.fullmatch(unit) else "" for unit in units]
    if not any(units) or len(units) != len(layout.names):
        return layout
    stated = [parts_of(name)[1] for name in layout.names]
    for name, own, unit in zip(layout.names, stated, units, strict=True):
        if own and unit and own != unit.lower():
            raise InputError(
                f"{path_text(path)}: column {value_text(name)} holds numbers in {unit}; correct its name or its cells"
            )
    pairs = zip(layout.names, stated, units, strict=True)
    names = tuple(f"{name} ({unit})" if unit and not own else name for name, own, unit in pairs)
    return replace(layout, names=names, cell_units=tuple(units))


_TITLE: Final = re.compile(r"gyro\w*|angular (?:velocity|rate)|rotation rate|body rates?", re.IGNORECASE)
_TITLE_UNIT: Final = re.compile(
    r"(?:milli)?deg(?:rees?)?(?:/| per )s(?:ec(?:ond)?)?|m?dps|(?:milli)?rad(?:ians?)?(?:/| per )s(?:ec(?:ond)?)?|°/s",
    re.IGNORECASE,
)


def _with_title(path: Path, layout: TableLayout) -> tuple[str, ...]:
    """Names of columns, those of x, y and z alone with the words above them for a rate, and its unit if there is one."""
    axes = [k for k, name in enumerate(layout.names) if name.lower() in ("x", "y", "z")]
    if [layout.names[k].lower() for k in axes] != ["x", "y", "z"] or layout.header_line < 2:
        return layout.names
    with open(path, encoding=layout.encoding) as stream:
        above = " ".join(itertools.islice(stream, min(layout.header_line - 1, PREAMBLE_LINES)))
    titles, units = _TITLE.findall(above), {each.lower() for each in _TITLE_UNIT.findall(above)}
    if not titles or len(units) > 1 or re.search("accel", above, re.IGNORECASE):
        return layout.names
    unit = f" ({units.pop()})" if units else ""
    return tuple(f"gyro_{name}{unit}" if k in axes else name for k, name in enumerate(layout.names))


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


_OPENROCKET: Final = re.compile(r"# Event \w+ occurred at t=|# \d+ data points written for \d+ variables")
"""Comments of the exports of OpenRocket."""


def _found_layout(path: Path, stated: Sequence[str], encoding: str) -> TableLayout:
    """Layout of a table in this encoding. InputError: see `read_layout`."""
    # no cell is known before the header is found, so that delimiters alone leave a line empty
    preamble = TableLayout((), encoding, header_line=0, comments=COMMENTS)
    held: list[_NumberedLine] = []
    marked: tuple[int, str] | None = None  # the comment in front of the first numbers may be their header
    for number, raw in data_lines(path, replace(preamble, comments=())):
        if number > PREAMBLE_LINES:
            break
        if _OPENROCKET.match(raw):
            raise InputError(
                f"{path_text(path)}: the pitch and yaw rates of OpenRocket are about axes of the air flow, which do not "
                "turn with the body; log the body's own rates with a listener"
            )
        if line := preamble.content(raw):
            held.append(_NumberedLine(number, line))
        elif not any(_is_numbers(each) for _, each in held):
            marked = (number, raw.strip().lstrip("#").strip())
    if not stated and (labelled := _labelled_header(held)) is not None:
        return replace(labelled, encoding=encoding, comments=COMMENTS)
    if stated:
        number, line = next((each for each in held if _has_stated(each[1], stated)), (0, ""))
        if not number:
            number, line = next((each for each in held if _is_numbers(each[1])), (0, ""))
        return _stated_layout(path, tuple(stated), number, line, encoding)
    first = next((k for k, (_, line) in enumerate(held) if _is_row(line)), 0)
    if first and (above := _header_above(held[:first], held[first][1])):
        return replace(above, encoding=encoding, comments=COMMENTS)
    for index, (number, line) in enumerate(held):
        below = held[index + 1][1] if index + 1 < len(held) else ""
        found = _header(line, below)
        if found is None and (units := _units_below(line, below)):
            number, found = (
                held[index + 1].number,
                _header(units, held[index + 2][1] if index + 2 < len(held) else ""),
            )
        if found is not None:
            return replace(found, encoding=encoding, header_line=number, comments=COMMENTS)
        if _is_numbers(line):
            found = None if marked is None else _header(marked[1], line)
            if found is not None and marked is not None:
                return replace(found, encoding=encoding, header_line=marked[0], comments=COMMENTS)
            break
    lines = [line for _, line in held]
    first, delimiter = first_rows(lines)
    if first < 0:
        first = next((k for k, line in enumerate(lines) if _is_numbers(line)), -1)
    if first < 0:
        raise InputError(f"{path_text(path)}: has no line of column names; add one, such as time_s,wx,wy,wz")
    rows = numbers_of_lines(lines[first:], delimiter)
    if (proved := proved_columns(rows)) is not None:
        number, line = held[first]
        with suppress(InputError):
            return _stated_layout(path, tuple(proved), number, line, encoding)
    raise _no_header(path, *held[first], how_to_name(rows))


_ROWS_BELOW: Final = re.compile(r"trace_?values", re.IGNORECASE)
_WHAT_IS_NAMED: Final = re.compile(r"trace_?(name|unit)s?", re.IGNORECASE)
"""Labels in front of the lines of a table of dSPACE's ControlDesk."""


def _labelled_header(held: Sequence[_NumberedLine]) -> TableLayout | None:
    """Header of a table in which a label in the first column says what each line holds: names, units, values; None of another."""
    lines = [(number, _split(line, max(_DELIMITERS, key=line.count)) or [""], line) for number, line in held]
    place = next((k for k, (_, cells, _) in enumerate(lines) if _ROWS_BELOW.fullmatch(cells[0])), None)
    if place is None:
        return None
    labelled = {
        matched[1].lower(): cells
        for _, cells, _ in lines[:place]
        if (matched := _WHAT_IS_NAMED.fullmatch(cells[0])) is not None
    }
    names, units = labelled.get("name", []), labelled.get("unit", [])
    number, cells, line = lines[place]
    if len(names) < 3:
        return None
    row = (
        line if any(map(_is_numbers, cells[1:])) else (lines[place + 1][2] if place + 1 < len(lines) else "")
    )
    delimiter = max(_DELIMITERS, key=row.count)
    units = [*units, *[""] * len(names)][: len(names)]
    called = ["", *_of_traces(names[1:], units[1:])]
    return TableLayout(
        tuple(
            f"{name} ({unit})" if name and unit else name for name, unit in zip(called, units, strict=True)
        ),
        header_line=number - (row is line),
        delimiter=delimiter,
        decimal_comma=_has_decimal_comma(delimiter, row),
    )


def _of_traces(paths: Sequence[str], units: Sequence[str]) -> list[str]:
    """Names of traces without the path that leads to each: what stands in braces, or else the last word; time where it is in s."""
    for pattern in (r".*\{([^{}]+)\}$", r".*[/\\]([^/\\{}]+)(?:\{[^{}]*\})?$"):
        names = [re.sub(pattern, r"\1", path) for path in paths]
        if len(set(names)) == len(names):
            break
    is_clock = units[0] == "s" and units.count("s") == 1
    return ["time" if is_clock else names[0], *names[1:]]


def own_layout(path: Path) -> TableLayout:
    """Layout of a table of our own formats by its first two lines. InputError: as `read_header`."""
    require_text_table(path)
    try:
        with open(path, encoding="utf-8-sig") as stream:
            first, second = stream.readline(), stream.readline()
    except UnicodeDecodeError as error:
        raise not_text(path, "utf-8-sig", error) from None
    delimiter = max(_OWN_DELIMITERS, key=first.count)
    try:
        cells = next(csv.reader([first.rstrip("\r\n")], delimiter=delimiter), [])
    except csv.Error as error:
        raise InputError(
            f"{path_text(path)}: line 1: is no header ({error}); give a line of column names"
        ) from None
    names = tuple(cell.strip() for cell in cells)
    if not any(names) or _is_numbers(first):
        raise _no_header(path, 1, first, f"give {to_state('columns', 't,x,y,z')}")
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
    if len(names) < 3 or 2 * sum(map(_is_numbers, names)) >= len(names):
        return None
    if not any(character.isalpha() for character in text):
        return None
    if separator is None:
        wide = tuple(_WIDE_BLANKS.split(text))
        if 3 <= len(wide) < len(names) and len(_WIDE_BLANKS.split(below.strip())) == len(wide):
            names = wide
        elif not _has_cells(below, len(names)):
            return None  # a sentence
    if separator == "\t" and line.startswith(separator) and len(below.split(separator)) == len(names) + 1:
        names = ("", *names)
    # settings in front of a header have two cells or no numbers below
    if below and len(below.split(separator)) < min(3, len(names)):
        return None
    return TableLayout(names, delimiter=separator, decimal_comma=_has_decimal_comma(separator, below))


def _has_cells(line: str, count: int) -> bool:
    """Whether a line between whose cells are blanks may have so many, some of them numbers; dates have blanks, too."""
    cells = line.split()
    numbers = sum(map(_is_numbers, cells))
    return not line or (numbers > 0 and (len(cells) == count or ":" in line or numbers < 3))


def _units_below(line: str, below: str) -> str:
    """Names of columns between blanks with the units that stand below them; empty where there are none."""
    names, units = line.split(), below.split()
    if len(names) != len(units) or len(names) < 3 or not _are_units(units):
        return ""
    return " ".join(f"{name}({_bare_unit(unit)})" for name, unit in zip(names, units, strict=True))


_UNITS: Final = re.compile(
    r"(?:[mun]?s(?:ec(?:onds?)?)?|m?rad|m?deg|[mc]?m|m/s(?:ec)?|(?:m?rad(?:ians?)?|m?deg(?:rees?)?|°|d)/s(?:ec(?:ond)?)?|m?dps|rpm|m?g|"
    r"m/s(?:ec)?\^?2|m/s²)",
    re.IGNORECASE,
)
_MAY_BE_UNIT: Final = re.compile(r"deg|rad|°|/s|rpm", re.IGNORECASE)
_NOTE: Final = re.compile(r"(?:Type|Unit|Interp|BlockPath|PortIndex|Enum):")
"""Of a line below the names that the Simulation Data Inspector writes."""
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
    delimiter = _delimiter_of_numbers(row)
    if delimiter not in row:
        return None  # blanks separate the words of any sentence
    width, cells = len(row.split(delimiter)), [_split(line.text, delimiter) for line in lines]
    rows = [each for each in cells if len(each) == width]
    if len(cells[-1]) != width:
        return None
    units = [""] * width
    if len(rows) > 1 and _are_units(rows[-1]):
        units = ["" if cell.lower().rstrip("s:") == "unit" else _bare_unit(cell) for cell in rows.pop()]
    for noted in [each for each in rows[1:] if any(_NOTE.match(cell) for cell in each)]:
        rows.remove(noted)
        if any(cell.startswith("Unit:") for cell in noted):
            units = [cell.removeprefix("Unit:").strip() for cell in noted]
    place = len(rows) - 1
    while place > 0 and len(set(filter(None, rows[place]))) < 3:  # such as types of the columns
        if not any(units) and any(_MAY_BE_UNIT.search(cell) for cell in rows[place]):
            units = [_bare_unit(cell) for cell in rows[place]]  # known or not: none is left out
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
        names = _with_bodies(rows, names)
    names = [f"{name} ({unit})" if unit else name for name, unit in zip(names, units, strict=True)]
    return TableLayout(
        tuple(names),
        header_line=lines[-1].number,
        delimiter=delimiter,
        decimal_comma=_has_decimal_comma(delimiter, row),
    )


def _with_bodies(rows: Sequence[Sequence[str]], names: Sequence[str]) -> list[str]:
    """Names of columns with that of their body in front, where Motive lists several."""
    bodies = next((each for each in rows if "Name" in each[:2]), None)
    if (
        bodies is None
        or len({body for body, name in zip(bodies, names, strict=True) if body and name} - {"Name"}) < 2
    ):
        return list(names)
    return [
        f"{body} {name}" if body and body != "Name" and name else name
        for body, name in zip(bodies, names, strict=True)
    ]


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
    """Unit after the words "Length Units" above a header; empty without them."""
    for _, line in lines:
        cells = _split(line, ",")
        if "Length Units" in cells[:-1]:
            return _LENGTHS.get(cells[cells.index("Length Units") + 1].lower(), "")
    return ""


def _is_row(line: str) -> bool:
    """Whether a line is a row of at least three numbers whose first cell is one, or is a date."""
    cells = _split(line, _delimiter_of_numbers(line))
    if cells and seconds_of_clock(cells[0]) is not None:
        return sum(map(_is_numbers, cells[1:])) >= 3
    return (
        _is_numbers(line)
        and line.lstrip(" ")[:1] not in _DELIMITERS
        and len(re.split(r"[\s,;|]+", line.strip())) >= 3
    )


_WITH_COMMA: Final = re.compile(r"\s*(?:[+-]?\d*,?\d+(?:[eE][+-]?\d+)?)?\s*")


def _delimiter_of_numbers(line: str) -> str:
    """The commonest delimiter of a line of numbers; another than the comma where that is the decimal mark of its cells."""
    for delimiter in ";\t":
        cells = line.replace('"', "").split(delimiter)
        if len(cells) > 2 and all(map(_WITH_COMMA.fullmatch, cells)):
            return delimiter
    return max(_DELIMITERS, key=line.count)


def _has_stated(line: str, names: Sequence[str]) -> bool:
    """Whether a line has as many cells as columns are stated, with a number in each that is not left out."""
    delimiter = max(_DELIMITERS, key=line.count)
    cells = _split(line, delimiter) if delimiter in line else line.split()
    chosen = [cell for cell, name in zip(cells, names, strict=False) if name != "-"]
    return (
        len(cells) == len(names) + _ends_empty(line, delimiter)
        and bool(chosen)
        and all(_is_numbers(cell) or seconds_of_clock(cell) is not None for cell in chosen)
    )


def _ends_empty(line: str, delimiter: str | None) -> bool:
    """Whether the last cell of a line is empty, as after a delimiter at its end."""
    return delimiter is not None and line.rstrip(" \r\n").endswith(delimiter)


def _has_decimal_comma(delimiter: str | None, line: str) -> bool:
    """Whether the numbers of a line have a comma as decimal mark; its dates may have points."""
    if delimiter == "," or "," not in line or "." not in line:
        return delimiter != "," and "," in line
    cells = [cell.strip(' "\r\n') for cell in line.split(delimiter)]
    return any(map(_COMMA.fullmatch, cells)) and not any(map(_POINT.fullmatch, cells))


_COMMA, _POINT = (re.compile(rf"[+-]?\d*{mark}\d+(?:[eE][+-]?\d+)?") for mark in (",", r"\."))
"""A number with this decimal mark."""


def _is_numbers(line: str) -> bool:
    """Whether a line holds numbers and no more."""
    cells = re.sub('[;,|"]', " ", line).split()
    return bool(cells) and all(map(is_number, cells))


def _no_header(path: Path, number: int, line: str, cure: str) -> InputError:
    return InputError(
        f"{path_text(path)}: line {number}: {value_text(line.strip())} is no header; add a line of column names, or {cure}"
    )


def other_header(path: Path, found: Sequence[str], expected: Sequence[str]) -> InputError:
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


def data_lines(path: Path, layout: TableLayout) -> Iterator[tuple[int, str]]:
    """Numbers and contents of the lines below the header that have cells. InputError: bytes of another encoding."""
    try:
        with open(path, encoding=layout.encoding) as stream:
            for number, line in enumerate(stream, start=1):
                if number > layout.header_line and (text := layout.content(line)):
                    yield number, text
    except UnicodeError as error:
        raise not_text(path, layout.encoding, error) from None
    except OSError as error:
        raise InputError(f"{path_text(path)}: cannot be read ({reason(error)}); copy it again") from None


def _encoding(path: Path) -> str:
    """Encoding by byte order mark, UTF-16 without one by NUL bytes, that of Windows by its letters in a header, else UTF-8."""
    try:
        with open(path, "rb") as stream:
            begin = stream.read(_HEAD_BYTES)
    except OSError as error:
        raise InputError(f"{path_text(path)}: cannot be read ({reason(error)}); copy it again") from None
    head = begin[:64]
    for mark, encoding in _BYTE_ORDER_MARKS:
        if head.startswith(mark):
            return encoding
    if len(head) >= 8 and os.path.getsize(path) % 2 == 0:
        for start, encoding in ((1, "utf-16-le"), (0, "utf-16-be")):
            if not any(head[start::2]) and all(head[1 - start :: 2]):
                return encoding
    return _WINDOWS if _is_header_of_windows(begin) else "utf-8"


_HEAD_BYTES: Final = 1 << 14
_WINDOWS: Final = "cp1252"
_SIGNS: Final = frozenset("°²³µ·")
"""Of units, among the letters of Windows."""


def _is_header_of_windows(begin: bytes) -> bool:
    """Whether words above the first row of numbers are no UTF-8, and all their bytes letters of Windows or signs of units."""
    if begin.isascii():
        return False
    lines = begin.splitlines()[: PREAMBLE_LINES + 1][:-1]
    words = list(itertools.takewhile(lambda line: not line.lstrip(b"\"' +-.,;\t")[:1].isdigit(), lines))
    above = b"\n".join(words)
    try:
        above.decode("utf-8")
    except UnicodeDecodeError:
        with suppress(UnicodeDecodeError):
            letters = above.decode(_WINDOWS)
            return len(words) < len(lines) and all(
                sign.isascii() or sign.isalpha() or sign in _SIGNS for sign in letters
            )
    return False


def not_text(path: Path, encoding: str, error: UnicodeError) -> InputError:
    """InputError for the first byte that is not of the encoding."""
    if not encoding.startswith("utf-8"):
        found = "of one encoding" if encoding == _WINDOWS else "UTF-16"
        return InputError(f"{path_text(path)}: is not {found} ({reason(error)}); save it as UTF-8 text")
    with open(path, "rb") as stream:
        for number, line in enumerate(stream, start=1):
            try:
                line.decode("utf-8")
            except UnicodeDecodeError as bad:
                where = f"{path_text(path)}: line {number}: byte 0x{line[bad.start]:02x}"
                return InputError(f"{where} is not UTF-8; save the file as UTF-8 text")
    return InputError(f"{path_text(path)}: is not UTF-8; save it as UTF-8 text")
