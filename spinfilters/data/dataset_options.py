"""What `dataset.toml` says about a data set besides its kind: noise levels and notes."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Final

from spinfilters.data.camera import told_deviations
from spinfilters.data.consider_parameter import consider_parameters
from spinfilters.data.input_file import path_text, value_text
from spinfilters.data.sensor_format import noise_options
from spinfilters.data.stated_values import NumberRange
from spinfilters.errors import InputError

Note = str | int | float | bool
DENSITIES: Final[dict[str, NumberRange]] = {
    "force_psd": NumberRange(1e-30, 1e12, "(m/s^2)^2/Hz", zero=True),
    "torque_psd": NumberRange(1e-30, 1e12, "(rad/s^2)^2/Hz", zero=True),
}
"""Keys that are densities of the disturbances, and what they may be."""
INFLATION: Final = NumberRange(1.0, 1e6)


def noise_ranges() -> dict[str, NumberRange]:
    """Noise keys of dataset.toml, of sensors and disturbances, with their ranges."""
    stated = {name: option.allowed for name, option in noise_options().items() if option.in_dataset}
    return {**stated, **DENSITIES}


@dataclass(frozen=True, init=False)
class DatasetOptions:
    """Content of dataset.toml: noise of sensors and motion for all measurements, and notes.

    Parameters
    ----------
    sensor_noise: standard deviations of the sensors, by the names of the registry's options; each is a keyword argument and an
        attribute too (``pixel_std``), None where the file is silent.
    force_psd, torque_psd: of the white disturbances, see `spinfilters.models.process`.   None where the file is silent.
    frames: in words, what the frames i and g of this data set are.
    notes: numbers and words for the reader, such as a seed; no estimator looks at them.
    calibration: standard deviations of the calibration by `ConsiderParameter.name`, those that the data set tells.
    covariance_inflation: factor, at least 1, on the covariances that rows state for themselves, so that errors which rows have in
        common weigh as much as they should where estimators take them for white noise; residuals are smaller by it.

    Raises
    ------
    InputError: a standard deviation, density or factor out of its range.
    """

    sensor_noise: Mapping[str, float]
    force_psd: float | None
    torque_psd: float | None
    frames: str
    notes: Mapping[str, Note]
    calibration: Mapping[str, float]
    covariance_inflation: float

    def __init__(
        self,
        sensor_noise: Mapping[str, float] | None = None,
        force_psd: float | None = None,
        torque_psd: float | None = None,
        frames: str = "",
        notes: Mapping[str, Note] | None = None,
        calibration: Mapping[str, float] | None = None,
        covariance_inflation: float = 1.0,
        **noise: float | None,
    ) -> None:
        ranges = noise_ranges()
        given = {**(sensor_noise or {}), **noise, "force_psd": force_psd, "torque_psd": torque_psd}
        for name, value in given.items():
            if name not in ranges:
                raise InputError(f"option {name} is unknown; use {', '.join(ranges)}")
            if value is not None:
                ranges[name].require(name, value)
        stated = {k: v for k, v in given.items() if v is not None and k not in DENSITIES}
        _check_calibration(calibration or {})
        INFLATION.require("covariance_inflation", covariance_inflation)
        told = frames, dict(notes or {}), dict(calibration or {}), float(covariance_inflation)
        values = (stated, force_psd, torque_psd, *told)
        for name, value in zip(_FIELDS, values, strict=True):
            object.__setattr__(self, name, value)

    def __getattr__(self, name: str) -> float | None:
        if name in _FIELDS or name.startswith("__") or name not in noise_options():
            raise AttributeError(f"the options have no {name}")
        return self.sensor_noise.get(name)

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
    InputError: an unknown key, a value of another type, a standard deviation that is not positive.
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


def with_told_deviations(options: DatasetOptions, folder: Path) -> DatasetOptions:
    """Options completed by the calibration deviations in the folder's `sensor.yaml` files.

    Raises
    ------
    InputError: as `read_sensor_file`; a deviation out of the range of its parameter.
    """
    return replace(options, calibration={**told_deviations(folder), **options.calibration})


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
