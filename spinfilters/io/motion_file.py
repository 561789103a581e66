"""Motion tables as recordings: one file whose columns are known by their names, or a folder as EuRoC or TUM lays it out."""

import os
from pathlib import Path
from typing import Final

import numpy as np

from spinfilters.core.attitude_conversions import quaternion_from_matrix
from spinfilters.core.errors import InputError
from spinfilters.io.dataset import DATASET_FILE, LANDMARK_FILE, Dataset
from spinfilters.io.dataset_reader import StatedReader
from spinfilters.io.input_file import path_text, printable
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.io.motion_columns import Quantity
from spinfilters.io.motion_table import MotionTable, read_motion_table
from spinfilters.io.sensor_format import sensor_format, sensor_formats
from spinfilters.io.sensor_tables import TUM_COLUMNS, read_tum
from spinfilters.io.stated_values import ReadingOptions, to_state
from spinfilters.io.text_table import PREAMBLE_LINES, read_blank_separated
from spinfilters.io.truth import TRUTH_TABLE

_SUFFIXES = (".csv", ".tsv")
_TEXTS = (".txt", ".dat", ".asc", ".log", ".data")
_RATE_FILES = ("sensor_gyro", "angular_velocity", "angularvelocity", "gyroscope", "rotationrate")
_HEAD = 65536
_ALONE = "gyro.csv"  # the one table of a folder that is a data set without it


class MotionFileReader(StatedReader):
    """Reader of a motion table; see `spinfilters.io.motion_table`."""

    name, order = "motion-table", 95
    words = "a gyro .csv"

    def recognises(self, path: Path) -> bool:
        """Whether a file is a single table, by suffix and name, and not a part of a data set folder."""
        suffix = path.suffix.lower()
        if path.name in _parts() or os.path.isdir(path):
            return False
        return suffix in _SUFFIXES or (suffix in _TEXTS and not _is_poses_alone(path))

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Data set of the table; its columns are known by their names, those of KITTI's poses by their number."""
        if self.options.columns is None and (poses := read_transforms(path, self.options)) is not None:
            return motion_dataset(path, path.name, poses)
        return motion_dataset(path, path.name, read_motion_table(path, self.options, bare_quantity(path)))


_TRANSFORM: Final = 12


def read_transforms(path: Path, options: ReadingOptions) -> MotionTable | None:
    """Poses as KITTI writes them: twelve numbers a row, [R_ib t] row by row, in m and without a clock; None of another table.

    Parameters
    ----------
    path : Path
        The table.
    options : ReadingOptions
        Have to state the rate.

    Raises
    ------
    InputError
        No rate; a matrix that is no rotation.
    """
    if _first_cells(path) != _TRANSFORM:
        return None
    if options.rate is None:
        raise InputError(
            f"{path_text(path)}: twelve numbers a row are poses without a clock, as KITTI's; give {to_state('rate', 'HZ')}"
        )
    options.require_only(("rate",), "a table of poses without a clock")
    table = read_blank_separated(path, [f"T{row}{column}" for row in range(3) for column in range(4)])
    matrices = table.values.reshape(-1, 3, 4)
    R = matrices[:, :, :3]
    # R R' = 1 and det R = 1, to the digits of a text
    away = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    wrong = np.flatnonzero((away > _ROTATION_ERROR) | (np.linalg.det(R) < 0))
    if wrong.size:
        raise table.error(int(wrong[0]), "is no rotation and place [R t]; correct or delete the line")
    time = np.arange(len(R)) / options.rate
    stream = MeasurementStream("pose", time, np.column_stack([matrices[:, :, 3], quaternion_from_matrix(R)]))
    return MotionTable(stream, None, (f"clock of {options.rate:g} Hz as stated",))


_ROTATION_ERROR: Final = 1e-3


def _first_cells(path: Path) -> int:
    """How many numbers between blanks the first line holds; 0 of words."""
    try:
        with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb") as stream:
            cells = stream.readline(_HEAD).split()
        [float(cell) for cell in cells]
    except (OSError, ValueError):
        return 0
    return len(cells)


def bare_quantity(path: Path) -> Quantity | None:
    """Quantity of columns called x, y and z alone, as the name of their file says."""
    stem = path.stem.lower()
    is_rate = stem.startswith("gyro") or any(word in stem for word in _RATE_FILES)
    return "rate" if is_rate else None


def _is_poses_alone(path: Path) -> bool:
    """Whether the first bytes of a text look like poses in the TUM format: eight numbers between blanks, or no numbers at all."""
    try:
        with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb") as stream:
            head = stream.read(_HEAD).decode("utf-8", "replace")
    except OSError:
        return True
    for line in head.splitlines()[:PREAMBLE_LINES]:
        if line.strip() and not line.lstrip().startswith("#"):
            cells = line.split()
            return len(cells) == len(TUM_COLUMNS) and not any(c.isalpha() and c not in "eE" for c in line)
    return True


def motion_dataset(path: Path, name: str, table: MotionTable) -> Dataset:
    """Data set of a motion table or of an export."""
    description = "; ".join((printable(name), *table.remarks))
    return Dataset(
        kind=sensor_format(table.stream.sensor).kind,
        log=MeasurementLog((table.stream,)),
        path=path,
        description=description,
        acceleration=table.acceleration,
    )


def _parts() -> set[str]:
    """Tables of data set folders, which describe nothing alone."""
    files = {form.file for form in sensor_formats().values() if not form.suffixes} - {_ALONE}
    return files | {DATASET_FILE, LANDMARK_FILE, TRUTH_TABLE}


_RATE_TABLES: Final = ("imu0/data.csv", "imu/data.csv", "imu.csv", "imu.txt")
"""Tables of rates, relative to the root."""
_POSE_TABLES: Final = (
    "groundtruth.txt",
    "state_groundtruth_estimate0/data.csv",
    "vicon0/data.csv",
    "mocap0/data.csv",
    "gt/data.csv",
)
"""Tables of poses."""


class LoggerFolderReader(StatedReader):
    """Root of a recording in the layout of EuRoC or TUM: its rates, or its poses where it has no rates."""

    name, order = "logger-folder", 25
    words = "a folder of EuRoC or TUM"

    def recognises(self, path: Path) -> bool:
        """Whether a folder, or mav0 in it, holds one of the tables."""
        return os.path.isdir(path) and _table(path) is not None

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Data set of the table."""
        table = _table(path) or path
        if table.name == "groundtruth.txt":
            self.options.require_only((), "a folder of TUM")
            stream = read_tum(table)
            return Dataset(kind="pose", log=MeasurementLog((stream,)), path=path, description=path.name)
        measured = read_motion_table(table, self.options)
        return motion_dataset(path, f"{path.name}, {table.relative_to(path)}", measured)


def _table(folder: Path) -> Path | None:
    """The first of the tables in a folder or in its mav0."""
    roots = (folder, folder / "mav0")
    tables = (root / name for name in (*_RATE_TABLES, *_POSE_TABLES) for root in roots)
    return next((table for table in tables if os.path.isfile(table)), None)
