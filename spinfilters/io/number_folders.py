"""Folders whose tables hold numbers without names: the inertial unit of raw KITTI, the output of the simulator 42, and matrices.

Scanners and recorders of depth images write the pose of each image into a text of its own, ``frame-000012.pose.txt``, as a matrix.
"""

import os
import re
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import quaternion_from_matrix
from spinfilters.core.errors import InputError
from spinfilters.io.calendar_clock import seconds_of_clock
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import (
    finite_numbers,
    first_text,
    path_text,
    printable,
    read_settings_text,
    value_text,
)
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.motion_file import motion_dataset
from spinfilters.io.motion_table import MotionTable, rotations_of
from spinfilters.io.sensor_tables import require_clock
from spinfilters.io.stated_values import RATE, ReadingOptions, to_state
from spinfilters.io.table_layout import TableLayout
from spinfilters.io.text_table import Table, read_blank_separated

_KITTI_RATES: Final = slice(17, 20)
"""Of the numbers of a KITTI file: about the forward, left and up axes of the unit, rad/s; 11 to 13 are the accelerations."""
_KITTI_NUMBERS: Final = 30
_MOST_FILES: Final = 1_000_000
_TIME_42 = "time.42"
_RATES_42, _ATTITUDES_42 = ("wbn.42", "wbn00.42"), ("qbn.42", "qbn00.42")
"""Of the only spacecraft, and of the first of several; rad/s, and scalar last."""


def read_kitti_folder(path: Path, options: ReadingOptions) -> Dataset:
    """Rates of a drive of raw KITTI: a file for each epoch in oxts/data, their times in oxts/timestamps.txt."""
    options.require_only((), "a drive of raw KITTI")
    folder = oxts_folder(path) or path
    stamps = read_settings_text(folder / "timestamps.txt").split("\n")
    times = [seconds_of_clock(line) for line in stamps if line.strip()]
    files = sorted(file for file in (folder / "data").iterdir() if file.suffix == ".txt")
    if len(files) != len(times) or len(files) > _MOST_FILES:
        raise InputError(
            f"{path_text(folder)}: has {len(files)} files in data and {len(times)} times; copy it again"
        )
    if None in times:
        row = times.index(None)
        raise InputError(
            f"{path_text(folder / 'timestamps.txt')}: line {row + 1}: {value_text(stamps[row])} is no date; correct it"
        )
    values = np.column_stack([np.array(times, dtype=np.float64), [_oxts_rates(file) for file in files]])
    return motion_dataset(path, path.name, _motion("gyro", folder / "timestamps.txt", values))


def oxts_folder(path: Path) -> Path | None:
    """The folder with the times and the files of the inertial unit: a path, or oxts in it."""
    places = (path, path / "oxts")
    return next(
        (
            p
            for p in places
            if os.path.isfile(p / "timestamps.txt")
            and os.path.isdir(p / "data")
            and os.path.isfile(p / "dataformat.txt")
        ),
        None,
    )


def _oxts_rates(file: Path) -> list[float]:
    """The rates of one epoch. InputError: not 30 numbers."""
    cells = read_settings_text(file).split()
    numbers = finite_numbers(cells)
    if len(numbers) != _KITTI_NUMBERS:
        raise InputError(f"{path_text(file)}: does not hold {_KITTI_NUMBERS} numbers; copy it again")
    return numbers[_KITTI_RATES]


def read_simulator_42(path: Path, options: ReadingOptions) -> Dataset:
    """Rates (rad/s) that the simulator 42 wrote, else attitudes."""
    options.require_only((), "a folder of the simulator 42")
    is_reference = any(os.path.isfile(path / name) for name in (_RATES_42[0], _ATTITUDES_42[0]))
    others = sorted(each.name for each in path.glob("[wq]bn0[1-9].42"))
    if others and not is_reference:
        raise InputError(
            f"{path_text(path)}: holds several spacecraft, such as {printable(others[0])}; copy time.42 and the files of one "
            "into a folder, as wbn.42 and qbn.42"
        )
    file = next(name for name in (*_RATES_42, *_ATTITUDES_42) if os.path.isfile(path / name))
    is_rates = file in _RATES_42
    names = ("wx", "wy", "wz") if is_rates else ("qx", "qy", "qz", "qw")
    time = read_blank_separated(path / _TIME_42, ("time_s",)).values
    values = read_blank_separated(path / file, names).values
    if len(time) != len(values):
        raise InputError(
            f"{path_text(path)}: {file} has {len(values)} rows and {_TIME_42} has {len(time)}; run the simulator to its end"
        )
    rows = np.column_stack([time, values])
    return motion_dataset(path, path.name, _motion("gyro" if is_rates else "attitude", path / file, rows))


