"""Folders whose tables hold numbers without names: the inertial unit of raw KITTI, and the output of the simulator 42."""

import os
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.io.calendar_clock import seconds_of_clock
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import path_text, read_settings_text, value_text
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.motion_file import motion_dataset
from spinfilters.io.motion_table import MotionTable
from spinfilters.io.sensor_tables import require_clock
from spinfilters.io.stated_values import RATE, ReadingOptions
from spinfilters.io.table_layout import TableLayout
from spinfilters.io.text_table import Table, read_blank_separated

_KITTI_RATES: Final = slice(17, 20)
"""Of the numbers of a KITTI file: about the forward, left and up axes of the unit, rad/s; 11 to 13 are the accelerations."""
_KITTI_NUMBERS: Final = 30
_MOST_FILES: Final = 1_000_000
_TIME_42, _RATES_42, _ATTITUDES_42 = "time.42", "wbn.42", "qbn.42"  # rad/s, scalar last


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
    try:
        numbers = [float(cell) for cell in cells]
    except ValueError:
        numbers = []
    if len(numbers) != _KITTI_NUMBERS or not np.isfinite(numbers).all():
        raise InputError(f"{path_text(file)}: does not hold {_KITTI_NUMBERS} numbers; copy it again")
    return numbers[_KITTI_RATES]


def read_simulator_42(path: Path, options: ReadingOptions) -> Dataset:
    """Rates (rad/s) that the simulator 42 wrote, else attitudes."""
    options.require_only((), "a folder of the simulator 42")
    is_rates = os.path.isfile(path / _RATES_42)
    file, names = (_RATES_42, ("wx", "wy", "wz")) if is_rates else (_ATTITUDES_42, ("qx", "qy", "qz", "qw"))
    time = read_blank_separated(path / _TIME_42, ("time_s",)).values
    values = read_blank_separated(path / file, names).values
    if len(time) != len(values):
        raise InputError(
            f"{path_text(path)}: {file} has {len(values)} rows and {_TIME_42} has {len(time)}; run the simulator to its end"
        )
    rows = np.column_stack([time, values])
    return motion_dataset(path, path.name, _motion("gyro" if is_rates else "attitude", path / file, rows))


def _motion(sensor: str, path: Path, values: Float[np.ndarray, "n m"]) -> MotionTable:
    """Measurements of a table with its time in front. InputError: its clock or its values."""
    names = ("time_s", *(f"column {k}" for k in range(2, values.shape[1] + 1)))
    table = Table(path, TableLayout(names, header_line=0), names, values, range(1, len(values) + 1))
    require_clock(table)
    table.require(slice(1, None), RATE)  # components of quaternions are smaller
    with table.naming_lines():
        return MotionTable(MeasurementStream(sensor, values[:, 0], values[:, 1:]), None, ())
