"""Motion tables as recordings: one file whose columns are known by their names, or a folder as EuRoC or TUM lays it out."""

import os
from pathlib import Path
from typing import Final

from spinfilters.io.dataset import DATASET_FILE, LANDMARK_FILE, Dataset
from spinfilters.io.dataset_reader import StatedReader
from spinfilters.io.input_file import printable
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.io.motion_columns import Quantity
from spinfilters.io.motion_table import MotionTable, read_motion_table
from spinfilters.io.sensor_format import sensor_format, sensor_formats
from spinfilters.io.sensor_tables import TUM_COLUMNS, read_tum
from spinfilters.io.text_table import PREAMBLE_LINES
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
        """Data set of the table; its columns are known by their names."""
        return motion_dataset(path, path.name, read_motion_table(path, self.options, bare_quantity(path)))


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
