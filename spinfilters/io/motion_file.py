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
from spinfilters.io.truth import TRUTH_TABLE

_SUFFIXES = (".csv", ".tsv")
_ALONE = "gyro.csv"  # the one table of a folder that is a data set without it


class MotionFileReader(StatedReader):
    """Reader of a motion table; see `spinfilters.io.motion_table`."""

    name, order = "motion-table", 95
    words = "a gyro .csv"

    def recognises(self, path: Path) -> bool:
        """Whether a file is a single table, by suffix and name, and not a part of a data set folder."""
        return path.suffix.lower() in _SUFFIXES and path.name not in _parts() and not os.path.isdir(path)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Data set of the table; its columns are known by their names."""
        bare: Quantity | None = "rate" if path.stem.lower().startswith("gyro") else None
        return motion_dataset(path, path.name, read_motion_table(path, self.options, bare))


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
