"""Export folder of the phyphox app, whose kept segments are data sets."""

import os
from pathlib import Path

from spinfilters.data.dataset import DATASET_FILE, Dataset
from spinfilters.data.dataset_reader import DatasetReader, OnRefused
from spinfilters.data.gyro_files import PHYPHOX_TABLE, Segment
from spinfilters.data.input_file import printable
from spinfilters.data.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.data.phyphox_trials import phyphox_trial, phyphox_trials
from spinfilters.data.sensor_format import sensor_format


class PhyphoxReader(DatasetReader):
    """See `spinfilters.data.phyphox_trials`."""

    name, order = "phyphox", 10
    words = "a phyphox export"
    has_segments = True

    def recognises(self, path: Path) -> bool:
        return _phyphox_folder(path) is not None

    def read(self, path: Path, segment: int | None) -> Dataset:
        folder = _phyphox_folder(path) or path
        return _gyro_dataset(folder, *phyphox_trial(folder, segment))

    def segments(self, path: Path, on_refused: OnRefused | None) -> list[Dataset]:
        folder = _phyphox_folder(path) or path
        return [_gyro_dataset(folder, *trial) for trial in phyphox_trials(folder, on_refused)]


def _phyphox_folder(path: Path) -> Path | None:
    if path.name == PHYPHOX_TABLE and os.path.isfile(path):
        return path.parent
    is_phyphox = os.path.isfile(path / PHYPHOX_TABLE) and not os.path.isfile(path / DATASET_FILE)
    return path if is_phyphox else None


def _gyro_dataset(folder: Path, stream: MeasurementStream, segment: Segment | None) -> Dataset:
    description = f"phyphox recording {printable(folder.name)}"
    if segment is not None:
        description += f", segment {segment.number}: {printable(segment.comment)}"
    kind, log = sensor_format(stream.sensor).kind, MeasurementLog((stream,))
    return Dataset(kind=kind, log=log, path=folder, description=description, segment=segment)


READER = PhyphoxReader()
