"""Storage format of a sensor's measurements: columns, files, noise levels."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from spinfilters.core.errors import InputError
from spinfilters.core.plugins import members_above
from spinfilters.io.stated_values import NumberRange
from spinfilters.io.text_table import Table

ANY_NUMBER: Final = NumberRange(-1e18, 1e18)


@dataclass(frozen=True)
class NoiseOption:
    """One number of a sensor's noise: a key of dataset.toml and of the settings' table [sensors].

    Attributes
    ----------
    name : str
        The key.
    words : str
        What it is called in a sentence.
    allowed : NumberRange
        Its range, with its unit.
    default : float
        Where neither settings nor data set state it.
    components : tuple[int, ...] | None
        Of the covariance of a row that it is the standard deviation of; None for what no covariance gives.
    in_dataset : bool
        Whether dataset.toml may state it.
    simulated : float | None
        True value in a simulated scene; None is ``default``.
    scene_level : str
        Level of a `Scenario` that sensors share and that it takes instead (`position_std`, `rotation_std`, `gyro_std` or
        `pixel_std`); "" for a value of its own.
    remark : str
        Further sentence of its help; "" for none.
    """

    name: str
    words: str
    allowed: NumberRange
    default: float
    components: tuple[int, ...] | None = None
    in_dataset: bool = True
    simulated: float | None = None
    scene_level: str = ""
    remark: str = ""


@dataclass(frozen=True)
class CalibrationFiles:
    """The calibration that a data set with a camera needs.

    Attributes
    ----------
    kind : type
        Class of the calibration.
    files : tuple[Path, ...]
        Relative to the folder.
    read : Callable[[Path], Any]
        Of the folder.
    write : Callable[[Any, Path], None]
        Into the folder.
    """

    kind: type
    files: tuple[Path, ...]
    read: Callable[[Path], Any]
    write: Callable[[Any, Path], None]


@dataclass(frozen=True)
class SensorFormat:
    """Format of a sensor's measurements.

    Attributes
    ----------
    name : str
        Of the sensor, as in a `MeasurementStream`.
    kind : str
        Of data sets that must have it, in dataset.toml.
    file : str
        Its table in a data set folder.
    columns : tuple[str, ...]
        Of the values, after time_s (and landmark_id).
    dimension : int
        Of the covariance of a row.
    noise : tuple[NoiseOption, ...]
        Its standard deviations.
    allowed : NumberRange
        Range of the values.
    has_landmarks : bool
        Whether every row has a landmark id, and time stamps repeat.
    repeats : bool
        Whether time stamps repeat without landmarks: many rows of one epoch.
    logged_again : bool
        Whether loggers faster than the sensor write its rows again, as those of rates or poses at a fixed frequency.
    quaternion : int | None
        First of four columns that hold a unit quaternion, scalar last.
    calibration : CalibrationFiles | None
        Of the camera.
    check : Callable[[Table], None] | None
        Refuses rows that no such sensor measures.
    read, write
        Of a `MeasurementStream`, where the table is not a CSV of these columns.
    suffixes : tuple[str, ...]
        Of single files that are read as this sensor's.
    suffix_words : str
        What such files are called.
    """

    name: str
    kind: str
    file: str
    columns: tuple[str, ...]
    dimension: int
    noise: tuple[NoiseOption, ...]
    allowed: NumberRange = ANY_NUMBER
    has_landmarks: bool = False
    repeats: bool = False
    logged_again: bool = False
    quaternion: int | None = None
    calibration: CalibrationFiles | None = None
    check: Callable[[Table], None] | None = None
    read: Callable[[Path], Any] | None = None
    write: Callable[[Path, Any], None] | None = None
    suffixes: tuple[str, ...] = ()
    suffix_words: str = ""

    @property
    def levels(self) -> dict[str, tuple[int, ...]]:
        """Components of a row by the noise option that is their standard deviation."""
        return {each.name: each.components for each in self.noise if each.components is not None}

    @property
    def covariance_file(self) -> str:
        """Table of the covariances of the rows, next to that of the measurements."""
        return f"{Path(self.file).stem}_covariance.csv"

    @property
    def many_rows_an_epoch(self) -> bool:
        """Whether rows may share a time stamp."""
        return self.has_landmarks or self.repeats

    @property
    def header(self) -> tuple[str, ...]:
        """Columns of the table."""
        return ("time_s", *(("landmark_id",) if self.has_landmarks else ()), *self.columns)


class StoredSensor:
    """Sensor with the storage format of its measurements.

    Attributes
    ----------
    format : SensorFormat | None
        None for a sensor that no data set holds.
    former_names : tuple[str, ...]
        Names that it had, which are still accepted.
    """

    format: SensorFormat | None = None
    former_names: tuple[str, ...] = ()


def stored_sensors() -> tuple[StoredSensor, ...]:
    """All sensors: our own, and those of the entry points ``spinfilters.sensors``. InputError: `installed_plugins`."""
    return members_above("spinfilters.sensors", StoredSensor)


def sensor_formats() -> Mapping[str, SensorFormat]:
    """Formats of all sensors that data sets hold, by name of the sensor. InputError: `installed_plugins`."""
    return _by_name(stored_sensors())


def sensor_format(sensor: str) -> SensorFormat:
    """Format of a sensor. InputError: an unknown one."""
    formats = sensor_formats()
    if sensor not in formats:
        raise InputError(f"sensor {sensor!r} is unknown; use one of {', '.join(formats)}")
    return formats[sensor]


def dataset_kinds() -> Mapping[str, SensorFormat]:
    """Formats by kind of data set."""
    return {each.kind: each for each in sensor_formats().values()}


def sensor_called(name: str) -> str:
    """Name of the sensor that a name means: its own, that of its kind of data sets, or a former one; others as they are."""
    for each in stored_sensors():
        if each.format is not None and name in (each.format.name, each.format.kind, *each.former_names):
            return each.format.name
    return name


def kind_called(name: str) -> str:
    """Kind of data sets that a name means, see `sensor_called`; others come back as they are."""
    formats, sensor = sensor_formats(), sensor_called(name)
    return formats[sensor].kind if sensor in formats else name


def noise_options() -> Mapping[str, NoiseOption]:
    """Noise options of all sensors, by name; sensors may share one."""
    return {option.name: option for each in sensor_formats().values() for option in each.noise}


@lru_cache(maxsize=1)
def _by_name(sensors: tuple[StoredSensor, ...]) -> Mapping[str, SensorFormat]:
    formats = sorted((each.format for each in sensors if each.format is not None), key=lambda each: each.name)
    for values, what in (([f.name for f in formats], "sensor"), ([f.kind for f in formats], "kind")):
        twice = next((value for value in values if values.count(value) > 1), None)
        if twice is not None:
            raise InputError(f"{what} {twice!r} is registered twice; uninstall one of the plug-ins")
    return MappingProxyType({each.name: each for each in formats})


@dataclass(frozen=True, init=False)
class SensorNoise:
    """Standard deviations of sensors whose rows have no covariances; each sensor documents its noise model.

    Every option of the registry has a value, by default the option's, and is an attribute: ``noise.pixel_std``.

    Raises
    ------
    InputError
        An unknown option, a value outside its range.
    """

    values: Mapping[str, float]

    def __init__(self, values: Mapping[str, float] | None = None, **changes: float) -> None:
        options = noise_options()
        given = {**(values or {}), **changes}
        for name, value in given.items():
            if name not in options:
                raise InputError(f"sensor noise {name} is unknown; use {', '.join(options)}")
            options[name].allowed.require(name, value)
        defaults = {name: option.default for name, option in options.items()}
        object.__setattr__(self, "values", {**defaults, **given})

    def __hash__(self) -> int:
        """Of the values; equal ones have equal hashes."""
        return hash(frozenset(self.values.items()))

    def __getattr__(self, name: str) -> float:
        if name == "values" or name.startswith("__") or name not in self.values:
            raise AttributeError(f"sensor noise has no {name}")
        return self.values[name]
