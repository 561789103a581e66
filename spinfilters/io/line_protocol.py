"""Line protocol of InfluxDB, as its exports and Telegraf's files are written.

``imu,host=cubesat gyro_x=0.31,gyro_y=1.49,gyro_z=0.06 1700000000000000000`` is a measurement with its tags, fields, and time. Lines
of one measurement and the same tags are the rows of one table; a row may be parted over several lines of one time.
"""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import (
    MAX_TABLE_BYTES,
    MAX_TABLE_ROWS,
    first_text,
    path_text,
    printable,
    read_bytes,
    value_text,
)
from spinfilters.io.motion_columns import motion_columns
from spinfilters.io.motion_file import motion_dataset
from spinfilters.io.motion_table import motion_of
from spinfilters.io.named_columns import ArrayColumns
from spinfilters.io.stated_values import ReadingOptions, to_state

_LINE: Final = re.compile(
    r"((?:[^\s,\\]|\\.)+)((?:,(?:[^\s,=\\]|\\.)+=(?:[^\s,\\]|\\.)+)*) (\S+=(?:\"[^\"]*\"|\S)+) (\d{10}|\d{13}|\d{16}|\d{19})"
)
"""Measurement, tags, fields, and time since 1970 in s, ms, us or ns."""
_FIELD: Final = re.compile(r"((?:[^,=\\]|\\.)+)=(\"(?:[^\"\\]|\\.)*\"|[^,]*)")
_NUMBER: Final = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)[iu]?")
_HEAD: Final = 1 << 14
_COMMANDS: Final = ("#", "CREATE ")
"""Beginnings of lines that an export writes above its data."""


def has_line_protocol(path: Path) -> bool:
    """Whether the first lines of a text, but for comments, are lines of the protocol."""
    lines = [line.strip() for line in first_text(path, _HEAD).splitlines()[:-1]]
    held = [line for line in lines if line and not line.startswith(_COMMANDS)][:10]
    return len(held) > 1 and all(map(_LINE.fullmatch, held))


def read_line_protocol(path: Path, options: ReadingOptions) -> Dataset:
    """Rates, poses or attitudes of the one measurement that has some, or of that which the user names by the topic.

    InputError: no UTF-8, a line that is none of the protocol; no such measurement, or several.
    """
    options.require_only(("unit", "topic"), "a file of line protocol")
    tables = _tables(path)
    moving = [name for name, rows in tables.items() if _is_motion(path, rows)]
    if options.topic is not None:
        moving = [name for name in moving if options.topic in (name, name.partition(",")[0])]
    if len(moving) != 1:
        listed = ", ".join(printable(name) for name in (moving or tables))[:200]
        cure = f"give {to_state('topic', 'ONE OF THEM')}" if moving else "export body rates about x, y and z"
        what = "each describe a motion" if moving else "describe no motion"
        raise InputError(f"{path_text(path)}: {listed} {what}; {cure}")
    (name,) = moving
    rows = tables[name]
    fields = _fields_in_all(rows)
    numbers = {field: np.array([row[field] for row in rows.values()]) for field in fields}
    columns = {"time (s)": np.array(list(rows)), **numbers}
    source = ArrayColumns(path, tuple(columns), tuple(columns.values()))
    stated = ReadingOptions(unit=options.unit)
    return motion_dataset(path, f"{path.name}, {printable(name)}", motion_of(source, stated))


def _tables(path: Path) -> dict[str, dict[float, dict[str, float]]]:
    """Numbers by field and time (s), in the order of time, of each measurement with its tags. InputError: a line that is none."""
    found: dict[str, dict[float, dict[str, float]]] = {}
    for number, (series, fields, time) in _lines(path):
        if number > MAX_TABLE_ROWS:
            raise InputError(f"{path_text(path)}: has more than {MAX_TABLE_ROWS} lines; cut it")
        found.setdefault(series, {}).setdefault(time, {}).update(fields)
    return {series: dict(sorted(rows.items())) for series, rows in found.items()}


def _lines(path: Path) -> Iterator[tuple[int, tuple[str, dict[str, float], float]]]:
    """Number, measurement with its tags, fields that are numbers, and time (s) of each line."""
    try:
        lines = read_bytes(path, MAX_TABLE_BYTES).decode("utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise InputError(f"{path_text(path)}: is not UTF-8; save it as UTF-8 text") from None
    for number, line in enumerate(map(str.strip, lines), start=1):
        if not line or line.startswith(_COMMANDS):
            continue
        matched = _LINE.fullmatch(line)
        if matched is None:
            if number == len(lines):  # the power went while it was written
                return
            raise InputError(
                f"{path_text(path)}: line {number}: {value_text(line)} is no line of a measurement; correct or delete it"
            )
        # whole seconds and the rest apart: a double does not hold all digits of nanoseconds
        digits, unit = matched[4], 10 ** (len(matched[4]) - 10)
        time = int(digits) // unit + (int(digits) % unit) / unit
        pairs = ((each[1], _NUMBER.fullmatch(each[2])) for each in _FIELD.finditer(matched[3]))
        numbers = {name: float(value[1]) for name, value in pairs if value is not None}
        yield number, (matched[1] + matched[2], numbers, time)


def _fields_in_all(rows: Mapping[float, Mapping[str, float]]) -> list[str]:
    first = next(iter(rows.values()))
    return [name for name in first if all(name in row for row in rows.values())]


def _is_motion(path: Path, rows: Mapping[float, Mapping[str, float]]) -> bool:
    """Whether the fields are those of rates or of an attitude."""
    try:
        return motion_columns(path, _fields_in_all(rows), ReadingOptions(rate=1.0)).describe_motion
    except InputError:
        return False
