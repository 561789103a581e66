"""A motion table as a recording: one file whose columns are known by their names."""

import os
from pathlib import Path

from spinfilters.io.dataset import DATASET_FILE, LANDMARK_FILE, Dataset
from spinfilters.io.dataset_reader import StatedReader
from spinfilters.io.input_file import printable
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.io.motion_columns import Quantity
from spinfilters.io.motion_table import MotionTable, read_motion_table
from spinfilters.io.sensor_format import sensor_format, sensor_formats
from spinfilters.io.sensor_tables import TUM_COLUMNS
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
    """Quantity of columns called x, y and z alone, as the name of their file tells."""
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
    """Tables of data set folders, which tell nothing alone."""
    files = {form.file for form in sensor_formats().values() if not form.suffixes} - {_ALONE}
    return files | {DATASET_FILE, LANDMARK_FILE, TRUTH_TABLE}
