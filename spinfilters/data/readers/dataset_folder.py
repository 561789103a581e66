"""Folder with dataset.toml and a table per sensor."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from spinfilters.data.covariance_files import with_covariance
from spinfilters.data.dataset import (
    DATASET_FILE,
    INSPECTOR_FILE,
    LANDMARK_FILE,
    Dataset,
    calibrations_of,
    require_cover,
)
from spinfilters.data.dataset_options import DatasetOptions, options_from_toml, with_told_deviations
from spinfilters.data.dataset_reader import DatasetReader
from spinfilters.data.input_file import path_text, printable, read_toml, require_folder, value_text
from spinfilters.data.known_map import read_landmarks
from spinfilters.data.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.data.pose_files import read_tum
from spinfilters.data.raw_data import RawDataReader
from spinfilters.data.sensor_files import read_sensor_file
from spinfilters.data.sensor_format import SensorFormat, dataset_kinds, sensor_formats
from spinfilters.data.table_files import read_header
from spinfilters.data.truth import TRUTH_FILES, Truth, read_truth
from spinfilters.errors import InputError

_FRONT_ENDS = {
    "stereo-images": "tracks.csv with kind = 'stereo-tracks' ('spinfilters track' makes it of images in cam0/data and cam1/data)",
    "lidar-scans": "poses.tum of the registered scans with kind = 'pose'",
}


@dataclass(frozen=True)
class DatasetFolderReader(DatasetReader):
    """Folders with a dataset.toml, asked first: whatever else lies there is part of the data set.

    Attributes
    ----------
    front_end: gives the maker of measurements from raw data of a kind, None where there is none.
    """

    front_end: Callable[[str], RawDataReader | None]
    name, order = "folder", 0
    words = "a folder"

    def recognises(self, path: Path) -> bool:
        """Whether a path is a folder with a dataset.toml."""
        return os.path.lexists(path / DATASET_FILE)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Data set of the folder."""
        return _read_folder(path, self.front_end)


@dataclass(frozen=True)
class OtherFolderReader(DatasetReader):
    """Any folder that no other reader recognises: refused with what it lacks.

    Attributes
    ----------
    recordings_in: gives the recordings in a folder that is none itself.
    """

    recordings_in: Callable[[Path], Sequence[Path]]
    name, order = "other-folder", 90
    words = DatasetFolderReader.words

    def recognises(self, path: Path) -> bool:
        """Whether a path is a folder."""
        return os.path.isdir(path)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """InputError: always."""
        require_folder(path)
        raise _undescribed(path, self.recordings_in(path))


def _read_folder(folder: Path, front_end: Callable[[str], RawDataReader | None]) -> Dataset:
    require_folder(folder)
    kinds = dataset_kinds()
    path = folder / DATASET_FILE
    document = read_toml(path)
    kind, description = _text(path, document, "kind"), _text(path, document, "description", "")
    reader = None if kind in kinds else front_end(kind)
    if reader is not None:
        return _read_raw(folder, reader, description, options_from_toml(path, document))
    if kind in _FRONT_ENDS:
        raise _no_front_end(path, kind)
    if kind not in kinds:
        raise InputError(
            f"{path_text(path)}: kind is {value_text(kind)}, expected one of {', '.join(kinds)}; correct it"
        )
    log, options = _read_log(folder, kinds[kind]), options_from_toml(path, document)
    landmarks, cameras = folder / LANDMARK_FILE, calibrations_of(log)
    return Dataset(
        kind=kind,
        log=log,
        path=folder,
        description=description,
        truth=_told_truth(folder),
        rig=cameras[0].read(folder) if cameras else None,
        known_map=read_landmarks(landmarks) if os.path.lexists(landmarks) else None,
        inspector=_read_inspector(folder, log),
        options=with_told_deviations(options, folder) if cameras else options,
    )


