"""A data set: measurements of one body with what is known about them, read from a folder or a file.

A folder holds `dataset.toml` (kind, description, noise) and the tables of its sensors; an export of the
phyphox app and a single gyro or TUM file are read as they are.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

from spinfilters.errors import InputError
from spinfilters.logs.camera import Rig
from spinfilters.logs.covariance_files import with_covariance
from spinfilters.logs.dataset_options import DatasetOptions, options_from_toml
from spinfilters.logs.gyro_files import PHYPHOX_TABLE, Segment
from spinfilters.logs.input_file import named, printable, require_file, require_folder, shown
from spinfilters.logs.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.logs.phyphox_trials import OnRefused, phyphox_trial, phyphox_trials
from spinfilters.logs.raw_data import RawDataReader, raw_data_reader
from spinfilters.logs.sensor_files import read_sensor_file
from spinfilters.logs.sensor_format import (
    CalibrationFiles,
    SensorFormat,
    dataset_kinds,
    sensor_format,
    sensor_formats,
)
from spinfilters.logs.settings_files import read_toml
from spinfilters.logs.table_files import read_header
from spinfilters.logs.track_files import KnownMap, read_landmarks
from spinfilters.logs.truth import TRUTH_TABLE, Truth, read_truth

DATASET_FILE: Final[str] = "dataset.toml"
LANDMARK_FILE: Final[str] = "landmarks.csv"
_FRONT_ENDS = {
    "stereo-images": "tracks.csv of rectified feature tracks with kind = 'stereo-tracks'",
    "lidar-scans": "poses.tum of the registered scans with kind = 'pose'",
}
_LARGEST_FILE = 2**63  # the reader that follows has its own limit


@dataclass(frozen=True, eq=False, kw_only=True)
class Dataset:
    """Measurements with what is known about them.

    Parameters
    ----------
    kind: of `dataset_kinds`.   log: with the sensor of that kind; other sensors may be there too.
    path: where it was read, None when made in memory.
    truth, rig, known_map: None where not known; measurements of a camera need its rig.
    segment: the marked stretch of a phyphox recording that this is, None otherwise.

    Raises
    ------
    InputError: unknown kind, a log without its sensor, measurements of a camera without its rig.
    """

    kind: str
    log: MeasurementLog
    path: Path | None = None
    description: str = ""
    truth: Truth | None = None
    rig: Rig | None = None
    known_map: KnownMap | None = None
    options: DatasetOptions = field(default_factory=DatasetOptions)
    segment: Segment | None = None

    def __post_init__(self) -> None:
        kinds = dataset_kinds()
        if self.kind not in kinds:
            raise InputError(f"kind {shown(self.kind)} is unknown; use {', '.join(kinds)}")
        self.log.stream(self.sensor)
        for sensor in self.log.sensors:
            calibration = sensor_format(sensor).calibration
            if calibration is not None and not isinstance(self.rig, calibration.kind):
                raise InputError(
                    f"{sensor} measurements need a rig ({calibration.kind.__name__}); give the camera's calibration"
                )

    @property
    def sensor(self) -> str:
        """The sensor that its kind says it must have."""
        return dataset_kinds()[self.kind].name

    @property
    def calibrations(self) -> tuple[CalibrationFiles, ...]:
        """Files of the rig."""
        return _calibrations(self.log)

    @property
    def name(self) -> str:
        """Where it was read, with the segment, or what it is: how an error names it."""
        place = printable(self.description) or "the data set" if self.path is None else named(self.path)
        return place if self.segment is None else f"{place}, segment {self.segment.number}"

    @contextmanager
    def naming(self) -> Iterator[None]:
        """Put `name` in front of every InputError about the measurements, which do not know where they come from."""
        try:
            yield
        except InputError as error:
            raise InputError(f"{self.name}: {error}") from None


def read_dataset(path: str | os.PathLike[str], segment: int | None = None) -> Dataset:
    """The data set of a folder with dataset.toml, of a phyphox folder, of a gyro .csv or a TUM .tum or .txt.

    Parameters
    ----------
    segment: number of a kept segment of a phyphox recording; None where there is only one.

    Raises
    ------
    InputError: an unusable file (see the readers), several segments and none chosen, a segment that is not a
    trial, a kind whose front end is not part of this version. The text names file, line or value, and the
    cure.
    """
    folder = _phyphox_folder(Path(path))
    if folder is not None:
        return _gyro_dataset(folder, *phyphox_trial(folder, segment))
    if segment is not None:
        raise InputError(f"{named(Path(path))}: has no segments; leave out --segment {segment}")
    return _read_folder(Path(path)) if os.path.isdir(path) else _read_file(Path(path))


def read_segments(path: str | os.PathLike[str], on_refused: OnRefused | None = None) -> list[Dataset]:
    """Every kept segment of a phyphox folder; of any other path its one data set. Errors: `read_dataset`.

    Parameters
    ----------
    on_refused: called with the number of a segment that is no trial, and why, instead of raising InputError for it.
    """
    folder = _phyphox_folder(Path(path))
    if folder is None:
        return [read_dataset(path)]
    trials = phyphox_trials(folder, on_refused)
    return [_gyro_dataset(folder, stream, segment) for stream, segment in trials]


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


def _read_folder(folder: Path) -> Dataset:
    require_folder(folder)
    kinds = dataset_kinds()
    path = folder / DATASET_FILE
    if not os.path.lexists(path):
        if os.path.isfile(folder / "cam0" / "data.csv"):
            raise _no_front_end(folder, "stereo-images")
        raise InputError(
            f"{named(path)}: no such file; write it with a line kind = '...' ({', '.join(kinds)}), or check "
            "the path"
        )
    document = read_toml(path)
    kind, description = _text(path, document, "kind"), _text(path, document, "description", "")
    reader = raw_data_reader(kind) if kind in _FRONT_ENDS else None
    if reader is not None:
        return _read_raw(folder, reader, description, options_from_toml(path, document))
    if kind in _FRONT_ENDS:
        raise _no_front_end(path, kind)
    if kind not in kinds:
        raise InputError(
            f"{named(path)}: kind is {shown(kind)}, expected one of {', '.join(kinds)}; correct it"
        )
    log = _read_log(folder, kinds[kind])
    landmarks, cameras = folder / LANDMARK_FILE, _calibrations(log)
    return Dataset(
        kind=kind,
        log=log,
        path=folder,
        description=description,
        truth=read_truth(folder),
        rig=cameras[0].read(folder) if cameras else None,
        known_map=read_landmarks(landmarks) if os.path.lexists(landmarks) else None,
        options=options_from_toml(path, document),
    )


def _read_raw(folder: Path, reader: RawDataReader, description: str, options: DatasetOptions) -> Dataset:
    """Measurements made from raw data, with those of other sensors in the folder."""
    stream, truth, remarks = reader.read(folder, read_truth(folder))
    read = [_with_own_covariance(form, folder) for form in _stored(folder, None)]
    log = MeasurementLog((stream, *read))
    cameras = _calibrations(log)
    return Dataset(
        kind=reader.made,
        log=log,
        path=folder,
        description="; ".join(words for words in (description, remarks) if words),
        truth=truth,
        rig=cameras[0].read(folder) if cameras else None,
        options=options,
    )


def _calibrations(log: MeasurementLog) -> tuple[CalibrationFiles, ...]:
    """Of the cameras in a log."""
    formats = [sensor_format(sensor) for sensor in log.sensors]
    return tuple(form.calibration for form in formats if form.calibration is not None)


def _read_log(folder: Path, required: SensorFormat) -> MeasurementLog:
    return MeasurementLog(tuple(_with_own_covariance(form, folder) for form in _stored(folder, required)))


def _with_own_covariance(form: SensorFormat, folder: Path) -> MeasurementStream:
    """Stream of a sensor in a folder, with the covariances of its rows where there are any."""
    stream, covariance = read_sensor_file(form, folder / form.file), folder / form.covariance_file
    return with_covariance(stream, covariance) if os.path.lexists(covariance) else stream


def _stored(folder: Path, required: SensorFormat | None) -> list[SensorFormat]:
    """The formats whose files a folder holds. Of formats with the same file it is the required one's, or has the header of one."""
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


