"""A data set: measurements of one body with what is known about them, read from a folder or a file.

A folder holds `dataset.toml` (kind, description, noise) and the tables of its sensors; an export of the
phyphox app and a single gyro or TUM file are read as they are.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

from spinfilters.errors import InputError
from spinfilters.logs.camera import StereoRig, read_stereo_rig
from spinfilters.logs.covariance_files import with_covariance
from spinfilters.logs.dataset_options import DatasetOptions, options_from_toml
from spinfilters.logs.gyro_columns import read_gyro_table
from spinfilters.logs.gyro_files import PHYPHOX_TABLE, Segment, read_gyro_csv, write_gyro_csv
from spinfilters.logs.input_file import named, printable, require_file, require_folder, shown
from spinfilters.logs.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.logs.phyphox_trials import OnRefused, phyphox_trial, phyphox_trials
from spinfilters.logs.pose_files import read_tum, write_tum
from spinfilters.logs.settings_files import read_toml
from spinfilters.logs.track_files import KnownMap, read_landmarks, read_tracks, write_tracks
from spinfilters.logs.truth import Truth, read_truth

DATASET_FILE: Final[str] = "dataset.toml"
LANDMARK_FILE: Final[str] = "landmarks.csv"
KINDS: Final[dict[str, str]] = {"stereo-tracks": "stereo", "gyro": "gyro", "pose": "pose"}
"""Kinds of data sets, with the sensor that each must have; the other sensors may be there too."""
_FRONT_ENDS = {
    "stereo-images": "tracks.csv of rectified feature tracks with kind = 'stereo-tracks'",
    "lidar-scans": "poses.tum of the registered scans with kind = 'pose'",
}
_LARGEST_FILE = 2**63  # the reader that follows has its own limit


class SensorFile(NamedTuple):
    """Where a sensor's measurements are in a folder, and how they are read and written."""

    name: str
    covariance: str
    read: Callable[[Path], MeasurementStream]
    write: Callable[[Path, MeasurementStream], None]


SENSOR_FILES: Final[dict[str, SensorFile]] = {
    "gyro": SensorFile("gyro.csv", "gyro_covariance.csv", read_gyro_csv, write_gyro_csv),
    "pose": SensorFile("poses.tum", "poses_covariance.csv", read_tum, write_tum),
    "stereo": SensorFile("tracks.csv", "tracks_covariance.csv", read_tracks, write_tracks),
}
"""The tables that a data set folder may hold, by sensor."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Dataset:
    """Measurements with what is known about them.

    Parameters
    ----------
    kind: a key of `KINDS`.   log: with the sensor of that kind.
    path: where it was read, None when made in memory.
    truth, rig, known_map: None where not known; stereo measurements need a rig.
    segment: the marked stretch of a phyphox recording that this is, None otherwise.

    Raises
    ------
    InputError: unknown kind, a log without its sensor, stereo measurements without a rig.
    """

    kind: str
    log: MeasurementLog
    path: Path | None = None
    description: str = ""
    truth: Truth | None = None
    rig: StereoRig | None = None
    known_map: KnownMap | None = None
    options: DatasetOptions = field(default_factory=DatasetOptions)
    segment: Segment | None = None

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(f"kind {shown(self.kind)} is unknown; use {', '.join(KINDS)}")
        self.log.stream(KINDS[self.kind])
        if "stereo" in self.log.sensors and self.rig is None:
            raise InputError("stereo measurements need a rig; give the calibration of the cameras")

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
    return Dataset(
        kind="gyro", log=MeasurementLog((stream,)), path=folder, description=description, segment=segment
    )


def _read_folder(folder: Path) -> Dataset:
    require_folder(folder)
    path = folder / DATASET_FILE
    if not os.path.lexists(path):
        if os.path.isfile(folder / "cam0" / "data.csv"):
            raise _no_front_end(folder, "stereo-images")
        raise InputError(
            f"{named(path)}: no such file; write it with a line kind = '...' ({', '.join(KINDS)}), or check "
            "the path"
        )
    document = read_toml(path)
    kind, description = _text(path, document, "kind"), _text(path, document, "description", "")
    if kind in _FRONT_ENDS:
        raise _no_front_end(path, kind)
    if kind not in KINDS:
        raise InputError(
            f"{named(path)}: kind is {shown(kind)}, expected one of {', '.join(KINDS)}; correct it"
        )
    log = _read_log(folder, KINDS[kind])
    landmarks = folder / LANDMARK_FILE
    return Dataset(
        kind=kind,
        log=log,
        path=folder,
        description=description,
        truth=read_truth(folder),
        rig=read_stereo_rig(folder) if "stereo" in log.sensors else None,
        known_map=read_landmarks(landmarks) if os.path.lexists(landmarks) else None,
        options=options_from_toml(path, document),
    )


def _read_log(folder: Path, required: str) -> MeasurementLog:
    streams = []
    for sensor, file in SENSOR_FILES.items():
        if sensor == required or os.path.lexists(folder / file.name):
            stream = file.read(folder / file.name)
            covariance = folder / file.covariance
            streams.append(with_covariance(stream, covariance) if os.path.lexists(covariance) else stream)
    return MeasurementLog(tuple(streams))


def _read_file(path: Path) -> Dataset:
    require_file(path, _LARGEST_FILE)
    if path.name in (DATASET_FILE, LANDMARK_FILE, "tracks.csv", "truth.csv"):
        raise InputError(f"{named(path)}: is one part of a data set; give the folder that holds it")
    readers = {".csv": ("gyro", read_gyro_table), ".tum": ("pose", read_tum), ".txt": ("pose", read_tum)}
    if path.suffix.lower() not in readers:
        raise InputError(
            f"{named(path)}: {shown(path.suffix)} is no known kind of file; "
            "give a folder, a gyro .csv or a TUM .tum or .txt, and unpack archives first"
        )
    kind, read = readers[path.suffix.lower()]
    return Dataset(kind=kind, log=MeasurementLog((read(path),)), path=path, description=printable(path.name))


def _no_front_end(path: Path, kind: str) -> InputError:
    return InputError(
        f"{named(path)}: kind '{kind}' needs a front end that is not part of this version; supply "
        f"{_FRONT_ENDS[kind]}"
    )


def _text(path: Path, document: dict[str, Any], key: str, default: str | None = None) -> str:
    value = document.get(key, default)
    if value is None:
        raise InputError(f"{named(path)}: has no {key}; add {key} = '...', one of {', '.join(KINDS)}")
    if not isinstance(value, str):
        raise InputError(f"{named(path)}: {key} is {shown(value)}, expected text; put it in quotes")
    return value