def _undescribed(folder: Path, recordings: Sequence[Path]) -> InputError:
    """Error of a folder without dataset.toml, by what lies there instead."""
    if os.path.isfile(folder / "cam0" / "data.csv"):
        return _no_front_end(folder, "stereo-images")
    if recordings:
        such = f"{len(recordings)} recordings, such as {printable(recordings[0].name)}"
        return InputError(
            f"{path_text(folder)}: holds {such}; give one of them, or take the free flights in all with --segment auto"
        )
    return InputError(
        f"{path_text(folder / DATASET_FILE)}: no such file; write it with a line kind = '...' "
        f"({', '.join(dataset_kinds())}), or check the path"
    )


def _read_raw(folder: Path, reader: RawDataReader, description: str, options: DatasetOptions) -> Dataset:
    """Measurements made from raw data, with those of other sensors in the folder."""
    made = reader.read(folder, _told_truth(folder))
    read = [_with_own_covariance(form, folder) for form in _stored(folder, None)]
    log = MeasurementLog((made.stream, *read))
    options = replace(options, covariance_inflation=made.inflation)
    cameras = calibrations_of(log)
    return Dataset(
        kind=reader.made,
        log=log,
        path=folder,
        description="; ".join(words for words in (description, *made.remarks) if words),
        truth=made.truth,
        rig=cameras[0].read(folder) if cameras else None,
        inspector=_read_inspector(folder, log) if cameras else None,
        options=with_told_deviations(options, folder) if cameras else options,
        doubts=made.doubts,
    )


def _told_truth(folder: Path) -> Truth | None:
    """Truth that a folder tells, None without its files. InputError: `read_truth`."""
    return read_truth(folder) if any(os.path.lexists(folder / name) for name in TRUTH_FILES) else None


def _read_inspector(folder: Path, log: MeasurementLog) -> MeasurementStream | None:
    """Poses (t_ic m, q_ic) of the folder's inspector, None without a file. InputError: `read_tum`, `require_cover`."""
    path = folder / INSPECTOR_FILE
    if not os.path.lexists(path):
        return None
    stream = read_tum(path)
    try:
        require_cover(stream, log)
    except InputError as error:
        raise InputError(f"{path_text(path)}: {error}") from None
    return stream


def _read_log(folder: Path, required: SensorFormat) -> MeasurementLog:
    return MeasurementLog(tuple(_with_own_covariance(form, folder) for form in _stored(folder, required)))


def _with_own_covariance(form: SensorFormat, folder: Path) -> MeasurementStream:
    """Stream of a sensor with the covariances of its rows, if any."""
    stream, covariance = read_sensor_file(form, folder / form.file), folder / form.covariance_file
    return with_covariance(stream, covariance) if os.path.lexists(covariance) else stream


def _stored(folder: Path, required: SensorFormat | None) -> list[SensorFormat]:
    """The formats whose files a folder holds.

    Among formats with the same file it is the required one's, or has the header of one.
    """
    by_file: dict[str, list[SensorFormat]] = {}
    for form in sensor_formats().values():
        by_file.setdefault(form.file, []).append(form)
    found = []
    for file, formats in by_file.items():
        if required is not None and required in formats:
            found.append(required)
        elif os.path.lexists(folder / file):
            fits = [
                form for form in formats if len(formats) == 1 or read_header(folder / file) == form.header
            ]
            found.append([*formats, *fits][-1])
    return found


def _no_front_end(path: Path, kind: str) -> InputError:
    return InputError(
        f"{path_text(path)}: kind '{kind}' needs a front end that is not part of this version; supply "
        f"{_FRONT_ENDS[kind]}"
    )


def _text(path: Path, document: dict[str, Any], key: str, default: str | None = None) -> str:
    value = document.get(key, default)
    if value is None:
        kinds = ", ".join(dataset_kinds())
        raise InputError(f"{path_text(path)}: has no {key}; add {key} = '...', one of {kinds}")
    if not isinstance(value, str):
        raise InputError(f"{path_text(path)}: {key} is {value_text(value)}, expected text; put it in quotes")
    return value
