"""Motion of a skeleton as motion capture exports it, .bvh: the channels of each joint by name, then a row of numbers a frame."""

import re
from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import (
    MAX_TABLE_BYTES,
    finite_numbers,
    parse_number,
    path_text,
    printable,
    read_bytes,
    value_text,
)
from spinfilters.io.motion_file import motion_dataset
from spinfilters.io.motion_table import motion_of
from spinfilters.io.named_columns import ArrayColumns
from spinfilters.io.stated_values import SAMPLING_RATE, ReadingOptions, to_state

_CHANNELS: Final = re.compile(r"CHANNELS\s+(\d+)((?:\s+[XYZ](?:position|rotation))*)\s*")
_ROOT: Final = re.compile(r"(ROOT|JOINT)\s+(.{1,80})")


def read_bvh(path: Path, options: ReadingOptions) -> Dataset:
    """Poses of the root: its position, whose unit the user states, and the rotations about its axes in the order of its channels.

    R_ib is the product of the rotations in the order in which the channels list them, by degrees. InputError: no unit, no such
    channels, or rows of other numbers.
    """
    options.require_only(("unit",), "a .bvh")
    lines = read_bytes(path, MAX_TABLE_BYTES).decode("utf-8-sig", "replace").splitlines()
    start = next((k for k, line in enumerate(lines) if line.strip() == "MOTION"), len(lines))
    channels: list[str] = []
    body, first = "", 0
    for line in map(str.strip, lines[:start]):
        if joint := _ROOT.fullmatch(line):
            body = body or joint[2]
        elif found := _CHANNELS.fullmatch(line):
            channels += found[2].split()
            first = first or len(channels)
    own = channels[:first]
    order = "".join(name[0] for name in own if name.endswith("rotation"))
    places = [own.index(f"{axis}position") for axis in "XYZ" if f"{axis}position" in own]
    if len(order) != 3 or len(set(order)) != 3 or len(places) != 3 or len(lines) < start + 4:
        raise InputError(f"{path_text(path)}: its root has no three positions and rotations; export it again")
    if options.unit is None:
        raise InputError(
            f"{path_text(path)}: positions of a .bvh have no unit; give {to_state('unit', 'cm or m')}"
        )
    numbers = _rows(path, lines, start + 3, len(channels))
    turned = [k for k, name in enumerate(own) if name.endswith("rotation")]
    quaternions = Rotation.from_euler(order, numbers[:, turned], degrees=True).as_quat()
    time = _step(path, lines[start + 2]) * np.arange(len(numbers))
    names = ("time (s)", "px", "py", "pz", "qx", "qy", "qz", "qw")
    source = ArrayColumns(path, names, (time, *numbers[:, places].T, *quaternions.T))
    return motion_dataset(path, f"{path.name}, {printable(body)}", motion_of(source, options))


def _step(path: Path, line: str) -> float:
    """Seconds of a frame. InputError: a line that states none."""
    word, _, value = line.strip().partition(":")
    try:
        step = parse_number(value.strip()) if word == "Frame Time" else 0.0
    except ValueError:
        step = 0.0
    if not step > 0 or 1.0 / step not in SAMPLING_RATE:
        raise InputError(
            f"{path_text(path)}: {value_text(line.strip())} states no time of a frame; correct it"
        )
    return step


def _rows(path: Path, lines: list[str], first: int, count: int) -> np.ndarray:
    """Numbers of the frames. InputError: another number of them in a line."""
    rows = []
    for number, line in enumerate(lines[first:], start=first + 1):
        cells = line.split()
        if not cells:
            continue
        row = finite_numbers(cells)
        if len(row) != count:
            raise InputError(
                f"{path_text(path)}: line {number}: does not hold the {count} numbers of a frame; correct or delete it"
            )
        rows.append(row)
    stated = lines[first - 2].strip().rpartition(" ")[2].rpartition("\t")[2]
    if not rows or stated != str(len(rows)):
        raise InputError(
            f"{path_text(path)}: has {len(rows)} frames, and states {value_text(stated)}; export it again"
        )
    return np.array(rows)
