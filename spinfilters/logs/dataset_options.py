"""What `dataset.toml` says about a data set besides its kind: noise levels and notes."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Final

from spinfilters.errors import InputError
from spinfilters.logs.input_file import named, shown
from spinfilters.logs.number_range import NumberRange

STANDARD_DEVIATIONS: Final[dict[str, NumberRange]] = {
    "pixel_std": NumberRange(1e-12, 1e6, "px"),
    "gyro_noise_std": NumberRange(1e-12, 1e6, "rad/s"),
    "pose_position_std": NumberRange(1e-12, 1e9, "m"),
    "pose_rotation_std": NumberRange(1e-12, 1e3, "rad"),
}
"""Keys of dataset.toml that are standard deviations per measurement, and what they may be."""
DENSITIES: Final[dict[str, NumberRange]] = {
    "force_psd": NumberRange(1e-30, 1e12, "(m/s^2)^2/Hz", zero=True),
    "torque_psd": NumberRange(1e-30, 1e12, "(rad/s^2)^2/Hz", zero=True),
}
"""Keys that are densities of the disturbances, and what they may be."""
NOISE: Final[dict[str, NumberRange]] = {**STANDARD_DEVIATIONS, **DENSITIES}
NOISE_KEYS = tuple(NOISE)


@dataclass(frozen=True)
class DatasetOptions:
    """Noise of sensors and motion where one value holds for all measurements, and what else the file tells.

    Parameters
    ----------
    pixel_std: of each stereo pixel coordinate, px.
    gyro_noise_std: of each gyro component and sample, rad/s.
    pose_position_std, pose_rotation_std: of each pose component, m and rad.
    force_psd, torque_psd: of the white disturbances, see `spinfilters.models.process`.   None where the file is silent.
    frames: in words, what the frames i and g of this data set are.
    notes: numbers and words for the reader, such as a seed; no estimator looks at them.

    Raises
    ------
    InputError: a standard deviation or density out of its range.
    """

    pixel_std: float | None = None
    gyro_noise_std: float | None = None
    pose_position_std: float | None = None
    pose_rotation_std: float | None = None
    force_psd: float | None = None
    torque_psd: float | None = None
    frames: str = ""
    notes: Mapping[str, str | int | float | bool] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, allowed in NOISE.items():
            value = getattr(self, name)
            if value is not None:
                allowed.require(name, value)
        object.__setattr__(self, "notes", dict(self.notes))

    @property
    def document(self) -> dict[str, Any]:
        """The options that are given, as keys of dataset.toml."""
        values = {key: getattr(self, key) for key in (*NOISE_KEYS, "frames")}
        given = {key: value for key, value in values.items() if value not in (None, "")}
        return given | ({"notes": dict(self.notes)} if self.notes else {})


def options_from_toml(path: Path, document: Mapping[str, Any]) -> DatasetOptions:
    """Options of a parsed dataset.toml, whose keys `kind` and `description` are read elsewhere.

    Raises
    ------
    InputError: an unknown key, a value of another type, a standard deviation that is not positive.
    """
    known = [f.name for f in fields(DatasetOptions)]
    given = {key: value for key, value in document.items() if key not in ("kind", "description")}
    for key, value in given.items():
        if key not in known:
            raise InputError(
                f"{named(path)}: key {shown(key)} is unknown; "
                f"use kind, description, {', '.join(known)}, or put it in [notes]"
            )
        expected = float | int if key in NOISE_KEYS else str if key == "frames" else dict
        if not isinstance(value, expected) or isinstance(value, bool):
            raise InputError(f"{named(path)}: {key} is {shown(value)}, {_expected(key)}; correct it")
    _check_notes(path, given.get("notes", {}))
    try:
        for key in given.keys() & NOISE.keys():
            NOISE[key].require(key, given[key])  # before an integer of 400 digits becomes a float
        values: dict[str, Any] = {k: float(v) if k in NOISE_KEYS else v for k, v in given.items()}
        return DatasetOptions(**values)
    except InputError as error:
        raise InputError(f"{named(path)}: {error}; correct it") from None


def _expected(key: str) -> str:
    return (
        "expected a number"
        if key in NOISE_KEYS
        else "expected text"
        if key == "frames"
        else "expected a table [notes]"
    )


def _check_notes(path: Path, notes: Mapping[str, Any]) -> None:
    for key, value in notes.items():
        if not isinstance(value, str | int | float | bool):
            raise InputError(
                f"{named(path)}: notes.{key} is {shown(value)}, expected text or a number; correct it"
            )
