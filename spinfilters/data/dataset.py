"""A data set: measurements of one body with what is known.

Read from a folder or a file.
A folder holds `dataset.toml` (kind, description, noise) and the tables of its sensors; an export of the
phyphox app and a single gyro or TUM file are read as they are.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np

from spinfilters.data.accelerometer import Acceleration
from spinfilters.data.camera import Rig
from spinfilters.data.dataset_options import DatasetOptions
from spinfilters.data.input_file import path_text, printable, value_text
from spinfilters.data.known_map import KnownMap
from spinfilters.data.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.data.sensor_format import (
    CalibrationFiles,
    dataset_kinds,
    sensor_format,
)
from spinfilters.data.truth import Truth
from spinfilters.errors import InputError

DATASET_FILE: Final[str] = "dataset.toml"
PHYPHOX_TABLE: Final[str] = "Raw Data.csv"
"""Files by which a folder of this project and an export of phyphox are recognised."""
LANDMARK_FILE: Final[str] = "landmarks.csv"
INSPECTOR_FILE: Final[str] = "inspector.tum"
"""Known trajectory of the inspector: poses of cam0 in i, beside the measurements of a camera."""


@dataclass(frozen=True)
class Segment:
    """A stretch of a recording, s on its clock.

    Attributes
    ----------
    number: as marked or as found; None of one that its user states.   start, end: None for the ends of the recording.
    keep: whether it is a trial.   comment: on it, or what says that it is a flight.
    """

    number: int | None
    start: float | None
    end: float | None
    keep: bool
    comment: str

    @property
    def label(self) -> str:
        """Label of the segment: its number, or its times."""
        if self.number is not None:
            return f"segment {self.number}"
        start, end = ("" if each is None else f"{each:.9g}" for each in (self.start, self.end))
        return f"segment {start}:{end}"


@dataclass(frozen=True, eq=False, kw_only=True)
class Dataset:
    """Measurements with what is known about them.

    Parameters
    ----------
    kind: of `dataset_kinds`.   log: with the sensor of that kind; other sensors may be there too.
    path: where it was read, None when made in memory.
    truth, rig, known_map: None where not known; measurements of a camera need its rig.
    inspector: poses of cam0 in i over the time of all measurements of cameras; None where frame i is that of cam0.
    segment: the stretch of a recording that this is, None of a whole one.
    acceleration: of an accelerometer beside the sensors; it tells flights, no estimator reads it.
    doubts: reasons why no estimate from these measurements is to be trusted, of what made them of raw data.

    Raises
    ------
    InputError: unknown kind, a log without its sensor, measurements of a camera without its rig, an inspector without a camera
    or of a shorter time.
    """

    kind: str
    log: MeasurementLog
    path: Path | None = None
    description: str = ""
    truth: Truth | None = None
    rig: Rig | None = None
    known_map: KnownMap | None = None
    inspector: MeasurementStream | None = None
    options: DatasetOptions = field(default_factory=DatasetOptions)
    segment: Segment | None = None
    acceleration: Acceleration | None = None
    doubts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        kinds = dataset_kinds()
        if self.kind not in kinds:
            raise InputError(f"kind {value_text(self.kind)} is unknown; use {', '.join(kinds)}")
        self.log.stream(self.sensor)
        for sensor in self.log.sensors:
            calibration = sensor_format(sensor).calibration
            if calibration is not None and not isinstance(self.rig, calibration.kind):
                raise InputError(
                    f"{sensor} measurements need a rig ({calibration.kind.__name__}); give the camera's calibration"
                )

        if self.inspector is not None:
            require_cover(self.inspector, self.log)

    @property
    def sensor(self) -> str:
        """The sensor that its kind says it must have."""
        return dataset_kinds()[self.kind].name

    @property
    def calibrations(self) -> tuple[CalibrationFiles, ...]:
        """Calibration files of the rig."""
        return calibrations_of(self.log)

    @property
    def name(self) -> str:
        """Name in error messages: path with segment, or description."""
        place = printable(self.description) or "the data set" if self.path is None else path_text(self.path)
        return place if self.segment is None else f"{place}, {self.segment.label}"

    def part(self, segment: Segment) -> "Dataset":
        """The data set within a time interval. InputError: no measurement within."""
        start = self.log.start if segment.start is None else segment.start
        end = self.log.end if segment.end is None else segment.end
        force = None if self.acceleration is None else self.acceleration.slice(start, end)
        with self.naming():
            log = self.log.slice(start, end)
        return replace(self, log=log, segment=segment, acceleration=force)

    @contextmanager
    def naming(self) -> Iterator[None]:
        """Prefix InputErrors about the measurements with `name`."""
        try:
            yield
        except InputError as error:
            raise InputError(f"{self.name}: {error}") from None


def calibrations_of(log: MeasurementLog) -> tuple[CalibrationFiles, ...]:
    """Calibrations of the cameras in a log."""
    formats = [sensor_format(sensor) for sensor in log.sensors]
    return tuple(form.calibration for form in formats if form.calibration is not None)


def require_cover(inspector: MeasurementStream, log: MeasurementLog) -> None:
    """Require that the inspector's poses cover all observations of a camera.

    InputError: a log without a camera, or observations of one before the first or after the last pose.
    """
    seen = [stream.time for stream in log.streams if sensor_format(stream.sensor).calibration is not None]
    if not seen:
        raise InputError(
            f"an inspector's trajectory is of a camera, and only {', '.join(log.sensors)} measured; leave it out, or give tracks"
        )
    first, last = np.min([time[0] for time in seen]), np.max([time[-1] for time in seen])
    if first < inspector.time[0] or last > inspector.time[-1]:
        raise InputError(
            f"the inspector's poses from {inspector.time[0]:.6f} s to {inspector.time[-1]:.6f} s do not cover the observations "
            f"from {first:.6f} s to {last:.6f} s; give those that are missing"
        )
