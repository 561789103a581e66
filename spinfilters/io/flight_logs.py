"""Logs of flight controllers: PX4 (.ulg), and ArduPilot's DataFlash (.bin, .log); read without other packages.

ULog is that of PX4's documentation: a header of 16 bytes, then messages of a size, a type and a body. Formats (F) name the fields
of a topic, subscriptions (A) give it a number, and data (D) begin with that number.

In DataFlash a message FMT gives a type its number, its length, its name, the types of its fields and their names. In the binary log
every message begins with two fixed bytes and the number, in the text every line with the name.
"""

import os
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.headings import Quantity
from spinfilters.io.input_file import path_text, printable, read_bytes, value_text
from spinfilters.io.logger_names import understood_names
from spinfilters.io.motion_file import motion_dataset
from spinfilters.io.motion_table import motion_of
from spinfilters.io.named_columns import ArrayColumns
from spinfilters.io.stated_values import ReadingOptions

LARGEST: Final = 2 * 1024**3
ULOG_BEGIN: Final = b"ULog\x01\x12\x35"
TOPICS: Final = (
    "vehicle_angular_velocity",
    "sensor_combined",
    "sensor_gyro",
    "vehicle_imu",
    "vehicle_visual_odometry",
    "vehicle_attitude",
)
"""Topics that describe a motion, the first that is there being taken."""
_HEADER: Final = 16
_MOST_FIELDS: Final = 65535  # bytes of a message, of which each number takes one at least
_MESSAGE: Final = struct.Struct("<HB")
_ULOG_TYPES: Final = {
    **{
        f"{sign}int{bits}_t": f"<{sign[:1] or 'i'}{bits // 8}"
        for sign in ("", "u")
        for bits in (8, 16, 32, 64)
    },
    "float": "<f4",
    "double": "<f8",
    "bool": "<u1",
    "char": "S1",
}
_FIELD = re.compile(r"([a-z0-9_]+)(?:\[([0-9]{1,4})\])? ([A-Za-z0-9_]+)")


def read_px4_log(path: Path, options: ReadingOptions) -> Dataset:
    """Rates or attitudes of the topic that the user states, or of the first that describes a motion."""
    options.require_only(("topic", "unit", "clock"), "a PX4 log")
    formats, topics, rows = _messages(path, read_bytes(path, LARGEST))
    wanted = TOPICS if options.topic is None else (options.topic,)
    chosen = next(
        (number for name in wanted for number, topic in topics.items() if topic == name and rows[number]),
        None,
    )
    if chosen is None:
        listed = ", ".join(sorted({printable(topics[n]) for n in rows if rows[n]})[:8]) or "nothing"
        what = f"topic {value_text(options.topic)}" if options.topic else "topic of a motion"
        raise InputError(f"{path_text(path)}: has no {what}, only {listed}; give --topic, or log {TOPICS[0]}")
    columns = _topic_columns(path, formats, topics[chosen], rows[chosen])
    bare: Quantity = "rate"
    return motion_dataset(path, path.name, motion_of(columns, options, bare))


_ULOG_TABLE: Final = re.compile(r"(.*)_(" + "|".join(TOPICS) + r")_0\.csv")


def table_of_topic(folder: Path) -> Path | None:
    """The table of the first topic that describes a motion, of those that ulog2csv writes beside it for one log; None of others."""
    found = {
        matched[2]: matched[1] for each in os.listdir(folder) if (matched := _ULOG_TABLE.fullmatch(each))
    }
    # names of tables without the number of the instance of their topic
    logs = {each.rpartition("_")[0] for each in os.listdir(folder) if each.endswith(".csv")}
    topic = next((name for name in TOPICS if name in found), None)
    if topic is None or not all(log.startswith(found[topic]) for log in logs):
        return None
    return folder / f"{found[topic]}_{topic}_0.csv"