def _read_file(path: Path) -> Dataset:
    require_file(path, _LARGEST_FILE)
    formats = sensor_formats().values()
    parts = [form.file for form in formats if not form.suffixes]
    if path.name in (DATASET_FILE, LANDMARK_FILE, TRUTH_TABLE, *parts):
        raise InputError(f"{named(path)}: is one part of a data set; give the folder that holds it")
    form = next((form for form in formats if path.suffix.lower() in form.suffixes), None)
    if form is None:
        single = " or ".join(form.suffix_words for form in formats if form.suffixes)
        raise InputError(
            f"{named(path)}: {shown(path.suffix)} is no known kind of file; "
            f"give a folder, {single}, and unpack archives first"
        )
    read = form.read_alone or partial(read_sensor_file, form)
    log = MeasurementLog((read(path),))
    return Dataset(kind=form.kind, log=log, path=path, description=printable(path.name))


def _no_front_end(path: Path, kind: str) -> InputError:
    return InputError(
        f"{named(path)}: kind '{kind}' needs a front end that is not part of this version; supply "
        f"{_FRONT_ENDS[kind]}"
    )


def _text(path: Path, document: dict[str, Any], key: str, default: str | None = None) -> str:
    value = document.get(key, default)
    if value is None:
        kinds = ", ".join(dataset_kinds())
        raise InputError(f"{named(path)}: has no {key}; add {key} = '...', one of {kinds}")
    if not isinstance(value, str):
        raise InputError(f"{named(path)}: {key} is {shown(value)}, expected text; put it in quotes")
    return value
