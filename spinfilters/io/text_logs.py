"""Texts that are no plain tables: rows of several sensors, messages of ROS, and counts with factors.

- Rows of several sensors: GnssLogger of Android, and the data collection of RealSense. The first cell of a row is the name of its
  sensor. GnssLogger lists the columns of each sensor in comments, RealSense in a line above each block of rows.
- Messages of ROS: what ``rostopic echo`` and ``ros2 topic echo`` print, with a line of hyphens after each; and of Gazebo, whose
  ``gz topic -e`` prints blocks in braces, with a blank line after each.
- Logs of Gyroflow, .gcsv: whole numbers with the factors that make seconds and rad/s of them.
"""

import re
from array import array
from collections.abc import Iterator, Sequence
from contextlib import suppress
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
from spinfilters.io.named_columns import ArrayColumns, TextColumns
from spinfilters.io.stated_values import NOTHING_STATED, ReadingOptions, to_state
from spinfilters.io.table_layout import read_layout

SENSORS: Final = ("Gyro", "UncalGyro", "Pose")
"""Names of sensors that describe a motion, the first that is there being taken."""
_BLOCK: Final = "Stream Type,"
_COMMENT = re.compile(r"#\s*([A-Za-z]\w*),((?:\w+,){3,}\w+)\s*")
_LONG_HEAD: Final = 1 << 16
_MEANINGS: Final = {
    **{f"3DOF_{axis}": f"omega_{axis}" for axis in "xyz"},
    **{f"t_{axis}": f"p{axis}" for axis in "xyz"},
    **{f"r_{axis}": f"q{axis}" for axis in "xyzw"},
}
"""Columns of RealSense: rates (rad/s), positions (m) and quaternions."""


def has_typed_rows(path: Path) -> bool:
    """Whether the first lines list the columns of a sensor of its own."""
    lines = first_text(path, _LONG_HEAD).splitlines()
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


_HEAD: Final = 1 << 14
_FIELD = re.compile(r"( *)([A-Za-z_]\w{0,60}):\s*(.*?)\s*")
_DEEPEST: Final = 8


def has_echoed_messages(path: Path) -> bool:
    """Whether a text begins with the header of a message, and a line of hyphens follows."""
    lines = [line.strip() for line in first_text(path, _HEAD).splitlines()]
    return (lines[:1] == ["header:"] and "---" in lines) or _has_blocks(lines)


def _has_blocks(lines: Sequence[str]) -> bool:
    """Whether the first line that holds something opens a block in braces, and some are closed."""
    begun = next((line for line in lines if line), "")
    return _BLOCK_BEGIN.fullmatch(begun) is not None and "}" in lines


def read_echoed_messages(path: Path, options: ReadingOptions) -> Dataset:
    """Motion of all whole messages of one type: rates of Imu and TwistStamped, poses of PoseStamped and Odometry."""
    options.require_only((), "a text of rostopic echo")
    require_text_table(path)
    has_blocks = _has_blocks([line.strip() for line in first_text(path, _HEAD).splitlines()])
    messages = list(_blocks(path) if has_blocks else _messages(path))
    if not messages:
        raise InputError(f"{path_text(path)}: has no whole message; record it again")
    if has_blocks:  # which leave out numbers that are 0
        every = dict.fromkeys(name for message in messages for name in message)
        messages = [dict.fromkeys(every, 0.0) | message for message in messages]
    names = [name for name in messages[0] if all(name in message for message in messages)]
    columns = {name: np.array([message[name] for message in messages]) for name in names}
    if not any(name.startswith("pose.") for name in names):  # of TwistStamped, in axes of the body
        columns = {name.replace("twist.angular.", "angular_velocity."): c for name, c in columns.items()}
    source = ArrayColumns(path, tuple(columns), tuple(columns.values()))
    return motion_dataset(path, path.name, motion_of(source, options))


def _messages(path: Path) -> Iterator[dict[str, float]]:
    """Numbers of each message by their path with dots, such as header.stamp.sec; the last only if a line of hyphens ends it.

    Raises
    ------
    InputError
        The text is no UTF-8, or nested too deep.
    """
    message: dict[str, float] = {}
    above: list[tuple[int, str]] = []
    try:
        with open(path, encoding="utf-8-sig") as stream:
            for number, line in enumerate(stream, start=1):
                if line.strip() == "---":
                    if message:
                        yield message
                    message, above = {}, []
                elif matched := _FIELD.fullmatch(line.rstrip()):
                    indent = len(matched[1])
                    above = [(depth, name) for depth, name in above if depth < indent]
                    if len(above) > _DEEPEST:
                        raise InputError(
                            f"{path_text(path)}: line {number}: is nested too deep; record a stamped message"
                        )
                    try:
                        message[".".join([*(name for _, name in above), matched[2]])] = float(matched[3])
                    except ValueError:  # a text, a list, or the name of what is below
                        above.append((indent, matched[2]))
    except UnicodeDecodeError:
        raise InputError(f"{path_text(path)}: is not UTF-8; save it as UTF-8 text") from None


