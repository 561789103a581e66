"""A data set: measurements of one body with what is known, and the options of its `dataset.toml`.

Read from a folder or a file.
A folder holds `dataset.toml` (kind, description, noise) and the tables of its sensors; an export of the
phyphox app and a single gyro or TUM file are read as they are.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.io.camera import Rig, camera_deviations
from spinfilters.io.consider_parameter import consider_parameters
from spinfilters.io.disturbances import DENSITIES
from spinfilters.io.input_file import path_text, printable, value_text
from spinfilters.io.measurement_log import Acceleration, MeasurementLog, MeasurementStream
from spinfilters.io.sensor_format import CalibrationFiles, dataset_kinds, noise_options, sensor_format
from spinfilters.io.sensor_tables import KnownMap
from spinfilters.io.stated_values import NumberRange
from spinfilters.io.truth import Truth

Note = str | int | float | bool
INFLATION: Final = NumberRange(1.0, 1e6)


def noise_ranges() -> dict[str, NumberRange]:
    """Noise keys of dataset.toml, of sensors and disturbances, with their ranges."""
    stated = {name: option.allowed for name, option in noise_options().items() if option.in_dataset}
    return {**stated, **{name: each.allowed for name, each in DENSITIES.items()}}


@dataclass(frozen=True, init=False)
class DatasetOptions:
    """Content of dataset.toml: noise of sensors and motion for all measurements, and notes.

    Parameters
    ----------
    sensor_noise : Mapping[str, float]
        Standard deviations of the sensors, by the names of the registry's options; each is a keyword argument and an attribute too
        (``pixel_std``), None where the file is silent.
    densities : Mapping[str, float]
        Of the white disturbances, by the keys of `spinfilters.io.disturbances.DENSITIES`; each is a keyword argument and an
        attribute too (``force_psd``), None where the file is silent.
    frames : str
        In words, what the frames i and g of this data set are.
    notes : Mapping[str, Note]
        Numbers and words for the reader, such as a seed; no estimator looks at them.
    calibration : Mapping[str, float]
        Standard deviations of the calibration by `ConsiderParameter.name`, those that the data set states.
    covariance_inflation : float
        Factor, at least 1, on the covariances that rows state for themselves, so that errors which rows have in common weigh as
        much as they should where estimators take them for white noise; residuals are smaller by it.

    Raises
    ------
    InputError
        A standard deviation, density or factor out of its range.
    """

    sensor_noise: Mapping[str, float]
    densities: Mapping[str, float]
    frames: str
    notes: Mapping[str, Note]
    calibration: Mapping[str, float]
    covariance_inflation: float

    def __init__(
        self,
        sensor_noise: Mapping[str, float] | None = None,
        densities: Mapping[str, float] | None = None,
        frames: str = "",
        notes: Mapping[str, Note] | None = None,
        calibration: Mapping[str, float] | None = None,
        covariance_inflation: float = 1.0,
        **noise: float | None,
    ) -> None:
        ranges = noise_ranges()
        given = {**(sensor_noise or {}), **(densities or {}), **noise}
        for name, value in given.items():
            if name not in ranges:
                raise InputError(f"option {name} is unknown; use {', '.join(ranges)}")
            if value is not None:
                ranges[name].require(name, value)
        stated = {k: v for k, v in given.items() if v is not None}
        of_sensors = {k: v for k, v in stated.items() if k not in DENSITIES}
        of_motion = {k: v for k, v in stated.items() if k in DENSITIES}
        _check_calibration(calibration or {})
        INFLATION.require("covariance_inflation", covariance_inflation)
        others = frames, dict(notes or {}), dict(calibration or {}), float(covariance_inflation)
        values = (of_sensors, of_motion, *others)
        for name, value in zip(_FIELDS, values, strict=True):
            object.__setattr__(self, name, value)

    def __getattr__(self, name: str) -> float | None:
        if name in _FIELDS or name.startswith("__") or not (name in DENSITIES or name in noise_options()):
            raise AttributeError(f"the options have no {name}")
        return (self.densities if name in DENSITIES else self.sensor_noise).get(name)

    @property
    def noise(self) -> tuple[float | None, ...]:
        """Every noise of the sensors and of the motion, in the order of `noise_ranges`."""
        return tuple(getattr(self, key) for key in noise_ranges())

    @property
    def document(self) -> dict[str, Any]:
        """The options that are given, as keys of dataset.toml."""
        values = {key: getattr(self, key) for key in (*noise_ranges(), "frames")}
        values["covariance_inflation"] = (
            None if self.covariance_inflation == 1.0 else self.covariance_inflation
        )
        given = {key: value for key, value in values.items() if value not in (None, "")}
        tables = {"calibration": dict(self.calibration), "notes": dict(self.notes)}
        return given | {name: table for name, table in tables.items() if table}


_FIELDS = tuple(each.name for each in fields(DatasetOptions))


def options_from_toml(path: Path, document: Mapping[str, Any]) -> DatasetOptions:
    """Options of a parsed dataset.toml, whose keys `kind` and `description` are read elsewhere.

    Raises
    ------
    InputError
        An unknown key, a value of another type, a standard deviation that is not positive.
    """
    noise = noise_ranges()
    known = [*noise, "frames", "calibration", "covariance_inflation", "notes"]
    given = {key: value for key, value in document.items() if key not in ("kind", "description")}
    for key, value in given.items():
        if key not in known:
            raise InputError(
                f"{path_text(path)}: key {value_text(key)} is unknown; "
                f"use kind, description, {', '.join(known)}, or put it in [notes]"
            )
        expected = float | int if _is_number(key) else str if key == "frames" else dict
        if not isinstance(value, expected) or isinstance(value, bool):
            raise InputError(f"{path_text(path)}: {key} is {value_text(value)}, {_expected(key)}; correct it")
    _check_notes(path, given.get("notes", {}))
    try:
        for key in given.keys() & noise.keys():
            noise[key].require(key, given[key])  # before an integer of 400 digits becomes a float
        values: dict[str, Any] = {k: float(v) if k in noise else v for k, v in given.items()}
        return DatasetOptions(**values)
    except InputError as error:
        raise InputError(f"{path_text(path)}: {error}; correct it") from None


def with_stated_deviations(options: DatasetOptions, folder: Path) -> DatasetOptions:
    """Options completed by the calibration deviations in the folder's `sensor.yaml` files.

    Raises
    ------
    InputError
        As `read_sensor_file`; a deviation out of the range of its parameter.
    """
    return replace(options, calibration={**camera_deviations(folder), **options.calibration})


def _is_number(key: str) -> bool:
    return key in noise_ranges() or key == "covariance_inflation"


def _expected(key: str) -> str:
    return (
        "expected a number"
        if _is_number(key)
        else "expected text"
        if key == "frames"
        else f"expected a table [{key}]"
    )


def _check_calibration(deviations: Mapping[str, Any]) -> None:
    """InputError: an unknown parameter, a deviation out of its range."""
    parameters = consider_parameters() if deviations else {}
    for name, value in deviations.items():
        if name not in parameters:
            raise InputError(f"calibration.{value_text(name)[1:-1]} is unknown; use {', '.join(parameters)}")
        parameters[name].allowed.require(f"calibration.{name}", value)


def _check_notes(path: Path, notes: Mapping[str, Any]) -> None:
    for key, value in notes.items():
        if not isinstance(value, str | int | float | bool):
            raise InputError(
                f"{path_text(path)}: notes.{key} is {value_text(value)}, expected text or a number; correct it"
            )


DATASET_FILE: Final[str] = "dataset.toml"
PHYPHOX_TABLE: Final[str] = "Raw Data.csv"
"""Files by which a folder of this project and an export of phyphox are recognised."""
LANDMARK_FILE: Final[str] = "landmarks.csv"
INSPECTOR_FILE: Final[str] = "inspector.tum"
"""Known trajectory of the inspector: poses of cam0 in i, with the measurements of a camera."""


@dataclass(frozen=True)
class Segment:
    """A stretch of a recording, s on its clock.

    Attributes
    ----------
    number : int | None
        As marked or as found; None of one that its user states.
    start, end : float | None
        None for the ends of the recording.
    keep : bool
        Whether it is a trial.
    comment : str
        On it, or what says that it is a flight.
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


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Dataset:
    """Measurements with what is known about them.

    Parameters
    ----------
    kind : str
        Of `dataset_kinds`.
    log : MeasurementLog
        With the sensor of that kind; other sensors may be there too.
    path : Path | None
        Where it was read, None when made in memory.
    description : str
        In words, of whoever made the data set.
    truth, rig, known_map
        None where not known; measurements of a camera need its rig.
    inspector : MeasurementStream | None
        Poses of cam0 in i over the time of all measurements of cameras; None where frame i is that of cam0.
    options : DatasetOptions
        Standard deviations of its sensors and its calibration, and notes of its maker.
    segment : Segment | None
        The stretch of a recording that this is, None of a whole one.
    acceleration : Acceleration | None
        Of an accelerometer in addition to the sensors; it shows free flights, no estimator reads it.
    doubts : tuple[str, ...]
        Reasons why no estimate from these measurements is to be trusted, of what made them of raw data.

    Raises
    ------
    InputError
        Unknown kind, a log without its sensor, measurements of a camera without its rig, an inspector without a
        camera or of a shorter time.
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

    def __repr__(self) -> str:
        """Kind, rows and times of each sensor, and the description; without the numbers."""
        streams = [
            f"{len(each)} of {each.sensor} in {each.time[-1] - each.time[0]:.6g} s"
            for each in self.log.streams
        ]
        words = f" ({self.description})" if self.description else ""
        return f"Dataset {self.kind}: {', '.join(streams)}{words}"

    @classmethod
    def from_dataframe(
        cls,
        table: Any,
        kind: str | None = None,
        *,
        units: str | Mapping[str, str] | None = None,
        rate: float | None = None,
        noise: Mapping[str, float] | None = None,
        rig: Rig | None = None,
        truth: Truth | None = None,
        known_map: KnownMap | None = None,
        inspector: MeasurementStream | None = None,
        description: str = "",
    ) -> "Dataset":
        """Data set of a table in memory, checked as a file of the same numbers is.

        Parameters
        ----------
        table : data frame, mapping or array
            A pandas or polars DataFrame, or a mapping of names to columns, whose columns are known by their names in any order;
            a mapping of kinds to such tables for several sensors; an array, or a pair of times and values, with the columns
            of ``kind`` in their order.
        kind : str or None
            "gyro", "pose", "attitude", "stereo-tracks" or another of `dataset_kinds`; None to recognise it by the names.
        units : str, Mapping or None
            Of body rates or positions whose names state none, such as "deg/s"; or by quantity: ``{"time": "ms", "rate": "deg/s"}``.
        rate : float or None
            Samples a second, Hz, of a table without a clock.
        noise : Mapping[str, float] or None
            Standard deviations by their names in ``dataset.toml``, such as ``{"gyro_noise_std": 0.01}``.
        rig, truth, known_map, inspector : object or None
            As `Dataset` has them; tracks need the rig of their camera.
        description : str
            By which messages name the data set.

        Returns
        -------
        Dataset
            With the same measurements, bit for bit, as a file of these numbers gives.

        Raises
        ------
        InputError
            What the file would be refused for; the text names the row, counted from 0, the value and the cure.
        """
        from spinfilters.io.memory_tables import measured_table, reading_options  # of no use to files

        options = reading_options(units, rate)
        kinds = dataset_kinds()
        tables = [(kind, table)]
        if isinstance(table, Mapping) and table and table.keys() <= kinds.keys():
            tables = list(table.items())
        measured = [measured_table(each, name, options) for name, each in tables]
        remarks = [remark for each in measured for remark in each.remarks]
        known_as = description or " and ".join(f"{each.stream.sensor} table in memory" for each in measured)
        first = sensor_format(measured[0].stream.sensor)
        return cls(
            kind=first.kind,
            log=MeasurementLog(tuple(each.stream for each in measured)),
            description="; ".join((printable(known_as), *remarks)),
            truth=truth,
            rig=rig,
            known_map=known_map,
            inspector=inspector,
            options=DatasetOptions(noise),
            acceleration=next(
                (each.acceleration for each in measured if each.acceleration is not None), None
            ),
        )

    @classmethod
    def from_arrays(
        cls,
        kind: str,
        time: Any,
        values: Any,
        *,
        ids: Any = None,
        covariance: Any = None,
        units: str | Mapping[str, str] | None = None,
        noise: Mapping[str, float] | None = None,
        rig: Rig | None = None,
        truth: Truth | None = None,
        known_map: KnownMap | None = None,
        inspector: MeasurementStream | None = None,
        description: str = "",
    ) -> "Dataset":
        """Data set of arrays of one sensor, checked as a file of the same numbers is.

        Parameters
        ----------
        kind : str
            Of `dataset_kinds`, such as "gyro", "pose" or "mono-tracks".
        time : (n,) array
            In s, or in the unit that ``units`` states.
        values : (n, m) array
            The columns of the kind: body rates about x, y, z; position and unit quaternion, scalar last; pixels.
        ids : (n,) array or None
            Landmark of each row, of tracks only.
        covariance : (n, k, k) array or None
            Of each row; None where one deviation holds for all.
        units, noise, rig, truth, known_map, inspector, description
            As `from_dataframe` has them.

        Returns
        -------
        Dataset
            As of a file of these numbers.

        Raises
        ------
        InputError
            What the file would be refused for.
        """
        table: Any = time, values
        if ids is not None:
            table = np.asarray(time), np.column_stack([np.asarray(ids), np.asarray(values)])
        dataset = cls.from_dataframe(
            table,
            kind,
            units=units,
            noise=noise,
            rig=rig,
            truth=truth,
            known_map=known_map,
            inspector=inspector,
            description=description,
        )
        if covariance is None:
            return dataset
        (stream,) = dataset.log.streams
        try:
            weighted = MeasurementStream(
                stream.sensor, stream.time, stream.values, stream.ids, np.asarray(covariance, dtype=float)
            )
        except (TypeError, ValueError):
            raise InputError(f"covariance is {value_text(covariance)}; give a matrix for each row") from None
        return replace(dataset, log=MeasurementLog((weighted,)))

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
        """The data set within a time interval. InputError: no measurement within.

        Parameters
        ----------
        segment : Segment
            Begin and end, s; None for those of the recording.

        Returns
        -------
        Dataset
            Its measurements from begin to end, both within; truth, map and calibration as they are.
        """
        start = self.log.start if segment.start is None else segment.start
        end = self.log.end if segment.end is None else segment.end
        force = None if self.acceleration is None else self.acceleration.slice(start, end)
        with self.naming():
            log = self.log.slice(start, end)
        return replace(self, log=log, segment=segment, acceleration=force)

    @contextmanager
    def naming(self) -> Iterator[None]:
        """Prefix InputErrors about the measurements with `name`.

        Returns
        -------
        Iterator[None]
            Context in which the measurements are used.
        """
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

    Raises
    ------
    InputError
        A log without a camera, or camera observations before the first or after the last pose.
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
