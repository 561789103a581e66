"""Tables whose rows are of several sensors: GnssLogger of Android, and the data collection of RealSense.

The first cell of a row is the name of its sensor. GnssLogger lists the columns of each sensor in comments, RealSense in a line
above each block of rows.
"""

import re
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import (
    MAX_TABLE_BYTES,
    first_text,
    parse_number,
    path_text,
    printable,
    require_file,
    require_text_table,
    value_text,
)
from spinfilters.io.motion_file import motion_dataset
from spinfilters.io.motion_table import motion_of
from spinfilters.io.named_columns import ArrayColumns
from spinfilters.io.stated_values import ReadingOptions, to_state

SENSORS: Final = ("Gyro", "UncalGyro", "Pose")
"""Names of sensors that describe a motion, the first that is there being taken."""
_BLOCK: Final = "Stream Type,"
_COMMENT = re.compile(r"#\s*([A-Za-z]\w*),((?:\w+,){3,}\w+)\s*")
_HEAD: Final = 1 << 16
_MEANINGS: Final = {
    **{f"3DOF_{axis}": f"omega_{axis}" for axis in "xyz"},
    **{f"t_{axis}": f"p{axis}" for axis in "xyz"},
    **{f"r_{axis}": f"q{axis}" for axis in "xyzw"},
}
"""Columns of RealSense: rates (rad/s), positions (m) and quaternions."""


def has_typed_rows(path: Path) -> bool:
    """Whether the first lines list the columns of a sensor of its own."""
    lines = first_text(path, _HEAD).splitlines()
    columns = [matched[1] for line in lines if (matched := _COMMENT.fullmatch(line.strip()))]
    if any(name in SENSORS for name in columns):
        return True
    return any(line.startswith(_BLOCK) and "Timestamp" in line for line in lines)


def read_typed_rows(path: Path, options: ReadingOptions) -> Dataset:
    """Measurements of the sensor that the user states, or of the first that describes a motion."""
    options.require_only(("topic", "unit", "clock", "rate"), "a table of several sensors")
    require_file(path, MAX_TABLE_BYTES)
    require_text_table(path)
    chosen = _chosen(path, _sensors(path), options.topic)
    columns = _columns(path, chosen)
    stated = replace(options, topic=None)
    return motion_dataset(path, f"{path.name}, {printable(chosen)}", motion_of(columns, stated))


def _chosen(path: Path, sensors: Sequence[str], topic: str | None) -> str:
    wanted = SENSORS if topic is None else (topic,)
    chosen = next((name for name in wanted if name in sensors), None)
    if chosen is None:
        listed = ", ".join(map(printable, sensors[:8])) or "none"
        raise InputError(
            f"{path_text(path)}: has no rows of {value_text(wanted[0])}, only of {listed}; record the gyro, or give one of "
            f"them with {to_state('topic', 'NAME')}"
        )
    return chosen


def _sensors(path: Path) -> list[str]:
    """Names of the sensors that have rows."""
    return sorted({cells[0] for _, cells, _ in _rows(path)})


def _rows(path: Path) -> Iterator[tuple[int, list[str], tuple[str, ...]]]:
    """Number, cells and column names of the rows, without those whose columns are listed nowhere. InputError: no UTF-8."""
    listed: dict[str, tuple[str, ...]] = {}
    block: tuple[str, ...] = ()
    try:
        with open(path, encoding="utf-8-sig") as stream:
            for number, line in enumerate(stream, start=1):
                text = line.strip()
                if matched := _COMMENT.fullmatch(text):
                    listed[matched[1]] = tuple(matched[2].split(","))
                elif text.startswith(_BLOCK):
                    block = tuple(text.split(",")[1:]) if "Timestamp" in text else ()
                elif text and not text.startswith("#"):
                    cells = text.split(",")
                    names = listed.get(cells[0], block)
                    if names:
                        yield number, cells, names
    except UnicodeDecodeError:
        raise InputError(f"{path_text(path)}: is not UTF-8; save it as UTF-8 text") from None


def _columns(path: Path, sensor: str) -> ArrayColumns:
    """Columns of the rows of a sensor. InputError: a row with another number of cells, or with a word for a number."""
    numbers, first = array("d"), None
    for number, cells, names in _rows(path):
        if cells[0] != sensor:
            continue
        if first is None:
            first = names
        if len(cells) - 1 != len(first) or names != first:
            raise InputError(
                f"{path_text(path)}: line {number}: has {len(cells)} cells, expected {len(first) + 1}; correct or delete the line"
            )
        try:
            numbers.extend([parse_number(cell) if cell.strip() else np.nan for cell in cells[1:]])
        except ValueError as error:
            raise InputError(
                f"{path_text(path)}: line {number}: {error}; correct or delete the line"
            ) from None
    first = first or ()
    table = np.frombuffer(numbers, dtype=np.float64).reshape(-1, max(len(first), 1))
    return ArrayColumns(path, tuple(_MEANINGS.get(name, name) for name in first), tuple(table.T))