_BLOCK_BEGIN: Final = re.compile(r"([A-Za-z_]\w{0,60}) ?\{")
_BLOCK_NAME: Final = re.compile(r'name: "([^"]{1,60})"')


def _blocks(path: Path) -> Iterator[dict[str, float]]:
    """Numbers of each message of blocks in braces by their path with dots, the name of a block in it; all axes of a vector.

    Raises
    ------
    InputError
        No UTF-8, or nested too deep.
    """
    message: dict[str, float] = {}
    above: list[str] = []
    try:
        with open(path, encoding="utf-8-sig") as stream:
            for number, line in enumerate(map(str.strip, stream), start=1):
                if matched := _BLOCK_BEGIN.fullmatch(line):
                    above.append(matched[1])
                    if len(above) > _DEEPEST:
                        raise InputError(
                            f"{path_text(path)}: line {number}: is nested too deep; record one message"
                        )
                    axes = "xyzw" if matched[1] in ("orientation", "rotation") else "xyz"
                    if matched[1] in _OF_AXES:
                        message |= {".".join([*above, axis]): 0.0 for axis in axes}
                elif line == "}":
                    above = above[:-1]
                elif not line and not above:
                    if message:
                        yield message
                    message = {}
                elif (named := _BLOCK_NAME.fullmatch(line)) and above:
                    above[-1] = f"{above[-1]}.{named[1].replace('.', '_')}"
                elif matched := _FIELD.fullmatch(line):
                    with suppress(ValueError):
                        message[".".join([*above, matched[2]])] = float(matched[3])
    except UnicodeDecodeError:
        raise InputError(f"{path_text(path)}: is not UTF-8; save it as UTF-8 text") from None
    if message and not above:
        yield message


_OF_AXES: Final = (
    "position",
    "orientation",
    "rotation",
    "translation",
    "angular_velocity",
    "linear_acceleration",
)
_COLUMNS: Final = ("t", "gx", "gy", "gz")


def read_gyroflow(path: Path, options: ReadingOptions) -> Dataset:
    """Rates of a log, by tscale (s) and gscale (rad/s) of its counts. InputError: no factors, or axes of a left hand."""
    options.require_only((), "a log of Gyroflow")
    cells = (line.partition(",") for line in first_text(path, _LONG_HEAD).splitlines())
    stated = {name.strip(): value.strip() for name, _, value in cells}
    second, rate = (_factor(path, name, stated.get(name, "")) for name in ("tscale", "gscale"))
    _require_right_handed(path, stated.get("orientation", "XYZ"))
    source = TextColumns(path, read_layout(path))
    missing = [name for name in _COLUMNS if name not in source.names]
    if missing:
        raise InputError(f"{path_text(path)}: has no column {', '.join(missing)}; log the gyro")
    table = source.read([source.names.index(name) for name in _COLUMNS], keys=1)
    columns = (table.values[:, 0] * second, *(table.values[:, 1:] * rate).T)
    names = ("time (s)", *(f"gyro_{axis} (rad/s)" for axis in "xyz"))
    return motion_dataset(path, path.name, motion_of(ArrayColumns(path, names, columns), NOTHING_STATED))


def _factor(path: Path, name: str, text: str) -> float:
    """A positive factor of the head. InputError: none."""
    try:
        value = parse_number(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < 1e9:
        raise InputError(
            f"{path_text(path)}: {name} is {value_text(text)}; state the factor that makes SI units of the counts"
        )
    return value


def _require_right_handed(path: Path, orientation: str) -> None:
    """Raise InputError for letters, small ones for axes that point the other way, that are no rotation of x, y and z."""
    letters = orientation.lower()
    order = ["xyz".find(letter) for letter in letters]
    if sorted(order) == [0, 1, 2]:
        is_even = order in ([0, 1, 2], [1, 2, 0], [2, 0, 1])
        turned = sum(letter.islower() for letter in orientation)
        if is_even == (turned % 2 == 0):
            return
    raise InputError(
        f"{path_text(path)}: orientation is {value_text(orientation)}, no rotation of right-handed axes; correct it, as in YxZ"
    )
