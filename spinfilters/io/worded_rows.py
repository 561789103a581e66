"""Logs of several sensors without a header, whose rows are told by a word: ``12.5 GYRO 0.1 0.2 0.3``, ``GYRO;0.02;0.1;0.2;0.3``.

Paparazzi, GetSensorData and many loggers of one's own write them. In the rows of a gyro what stays is left out; the last three
numbers that are left are the rates, and what stands in front of them has to be clocks. Sentences of VectorNav are read by the list
of their fields.
"""

import re
from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import reduce
from operator import xor
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.headings import heading_of
from spinfilters.io.input_file import (
    MAX_TABLE_BYTES,
    first_text,
    is_number,
    parse_number,
    path_text,
    printable,
    read_bytes,
    value_text,
)
from spinfilters.io.motion_file import motion_dataset
from spinfilters.io.motion_table import motion_of
from spinfilters.io.named_columns import ArrayColumns
from spinfilters.io.stated_values import ReadingOptions, to_state

_HEAD: Final = 1 << 15
_FEWEST: Final = 3
_WORD: Final = re.compile(r"\$?[A-Za-z][A-Za-z0-9_./-]{1,40}")
_CHECKSUM: Final = re.compile(r"\*[0-9A-Fa-f]{2,4}$")
_MAGNETIC, _FORCE, _RATE = (
    [f"{stem}_{axis}{unit}" for axis in "xyz"]
    for stem, unit in (("mag", ""), ("acc", " (m/s^2)"), ("gyro", " (rad/s)"))
)
SENTENCES: Final[dict[str, tuple[str, ...]]] = {
    "$VNYMR": ("yaw", "pitch", "roll", *_MAGNETIC, *_FORCE, *_RATE),
    "$VNQMR": ("qx", "qy", "qz", "qw", *_MAGNETIC, *_FORCE, *_RATE),
    "$VNIMU": (*_MAGNETIC, *_FORCE, *_RATE, "temperature", "pressure"),
    "$VNGYR": tuple(_RATE),
    "$VNMAR": (*_MAGNETIC, *_FORCE, *_RATE),
}
"""Fields of the ASCII messages of VectorNav with rates; scalar last."""


class _WordedRow(NamedTuple):
    """Line of a row, its word, and its numbers with how many of them stand in front of the word."""

    line: int
    word: str
    before: int
    numbers: tuple[float, ...]


def has_worded_rows(path: Path) -> bool:
    """Whether at least three of the first lines are rows of one gyro, and most are rows with a word."""
    lines = [line for line in first_text(path, _HEAD).splitlines()[:-1] if _is_content(line)]
    found = [row for k, line in enumerate(lines[:400]) if (row := _row(k, line))]
    rates = [row for row in found if _is_rate(row.word) and len(row.numbers) >= 3]
    return len(rates) >= _FEWEST and 2 * len(found) >= min(len(lines), 400)


def read_worded_rows(path: Path, options: ReadingOptions) -> Dataset:
    """Rates of the only gyro, or of the word that the user names by the topic.

    InputError: several, rows that differ in length, or numbers of which not three are rates.
    """
    options.require_only(("topic", "unit", "clock", "rate"), "a log of several sensors")
    lines = read_bytes(path, MAX_TABLE_BYTES).decode("utf-8-sig", "replace").splitlines()
    every = [row for k, line in enumerate(lines, start=1) if _is_content(line) and (row := _row(k, line))]
    words = [word for word in dict.fromkeys(row.word for row in every) if _is_rate(word)]
    chosen = words if options.topic is None else [word for word in words if word == options.topic]
    if len(chosen) != 1:
        listed = ", ".join(printable(word) for word in words[:8]) or "no gyro"
        raise InputError(f"{path_text(path)}: has rows of {listed}; give {to_state('topic', 'ONE OF THEM')}")
    rows = [row for row in every if row.word == chosen[0]]
    for row in rows:
        if (row.before, len(row.numbers)) != (rows[0].before, len(rows[0].numbers)):
            raise InputError(
                f"{path_text(path)}: line {row.line}: has {len(row.numbers)} numbers, expected {len(rows[0].numbers)}; correct or "
                "delete the line"
            )
    if chosen[0] in SENTENCES:  # which have no clock, so that none may be missing
        _require_whole(path, lines, chosen[0], {row.line for row in rows})
    table = np.array([row.numbers for row in rows], dtype=np.float64)
    names = _header(lines[: rows[0].line - 1], rows[0]) or _names(path, chosen[0], table)
    columns = {name: column for name, column in zip(names, table.T, strict=True) if name}
    source = ArrayColumns(path, tuple(columns), tuple(columns.values()))
    return motion_dataset(
        path, f"{path.name}, {printable(chosen[0])}", motion_of(source, replace(options, topic=None))
    )


