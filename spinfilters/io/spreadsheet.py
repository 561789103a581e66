"""Workbooks of Excel (.xlsx): the sheets are read as the tables that they would be as CSV."""

import csv
import re
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.document import without_name_spaces
from spinfilters.io.input_file import MAX_TABLE_BYTES, largest_unpacked, path_text, reason, require_file
from spinfilters.io.motion_file import read_motion_file
from spinfilters.io.stated_values import ReadingOptions

_SHEET: Final = re.compile(r"xl/worksheets/sheet(\d+)\.xml")
_STRINGS: Final = "xl/sharedStrings.xml"
_CELL: Final = re.compile(r"([A-Z]{1,3})\d+")
_MOST_COLUMNS: Final = 1000


def read_spreadsheet(path: Path, options: ReadingOptions) -> Dataset:
    """Data set of the first sheet that describes a motion. InputError: of the first sheet, where none does."""
    require_file(path, MAX_TABLE_BYTES)
    refusal: InputError | None = None
    with tempfile.TemporaryDirectory(prefix="spinfilters-") as place:
        for number, rows in _sheets(path):
            table = Path(place) / f"{path.stem}.csv"
            with open(table, "w", encoding="utf-8", newline="") as stream:
                csv.writer(stream).writerows(rows)
            try:
                found = read_motion_file(table, options)
            except InputError as error:
                text = str(error).replace(str(table), f"{path_text(path)}: sheet {number}")
                refusal = refusal or InputError(text)
                continue
            description = found.description.replace(table.name, f"{path.name}, sheet {number}")
            return Dataset(
                kind=found.kind,
                log=found.log,
                path=path,
                description=description,
                acceleration=found.acceleration,
            )
    raise refusal or InputError(f"{path_text(path)}: has no sheet; save it again")


def _sheets(path: Path) -> Iterator[tuple[int, list[list[str]]]]:
    """Numbers of the sheets and their rows. InputError: no workbook, or one that unpacks to too much."""
    try:
        with zipfile.ZipFile(path) as archive:
            numbers = sorted(int(m[1]) for name in archive.namelist() if (m := _SHEET.fullmatch(name)))
            unpacked = sum(each.file_size for each in archive.infolist())
            if unpacked > largest_unpacked(path.stat().st_size):
                raise InputError(f"{path_text(path)}: holds too much; save its sheet as CSV")
            strings = _strings(archive) if _STRINGS in archive.namelist() else []
            for number in numbers:
                yield number, _rows(_root(archive.read(f"xl/worksheets/sheet{number}.xml")), strings)
    except InputError:
        raise
    except Exception as error:  # the package meets a damaged archive with whatever its parsers raise
        raise InputError(
            f"{path_text(path)}: is no whole workbook ({reason(error)}); save its sheet as CSV"
        ) from None


def _root(data: bytes) -> ElementTree.Element:
    """Root of a part, its names without name spaces. ValueError: a document type, whose entities could unpack to any size."""
    if b"\0" in data or b"<!DOCTYPE" in data.upper():
        raise ValueError("it has a document type")
    return without_name_spaces(ElementTree.fromstring(data))


def _strings(archive: zipfile.ZipFile) -> list[str]:
    """Texts that cells name by their places."""
    return [
        "".join(each.text or "" for each in item.iter("t"))
        for item in _root(archive.read(_STRINGS)).iter("si")
    ]


def _rows(root: ElementTree.Element, strings: list[str]) -> list[list[str]]:
    """Cells of all rows as texts, empty where there are none; all rows as long as the longest."""
    rows = [{place: _text(cell, strings) for place, cell in _placed(row)} for row in root.iter("row")]
    width = 1 + max((place for row in rows for place in row), default=-1)
    return [[row.get(place, "") for place in range(width)] for row in rows if any(row.values())]


def _placed(row: ElementTree.Element) -> Iterator[tuple[int, ElementTree.Element]]:
    """Cells of a row with their columns from 0. ValueError: too many."""
    place = -1
    for cell in row.iter("c"):
        matched = _CELL.fullmatch(cell.get("r", ""))
        place = place + 1 if matched is None else _column(matched[1])
        if place >= _MOST_COLUMNS:
            raise ValueError(f"more than {_MOST_COLUMNS} columns")
        yield place, cell


def _column(letters: str) -> int:
    """Number of a column, from 0, of its letters: A, ..., Z, AA are the digits of base 26 that begin with 1."""
    number = 0
    for letter in letters:
        number = 26 * number + ord(letter) - ord("A") + 1
    return number - 1


def _text(cell: ElementTree.Element, strings: list[str]) -> str:
    """Text of a cell; of a number as it is written."""
    kind, value = cell.get("t", "n"), cell.findtext("v") or ""
    if kind == "s":
        return strings[int(value)]
    return "".join(each.text or "" for each in cell.iter("t")) if kind == "inlineStr" else value