def _messages(path: Path, data: bytes) -> tuple[dict[str, str], dict[int, str], dict[int, list[bytes]]]:
    """Fields by topic, topics by number, and the data of each number. InputError: another file."""
    if data[: len(ULOG_BEGIN)] != ULOG_BEGIN:
        raise InputError(f"{path_text(path)}: is no PX4 log (it begins otherwise); copy it again")
    formats: dict[str, str] = {}
    topics: dict[int, str] = {}
    rows: dict[int, list[bytes]] = {}
    place = _HEADER
    while place + _MESSAGE.size <= len(data):
        size, kind = _MESSAGE.unpack_from(data, place)
        body = data[place + _MESSAGE.size : place + _MESSAGE.size + size]
        place += _MESSAGE.size + size
        if len(body) < size:  # the log ends within a message where the power went
            break
        if kind == ord("F"):
            name, _, fields = body.decode("ascii", "replace").partition(":")
            formats[name] = fields
        elif kind == ord("A") and size > 3:
            (number,) = struct.unpack_from("<H", body, 1)
            topics[number] = body[3:].decode("ascii", "replace")
            rows[number] = []
        elif kind == ord("D") and size > 2:
            (number,) = struct.unpack_from("<H", body)
            if number in rows:
                rows[number].append(body[2:])
    return formats, topics, rows


def _topic_columns(path: Path, formats: dict[str, str], topic: str, rows: list[bytes]) -> ArrayColumns:
    """Columns of a topic's messages by the names of its fields. InputError: fields that are not understood."""
    names: list[str] = []
    kinds: list[str] = []
    for field in formats.get(topic, "").split(";"):
        if not field or field.split(" ")[-1].startswith("_padding"):
            continue
        matched = _FIELD.fullmatch(field)
        if matched is None or matched[1] not in _ULOG_TYPES:
            break  # a message within a message: what precedes it is enough
        count = int(matched[2] or 1)
        if len(names) + count > _MOST_FIELDS:
            raise InputError(
                f"{path_text(path)}: topic {value_text(topic)} has more than {_MOST_FIELDS} numbers a message; copy it again"
            )
        names += [matched[3]] if matched[2] is None else [f"{matched[3]}[{k}]" for k in range(count)]
        kinds += [_ULOG_TYPES[matched[1]]] * count
    if not names:
        raise InputError(
            f"{path_text(path)}: does not say what fields topic {value_text(topic)} has; copy it again"
        )
    kind = np.dtype({"names": [str(k) for k in range(len(names))], "formats": kinds})
    whole = [row[: kind.itemsize] for row in rows if len(row) >= kind.itemsize]
    table = np.frombuffer(b"".join(whole), dtype=kind)
    clocks = ("timestamp", "timestamp_sample")
    understood = zip(names, understood_names(names), strict=True)
    named = [f"{name} (us)" if name in clocks else word for name, word in understood]
    chosen = [k for k in range(len(names)) if kinds[k] != "S1"]
    if "timestamp_sample" in names:  # of the sensor; the other is that of publication
        chosen = [k for k in chosen if names[k] != "timestamp"]
    return ArrayColumns(path, tuple(named[k] for k in chosen), tuple(table[str(k)] for k in chosen))


MESSAGE_BEGIN: Final = b"\xa3\x95"
MESSAGES: Final = ("IMU", "GYR", "GYR1", "IMU2", "IMU3")
"""Messages of body rates, the first that is there being taken."""
_FORMAT, _FORMAT_SIZE = 128, 89
_DATAFLASH_TYPES: Final = {
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
    tables = (
        _binary(content) if content.startswith(MESSAGE_BEGIN) else _text(content.decode("ascii", "replace"))
    )
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
    place = data.find(MESSAGE_BEGIN)
    while place >= 0 and place + 3 <= len(data):
        size, message = formats.get(data[place + 2], (0, None))
        if message is None or place + size > len(data) or data[place : place + 2] != MESSAGE_BEGIN:
            place = data.find(MESSAGE_BEGIN, place + 1)
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
        message.name: columns
        for message, bodies in rows.items()
        if (columns := _message_columns(message, bodies))
    }


def _message_columns(message: _Message, bodies: list[bytes]) -> dict[str, np.ndarray]:
    """Numbers of a message's fields; none of fields that are not understood or do not fill it."""
    if len(message.fields) != len(message.kinds) or not set(message.kinds) <= _DATAFLASH_TYPES.keys():
        return {}
    places = [str(k) for k in range(len(message.kinds))]
    kind = np.dtype({"names": places, "formats": [_DATAFLASH_TYPES[each] for each in message.kinds]})
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