def _require_whole(path: Path, lines: Sequence[str], word: str, whole: Collection[int]) -> None:
    """InputError: a sentence of this word that is no row, or has another checksum than it states: the exclusive or of its bytes."""
    for number, line in enumerate(map(str.strip, lines), start=1):
        body, mark, stated = line.removeprefix("$").rpartition("*")
        found = reduce(xor, body.encode("utf-8", "replace"), 0)
        is_wrong = bool(mark) and len(stated) == 2 and f"{found:02X}" != stated.upper()
        if (line.startswith(word) and number not in whole) or (line.startswith("$") and is_wrong):
            raise InputError(f"{path_text(path)}: line {number}: {value_text(line)} is damaged; log it again")


def _header(lines: Sequence[str], row: _WordedRow) -> list[str]:
    """Names of the numbers of a row in a line above it, those called x, y and z by its word; none without such a line."""
    for line in map(str.strip, lines):
        marks = re.findall(r"[,;\t|]", line)
        cells = [
            cell.strip().strip('"')
            for cell in line.split(max(set(marks), key=marks.count) if marks else None)
        ]
        if len(cells) == 1 + len(row.numbers) and not any(map(is_number, cells)):
            own = [cell for k, cell in enumerate(cells) if k != row.before]
            return [f"{row.word}_{name}" if name.lower() in ("x", "y", "z") else name for name in own]
    return []


def _is_content(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith(("#", "%", "//"))


def _is_rate(word: str) -> bool:
    """Whether a word is the name of a gyro or of body rates."""
    if word in SENTENCES:
        return True
    heading = heading_of(f"{word}_x")
    return heading is not None and heading.quantity == "rate"


def _row(number: int, line: str) -> _WordedRow | None:
    """A line of numbers with one word, in front of them or behind at most three of them; None of another."""
    text = _CHECKSUM.sub("", line.strip())
    marks = re.findall(r"[,;\t|]", text)
    cells = [cell.strip() for cell in text.split(max(set(marks), key=marks.count) if marks else None)]
    places = [
        k for k, cell in enumerate(cells[:4]) if _WORD.fullmatch(cell) and cell.lower() not in ("nan", "inf")
    ]
    if len(places) != 1:
        return None
    try:
        numbers = tuple(parse_number(cell) for k, cell in enumerate(cells) if k != places[0] and cell)
    except ValueError:
        return None
    return _WordedRow(number, cells[places[0]], places[0], numbers)


def _names(path: Path, word: str, table: np.ndarray) -> list[str]:
    """Names of the numbers of a row; empty of those to leave out. InputError: not three that may be rates."""
    if word in SENTENCES:
        names = SENTENCES[word]
        if len(names) != table.shape[1]:
            raise InputError(
                f"{path_text(path)}: {value_text(word)} has {table.shape[1]} fields, expected {len(names)}; log it again"
            )
        return list(names)
    varied = [k for k in range(table.shape[1]) if np.ptp(table[:, k]) > 0]
    clocks, rates = varied[:-3], varied[-3:]
    if len(rates) < 3 or rates[2] - rates[0] != 2 or not _are_clocks(table[:, clocks]):
        raise InputError(
            f"{path_text(path)}: rows of {printable(word)} have {len(varied)} numbers that vary, which are not "
            "clocks and three rates; save them as a table with column names, such as time_s,wx,wy,wz"
        )
    names = [""] * table.shape[1]
    if clocks:
        names[clocks[-1]] = "time"  # nearest to the rates: that of the sensor, where there are two
    for k, axis in zip(rates, "xyz", strict=True):
        names[k] = f"{word}_{axis}"
    return names


_SAME_CLOCK: Final = 0.01
"""Share by which two clocks may differ in their course."""


def _are_clocks(columns: np.ndarray) -> bool:
    """Whether at most two columns rise, both by as many seconds if there are two."""
    spans = np.ptp(columns, axis=0)
    if columns.shape[1] > 2 or not (np.diff(columns, axis=0) >= 0).all():
        return False
    ratios = (
        [spans[-1] / spans[0] * 10.0**power for power in (-9, -6, -3, 0, 3, 6, 9)]
        if len(spans) == 2
        else [1.0]
    )
    return any(abs(ratio - 1) < _SAME_CLOCK for ratio in ratios)
