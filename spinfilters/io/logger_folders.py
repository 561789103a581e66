"""Folders as loggers and benchmarks lay them out: EuRoC (mav0), TUM, and flight logs turned into tables."""

import os
from pathlib import Path
from typing import Final

from spinfilters.io.dataset import Dataset
from spinfilters.io.dataset_reader import StatedReader
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.io.motion_file import motion_dataset
from spinfilters.io.motion_table import read_motion_table
from spinfilters.io.sensor_tables import read_tum

RATES: Final = ("imu0/data.csv", "imu/data.csv", "imu.csv", "imu.txt")
"""Tables of rates, relative to the root."""
POSES: Final = (
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
    tables = (root / name for name in (*RATES, *POSES) for root in roots)
    return next((table for table in tables if os.path.isfile(table)), None)
