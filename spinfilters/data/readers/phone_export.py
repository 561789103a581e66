"""Export folder of a phone's sensors, one table each: Gyroscope.csv, and Accelerometer.csv beside it."""

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from spinfilters.data.dataset import Dataset
from spinfilters.data.dataset_reader import DatasetReader
from spinfilters.data.motion_table import read_acceleration, read_motion_table
from spinfilters.data.readers.motion_file import motion_dataset
from spinfilters.data.stated_values import NOTHING_STATED, ReadingOptions

GYRO_TABLES: Final = ("Gyroscope.csv", "GyroscopeUncalibrated.csv")
ACCELEROMETER_TABLES: Final = ("TotalAcceleration.csv", "Accelerometer.csv", "Acceleration.csv")
"""In the order in which they are looked for: Sensor Logger calls Accelerometer what is left without gravity."""


@dataclass(frozen=True)
class PhoneExportReader(DatasetReader):
    """Folder of Sensor Logger, of phyphox' experiments of several sensors and of alike apps.

    Attributes
    ----------
    options: what the user states of the recording.
    """

    options: ReadingOptions = NOTHING_STATED
    name, order = "phone-export", 20
    words = "a phone export"

    def recognises(self, path: Path) -> bool:
        """Whether a folder holds a phone's table of rates."""
        return _table(path, GYRO_TABLES) is not None

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Rates of the phone, and its accelerometer where there is one."""
        table = read_motion_table(_table(path, GYRO_TABLES) or path, self.options, "rate")
        dataset = motion_dataset(path, f"phone recording {path.name}", table)
        beside = _table(path, ACCELEROMETER_TABLES)
        if table.acceleration is not None or beside is None or self.options.rate is not None:
            return dataset
        return replace(dataset, acceleration=read_acceleration(beside, self.options))

    def stating(self, options: ReadingOptions) -> DatasetReader:
        """The reader with what the user states of units and clock."""
        return PhoneExportReader(options)


def _table(folder: Path, names: tuple[str, ...]) -> Path | None:
    return next((folder / name for name in names if os.path.isfile(folder / name)), None)
