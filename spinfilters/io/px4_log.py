"""PX4 flight logs (.ulg): body rates or attitudes of one topic, read without other packages.

The format is that of PX4's documentation of ULog: a header of 16 bytes, then messages of a size, a type and a body. Formats (F)
name the fields of a topic, subscriptions (A) give it a number, and data (D) begin with that number.
"""

import re
import struct
from pathlib import Path
from typing import Final

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import path_text, printable, read_bytes, value_text
from spinfilters.io.logger_names import understood_names
from spinfilters.io.motion_columns import Quantity
from spinfilters.io.motion_file import motion_dataset
from spinfilters.io.motion_table import motion_of
from spinfilters.io.named_columns import ArrayColumns
from spinfilters.io.stated_values import ReadingOptions

LARGEST: Final = 2 * 1024**3
MAGIC: Final = b"ULog\x01\x12\x35"
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
_TYPES: Final = {
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
    columns = _columns(path, formats, topics[chosen], rows[chosen])
    bare: Quantity = "rate"
    return motion_dataset(path, path.name, motion_of(columns, options, bare))


def _messages(path: Path, data: bytes) -> tuple[dict[str, str], dict[int, str], dict[int, list[bytes]]]:
    """Fields by topic, topics by number, and the data of each number. InputError: another file."""
    if data[: len(MAGIC)] != MAGIC:
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


def _columns(path: Path, formats: dict[str, str], topic: str, rows: list[bytes]) -> ArrayColumns:
    """Columns of a topic's messages by the names of its fields. InputError: fields that are not understood."""
    names: list[str] = []
    kinds: list[str] = []
    for field in formats.get(topic, "").split(";"):
        if not field or field.split(" ")[-1].startswith("_padding"):
            continue
        matched = _FIELD.fullmatch(field)
        if matched is None or matched[1] not in _TYPES:
            break  # a message within a message: what precedes it is enough
        count = int(matched[2] or 1)
        if len(names) + count > _MOST_FIELDS:
            raise InputError(
                f"{path_text(path)}: topic {value_text(topic)} has more than {_MOST_FIELDS} numbers a message; copy it again"
            )
        names += [matched[3]] if matched[2] is None else [f"{matched[3]}[{k}]" for k in range(count)]
        kinds += [_TYPES[matched[1]]] * count
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
