"""ArduPilot flight logs (DataFlash): body rates of the first gyro, from the binary log or its text.

A message FMT gives a type its number, its length, its name, the types of its fields and their names. In the binary log every
message begins with two fixed bytes and the number, in the text every line with the name.
"""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import path_text, printable, read_bytes
from spinfilters.io.logger_names import understood_names
from spinfilters.io.motion_file import motion_dataset
from spinfilters.io.motion_table import motion_of
from spinfilters.io.named_columns import ArrayColumns
from spinfilters.io.stated_values import ReadingOptions

LARGEST: Final = 2 * 1024**3
MAGIC: Final = b"\xa3\x95"
MESSAGES: Final = ("IMU", "GYR", "GYR1", "IMU2", "IMU3")
"""Messages of body rates, the first that is there being taken."""
_FORMAT, _FORMAT_SIZE = 128, 89
_TYPES: Final = {
    **dict(
        zip(
            "bBhHiIfdqQM",
            ("i1", "u1", "<i2", "<u2", "<i4", "<u4", "<f4", "<f8", "<i8", "<u8", "u1"),
            strict=True,
        )
    ),
    **dict(zip("cCeELg", ("<i2", "<u2", "<i4", "<u4", "<i4", "<f2"), strict=True)),
    "n": "S4",
    "N": "S16",
    "Z": "S64",
    "a": "V64",
}
"""Fields of a message; c, C, e and E are hundredths, of which rates and clocks have none."""


class _Message(NamedTuple):
    """Name and fields of a type of message."""

    name: str
    fields: tuple[str, ...]
    kinds: str


def read_ardupilot_log(path: Path, options: ReadingOptions) -> Dataset:
    """Rates of the first gyro of the first message that has some."""
    options.require_only(("unit", "clock"), "an ArduPilot log")
    content = read_bytes(path, LARGEST)
    tables = _binary(content) if content.startswith(MAGIC) else _text(content.decode("ascii", "replace"))
    chosen = next((tables[name] for name in MESSAGES if name in tables), None)
    if chosen is None:
        listed = ", ".join(sorted(map(printable, tables))[:8]) or "nothing"
        raise InputError(
            f"{path_text(path)}: has no message {' or '.join(MESSAGES[:2])}, only {listed}; log the IMU"
        )
    instance = chosen.get("I")
    rows = slice(None) if instance is None else instance == instance[0]
    names = understood_names(tuple(chosen))
    columns = ArrayColumns(path, tuple(names), tuple(values[rows] for values in chosen.values()))
    return motion_dataset(path, path.name, motion_of(columns, options))


def _binary(data: bytes) -> dict[str, dict[str, np.ndarray]]:
    """Columns of the messages of `MESSAGES` by name and field; bytes between messages are passed over."""
    formats: dict[int, tuple[int, _Message]] = {_FORMAT: (_FORMAT_SIZE, _Message("FMT", (), ""))}
    rows: dict[_Message, list[bytes]] = {}
    place = data.find(MAGIC)
    while place >= 0 and place + 3 <= len(data):
        size, message = formats.get(data[place + 2], (0, None))
        if message is None or place + size > len(data) or data[place : place + 2] != MAGIC:
            place = data.find(MAGIC, place + 1)
            continue
        body = data[place + 3 : place + size]
        if data[place + 2] == _FORMAT:
            number, length, name, kinds, fields = struct.unpack("<BB4s16s64s", body)
            told = [part.rstrip(b"\0").decode("ascii", "replace") for part in (name, kinds, fields)]
            if length > 3:
                formats[number] = (length, _Message(told[0], tuple(told[2].split(",")), told[1]))
        elif message.name in MESSAGES:
            rows.setdefault(message, []).append(body)
        place += size
    return {
        message.name: columns for message, bodies in rows.items() if (columns := _columns(message, bodies))
    }


def _columns(message: _Message, bodies: list[bytes]) -> dict[str, np.ndarray]:
    """Numbers of a message's fields; none of fields that are not understood or do not fill it."""
    if len(message.fields) != len(message.kinds) or not set(message.kinds) <= _TYPES.keys():
        return {}
    places = [str(k) for k in range(len(message.kinds))]
    kind = np.dtype({"names": places, "formats": [_TYPES[each] for each in message.kinds]})
    if any(len(body) != kind.itemsize for body in bodies):
        return {}
    table = np.frombuffer(b"".join(bodies), dtype=kind)
    numbers = [k for k in range(len(places)) if kind[k].kind in "iuf"]
    return {message.fields[k]: table[places[k]] for k in numbers}


def _text(text: str) -> dict[str, dict[str, np.ndarray]]:
    """Columns of the lines of `MESSAGES` by name and field; a line that is cut off or has a word for a number is left out."""
    fields: dict[str, tuple[str, ...]] = {}
    rows: dict[str, list[list[float]]] = {}
    for cells in _lines(text):
        if cells[0] == "FMT" and len(cells) > 5:
            fields[cells[3]] = tuple(cells[5:])
        elif cells[0] in MESSAGES and len(cells) == 1 + len(fields.get(cells[0], ())):
            try:
                rows.setdefault(cells[0], []).append([float(cell) for cell in cells[1:]])
            except ValueError:
                continue
    return {
        name: dict(zip(fields[name], np.array(found).T, strict=True)) for name, found in rows.items() if found
    }


def _lines(text: str) -> Iterator[list[str]]:
    """Cells of lines with some."""
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.split(",")]
        if cells[0]:
            yield cells
