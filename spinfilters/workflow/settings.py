"""Everything that can be set about a run, read from and written to TOML."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from spinfilters.errors import InputError
from spinfilters.estimators.adaptation import AdaptationOptions
from spinfilters.estimators.iterated import IterationOptions
from spinfilters.estimators.landmarks.landmark_map import LandmarkOptions
from spinfilters.estimators.robustness import RobustOptions
from spinfilters.estimators.sigma_points import SigmaPointOptions
from spinfilters.estimators.start import StartOptions
from spinfilters.logs.input_file import named, shown
from spinfilters.logs.settings_files import read_toml
from spinfilters.models.process import THESIS_NOISE, ProcessNoise
from spinfilters.workflow.sensor_settings import AUTO, SensorSettings
from spinfilters.workflow.setting_ranges import SETTING_RANGES
from spinfilters.workflow.smoother_settings import SmootherSettings

DEFAULT_ESTIMATORS = ("mekf", "ukf", "smoother")
ESTIMATORS = (*DEFAULT_ESTIMATORS, "filterpy-ekf", "filterpy-ukf")
"""Names of all; filterpy's hold no landmarks."""


@dataclass(frozen=True)
class ProcessSettings:
    """The process model.

    Attributes
    ----------
    force_psd: (m/s^2)^2/Hz.   torque_psd: (rad/s^2)^2/Hz. "auto" takes the data set's own; where it is silent `THESIS_NOISE`, or
        as the torque of a gyro of unknown error what the disturbances of thrown bodies were found to be
        (`spinfilters.workflow.gyro_noise`).
    drag: whether the state has an aerodynamic drag coefficient.
    tolerance: of the integrator, rad and relative rate per step.
    """

    force_psd: float | str = AUTO
    torque_psd: float | str = AUTO
    drag: bool = False
    tolerance: float = 1e-8

    def __post_init__(self) -> None:
        if not self.tolerance > 0:
            raise InputError(f"process.tolerance is {self.tolerance}; it must be positive")
        self.noise(THESIS_NOISE)

    def noise(self, automatic: ProcessNoise) -> ProcessNoise:
        """Its noise densities, checked; ``automatic`` are those that nobody has set."""
        force_psd = automatic.force_psd if isinstance(self.force_psd, str) else self.force_psd
        torque_psd = automatic.torque_psd if isinstance(self.torque_psd, str) else self.torque_psd
        return ProcessNoise(force_psd, torque_psd)


@dataclass(frozen=True)
class Settings:
    """All settings of a run; the field names are those of the TOML file's tables and keys."""

    estimators: tuple[str, ...] = DEFAULT_ESTIMATORS
    process: ProcessSettings = field(default_factory=ProcessSettings)
    sensors: SensorSettings = field(default_factory=SensorSettings)
    start: StartOptions = field(default_factory=StartOptions)
    ukf: SigmaPointOptions = field(default_factory=SigmaPointOptions)
    landmarks: LandmarkOptions = field(default_factory=LandmarkOptions)
    robust: RobustOptions = field(default_factory=RobustOptions)
    iteration: IterationOptions = field(default_factory=IterationOptions)
    adaptation: AdaptationOptions = field(default_factory=AdaptationOptions)
    smoother: SmootherSettings = field(default_factory=SmootherSettings)

    def __post_init__(self) -> None:
        unknown = [name for name in self.estimators if name not in ESTIMATORS]
        if unknown or not self.estimators:
            raise InputError(
                f"unknown estimator {shown(unknown[0]) if unknown else '(none given)'}; choose from {', '.join(ESTIMATORS)}"
            )
        if len(set(self.estimators)) < len(self.estimators):
            raise InputError(f"estimators {shown(list(self.estimators))} name one twice; name each once")

    @property
    def document(self) -> dict[str, Any]:
        """Every setting as TOML tables."""
        return {**asdict(self), "estimators": list(self.estimators)}


_TABLES = {
    "process": ProcessSettings,
    "sensors": SensorSettings,
    "start": StartOptions,
    "ukf": SigmaPointOptions,
    "landmarks": LandmarkOptions,
    "robust": RobustOptions,
    "iteration": IterationOptions,
    "adaptation": AdaptationOptions,
    "smoother": SmootherSettings,
}


def read_settings(path: Path) -> Settings:
    """Settings of a TOML file; what it does not mention keeps its default.

    Raises
    ------
    InputError: missing, too large, not TOML, an unknown key, a value of another type or out of range.
    """
    return settings_from(read_toml(path), named(path))


def settings_from(document: Mapping[str, Any], source: str) -> Settings:
    """Settings of parsed TOML; ``source`` names it in errors. Errors: `read_settings`."""
    values: dict[str, Any] = {}
    for key, value in document.items():
        if key == "estimators":
            if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
                raise InputError(f"{source}: estimators is {shown(value)}; give a list of names")
            values[key] = tuple(value)
        elif key in _TABLES:
            values[key] = _table(_TABLES[key], key, value, source)
        elif key != "provenance":
            raise InputError(
                f"{source}: unknown key {shown(key)}; known are estimators, {', '.join(_TABLES)}"
            )
    try:
        return Settings(**values)
    except InputError as error:
        raise InputError(f"{source}: {error}") from None


def _table(kind: type, name: str, value: object, source: str) -> Any:
    if not isinstance(value, dict):
        raise InputError(f"{source}: {name} is {shown(value)}; it must be a table [{name}]")
    known = {item.name: getattr(kind(), item.name) for item in fields(kind)}
    for key, entry in value.items():
        if key not in known:
            raise InputError(f"{source}: unknown key {name}.{shown(key)[1:-1]}; known are {', '.join(known)}")
        _check(source, f"{name}.{key}", known[key], entry)
    try:
        return kind(
            **{
                key: type(known[key])(entry) if isinstance(known[key], float) else entry
                for key, entry in value.items()
            }
        )
    except InputError as error:
        raise InputError(f"{source}: {error}") from None


def _check(where: str, name: str, default: object, value: object) -> None:
    """Refuse a value that is not of its default's type, or a number out of its range."""
    if isinstance(default, bool):
        good, wanted = isinstance(value, bool), "true or false"
    elif name in SETTING_RANGES:
        allowed = SETTING_RANGES[name]
        good, wanted = value in allowed, str(allowed)
        if default == AUTO:
            good, wanted = good or value == AUTO, f'"{AUTO}" or {wanted}'
    else:
        good, wanted = isinstance(value, str), "a name"
    if not good:
        raise InputError(f"{where}: {name} is {shown(value)}; give {wanted}")