_NUMBERED: Final = re.compile(r"(.*?)(\d+)((?:\.[A-Za-z_]+)*\.(?:txt|dat|pose|mat|tfm|xf))", re.IGNORECASE)
_FEWEST_MATRICES: Final = 5
_LARGEST_MATRIX: Final = 1024
"""Bytes of a text of one matrix."""


def matrix_files(path: Path) -> dict[int, Path]:
    """Texts of one name in a folder, by their numbers, if the first two hold a matrix 3 x 4 or 4 x 4 each; else none."""
    found: dict[tuple[str, str], dict[int, Path]] = {}
    try:
        files = [each for each in os.scandir(path) if each.is_file()]
    except OSError:
        return {}
    for file in files:
        if matched := _NUMBERED.fullmatch(file.name):
            found.setdefault((matched[1], matched[3]), {})[int(matched[2])] = Path(file.path)
    for own in found.values():
        first = [own[number] for number in sorted(own)[:2]]
        if len(own) >= _FEWEST_MATRICES and all(_matrix_of(file) is not None for file in first):
            return dict(sorted(own.items()))
    return {}


def _matrix_of(file: Path) -> Float[np.ndarray, "3 4"] | None:
    """[R t] of a text of 12 or 16 numbers, the last four 0 0 0 1; None of another."""
    text = first_text(file, _LARGEST_MATRIX + 1)
    numbers = finite_numbers(text.replace(",", " ").split())
    is_whole = len(numbers) == 12 or (len(numbers) == 16 and numbers[12:] == [0, 0, 0, 1])
    return np.array(numbers[:12]).reshape(3, 4) if is_whole and len(text) <= _LARGEST_MATRIX else None


def read_matrix_folder(path: Path, options: ReadingOptions) -> Dataset:
    """Poses of the texts of a folder, at the stated rate, in which missing numbers leave gaps.

    InputError: no rate; a text that holds no matrix, or a matrix that is no rotation.
    """
    options.require_only(("rate",), "a folder with a matrix in each file")
    files = matrix_files(path)
    if options.rate is None:
        raise InputError(
            f"{path_text(path)}: has the poses of {len(files)} files and no clock; give {to_state('rate', 'HZ')}"
        )
    matrices = [_matrix_of(file) for file in files.values()]
    wrong = next((file for file, each in zip(files.values(), matrices, strict=True) if each is None), None)
    if wrong is not None:
        raise InputError(f"{path_text(wrong)}: is no matrix 3 x 4 or 4 x 4; correct or delete the file")
    time, names = np.array(list(files)) / options.rate, ("time_s", *(f"T{k // 4}{k % 4}" for k in range(12)))
    held = np.array(matrices)
    table = Table(
        path,
        TableLayout(names, header_line=0),
        names,
        np.column_stack([time, held.reshape(-1, 12)]),
        list(files),
        counted="file",
    )
    q = quaternion_from_matrix(rotations_of(table, held[:, :, :3]))
    stream = MeasurementStream("pose", time, np.column_stack([held[:, :, 3], q]))
    return motion_dataset(
        path, path.name, MotionTable(stream, None, (f"clock of {options.rate:g} Hz as stated",))
    )


def _motion(sensor: str, path: Path, values: Float[np.ndarray, "n m"]) -> MotionTable:
    """Measurements of a table with its time in front. InputError: its clock or its values."""
    names = ("time_s", *(f"column {k}" for k in range(2, values.shape[1] + 1)))
    table = Table(path, TableLayout(names, header_line=0), names, values, range(1, len(values) + 1))
    require_clock(table)
    table.require(slice(1, None), RATE)  # components of quaternions are smaller
    with table.naming_lines():
        return MotionTable(MeasurementStream(sensor, values[:, 0], values[:, 1:]), None, ())
