"""Messages of ROS as text: what ``rostopic echo`` and ``ros2 topic echo`` print, with a line of hyphens behind each."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import first_text, path_text, require_text_table
from spinfilters.io.motion_file import motion_dataset
from spinfilters.io.motion_table import motion_of
from spinfilters.io.named_columns import ArrayColumns
from spinfilters.io.stated_values import ReadingOptions

_HEAD: Final = 1 << 14
_LINE = re.compile(r"( *)([A-Za-z_]\w{0,60}):\s*(.*?)\s*")
_DEEPEST: Final = 8


def has_echoed_messages(path: Path) -> bool:
    """Whether a text begins with the header of a message, and a line of hyphens follows."""
    lines = [line.strip() for line in first_text(path, _HEAD).splitlines()]
    return lines[:1] == ["header:"] and "---" in lines


def read_echoed_messages(path: Path, options: ReadingOptions) -> Dataset:
    """Motion of all whole messages of one type: rates of Imu and TwistStamped, poses of PoseStamped and Odometry."""
    options.require_only((), "a text of rostopic echo")
    require_text_table(path)
    messages = list(_messages(path))
    names = [name for name in messages[0] if all(name in message for message in messages)]
    columns = {name: np.array([message[name] for message in messages]) for name in names}
    if not any(name.startswith("pose.") for name in names):  # of TwistStamped, in axes of the body
        columns = {name.replace("twist.angular.", "angular_velocity."): c for name, c in columns.items()}
    source = ArrayColumns(path, tuple(columns), tuple(columns.values()))
    return motion_dataset(path, path.name, motion_of(source, options))


def _messages(path: Path) -> Iterator[dict[str, float]]:
    """Numbers of each message by their path with dots, such as header.stamp.sec; the last only if a line of hyphens ends it.

    InputError: no UTF-8, or nested too deep.
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
                elif matched := _LINE.fullmatch(line.rstrip()):
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
