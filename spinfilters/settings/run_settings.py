"""Everything that can be set about a run, read from and written to TOML."""

from collections.abc import Mapping
from dataclasses import MISSING, asdict, dataclass, field, fields, make_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, Literal

from spinfilters.data.consider_parameter import consider_parameters
from spinfilters.data.dataset_options import DENSITIES
from spinfilters.data.input_file import path_text, read_toml, value_text
from spinfilters.data.sensor_format import noise_options
from spinfilters.data.stated_values import NumberRange, plain_number
from spinfilters.errors import InputError
from spinfilters.estimators.filters.iterated_update import IterationOptions
from spinfilters.estimators.filters.noise_adaptation import AdaptationOptions
from spinfilters.estimators.filters.sigma_points import SigmaPointOptions
from spinfilters.estimators.initialisation.options import InitialisationOptions
from spinfilters.estimators.landmarks.landmark_options import LandmarkOptions
from spinfilters.estimators.robust.gate_weights import RobustOptions
from spinfilters.models.process import ProcessNoise
from spinfilters.settings.estimator_names import DEFAULT_ESTIMATORS, estimator_names
from spinfilters.settings.smoother_settings import SmootherSettings

AUTO: Final = "auto"
Auto = Literal["auto"]
LINEAR, QUADRATIC = "linear", "quadratic"
DragLaw = Literal["linear", "quadratic", "auto"]

if TYPE_CHECKING:

    class SensorSettings:
        """Standard deviations of the sensors.

        "auto" takes the data set's own, or the default where it is silent.
        Its fields are the `NoiseOption` of all sensors. "auto" of an option that a sensor identifies (`Sensor.identified_option`)
        identifies it from the recording when nobody states the sensor's noise.
        """

        __dataclass_fields__: ClassVar[dict[str, Any]]

        def __init__(self, **options: float | str) -> None: ...

        def __getattr__(self, name: str) -> float | str: ...

else:
    SensorSettings = make_dataclass(
        "SensorSettings",
        [
            (name, Auto | Annotated[float, option.allowed], field(default=AUTO))
            for name, option in noise_options().items()
        ],
        frozen=True,
        namespace={"__doc__": "Standard deviations of the sensors, see the module."},
    )


if TYPE_CHECKING:

    class CalibrationSettings:
        """Standard deviations of the calibration.

        "auto" takes the data set's own, or the default where it is silent.
        Its fields are the `ConsiderParameter` of all sensors.
        """

        __dataclass_fields__: ClassVar[dict[str, Any]]

        def __init__(self, **deviations: float | str) -> None: ...

        def __getattr__(self, name: str) -> float | str: ...

else:
    CalibrationSettings = make_dataclass(
        "CalibrationSettings",
        [
            (name, Auto | Annotated[float, each.allowed], field(default=AUTO))
            for name, each in consider_parameters().items()
        ],
        frozen=True,
        namespace={"__doc__": "Standard deviations of the calibration, see the module."},
    )


class TruthValue:
    """Strict bool of a setting: no number, no text."""

    def __str__(self) -> str:
        return "true or false"

    def __get_pydantic_core_schema__(self, _source: object, _handler: object) -> Any:
        from pydantic_core import core_schema

        truth = core_schema.bool_schema(strict=True)
        return core_schema.no_info_before_validator_function(plain_number, truth)


@dataclass(frozen=True)
class ProcessSettings:
    """The process model.

    Attributes
    ----------
    force_psd: (m/s^2)^2/Hz.   torque_psd: (rad/s^2)^2/Hz. "auto" takes the data set's own; where it is silent it is
        identified (`spinfilters.pipeline.identified_noise`), but for the torque of a gyro of correlated unknown error: what
        the disturbances of thrown bodies were found to be (`spinfilters.pipeline.gyro_noise`).
    drag: whether the state has an aerodynamic drag coefficient, and of which law: torques "quadratic" in the rate (or true) or
        "linear"; "auto" takes the likelier of both where the first epochs tell one from none (`spinfilters.pipeline.drag_law`).
    gravity: whether the state has a constant acceleration; "auto" where the first epochs of a sensor of places ask for it.
    body_torque: whether the state has a constant body torque.
    rotor: whether the state has the angular momentum of a flywheel that turns steadily inside the body.
    tolerance: of the integrator, rad and relative rate per step.
    """

    force_psd: Auto | Annotated[float, DENSITIES["force_psd"]] = AUTO
    torque_psd: Auto | Annotated[float, DENSITIES["torque_psd"]] = AUTO
    drag: Annotated[bool, TruthValue()] | DragLaw = False
    gravity: Auto | Annotated[bool, TruthValue()] = AUTO
    body_torque: Annotated[bool, TruthValue()] = False
    rotor: Annotated[bool, TruthValue()] = False
    tolerance: Annotated[float, NumberRange(1e-12, 1e-2)] = 1e-8

    def noise(self, automatic: ProcessNoise) -> ProcessNoise:
        """Its noise densities, checked; ``automatic`` are those that nobody has set."""
        force_psd = automatic.force_psd if self.force_psd == AUTO else self.force_psd
        torque_psd = automatic.torque_psd if self.torque_psd == AUTO else self.torque_psd
        return ProcessNoise(force_psd, torque_psd)


@dataclass(frozen=True)
class Settings:
    """All settings of a run.

    The field names are those of the TOML file's tables and keys.
    Each table may be given as its own dataclass or as a mapping of its keys: ``Settings(sensors={"pixel_std": 0.5})``.

    Raises
    ------
    InputError: an unknown key of a table, a value of another type or out of its range, an unknown or repeated estimator.
    """

    estimators: tuple[str, ...] = DEFAULT_ESTIMATORS
    process: ProcessSettings = field(default_factory=ProcessSettings)
    sensors: SensorSettings = field(default_factory=SensorSettings)
    calibration: CalibrationSettings = field(default_factory=CalibrationSettings)
    initialisation: InitialisationOptions = field(default_factory=InitialisationOptions)
    ukf: SigmaPointOptions = field(default_factory=SigmaPointOptions)
    landmarks: LandmarkOptions = field(default_factory=LandmarkOptions)
    robust: RobustOptions = field(default_factory=RobustOptions)
    iteration: IterationOptions = field(default_factory=IterationOptions)
    adaptation: AdaptationOptions = field(default_factory=AdaptationOptions)
    smoother: SmootherSettings = field(default_factory=SmootherSettings)

    def __post_init__(self) -> None:
        for name, value in self._validated().items():
            object.__setattr__(self, name, value)
        known = estimator_names() if self.estimators != DEFAULT_ESTIMATORS else DEFAULT_ESTIMATORS
        unknown = [name for name in self.estimators if name not in known]
        if unknown or not self.estimators:
            raise InputError(
                f"unknown estimator {value_text(unknown[0]) if unknown else '(none given)'}; choose from "
                f"{', '.join(estimator_names())}"
            )
        if len(set(self.estimators)) < len(self.estimators):
            raise InputError(f"estimators {value_text(list(self.estimators))} name one twice; name each once")

    def _validated(self) -> dict[str, Any]:
        """Values of the fields that are not at their default."""
        given = {each.name: getattr(self, each.name) for each in fields(self)}
        changed = {name: value for name, value in given.items() if not _is_default(name, value)}
        if not changed:
            return {}
        from spinfilters.settings.setting_validation import validated  # pydantic takes a tenth of a second

        return validated(Settings, changed)

    @property
    def document(self) -> dict[str, Any]:
        """Every setting as TOML tables."""
        return {**asdict(self), "estimators": list(self.estimators)}


def read_settings(path: Path) -> Settings:
    """Settings of a TOML file; what it does not mention keeps its default.

    Raises
    ------
    InputError: missing, too large, not TOML, an unknown key, a value of another type or out of range.
    """
    return settings_from(read_toml(path), path_text(path))


def settings_from(document: Mapping[str, Any], source: str) -> Settings:
    """Settings of parsed TOML; ``source`` names it in errors. Errors: `read_settings`."""
    try:
        present = with_present_keys(document)
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    values = {key: value for key, value in present.items() if key != "provenance"}
    known = [each.name for each in fields(Settings)]
    for key in values:
        if key not in known:
            raise InputError(f"{source}: unknown key {value_text(key)}; known are {', '.join(known)}")
    try:
        return Settings(**values)
    except InputError as error:
        raise InputError(f"{source}: {error}") from None


def _is_default(name: str, value: object) -> bool:
    (each,) = (each for each in fields(Settings) if each.name == name)
    default = each.default if each.default_factory is MISSING else each.default_factory()
    return type(value) is type(default) and value == default


FORMER_TABLES = {"start": "initialisation"}
FORMER_KEYS = {
    "initialisation": {"frames": "epochs"},
    "smoother": {"frames": "epochs", "kernel": "loss"},
    "robust": {"kernel": "loss"},
}


def with_present_keys(document: Mapping[str, Any]) -> dict[str, Any]:
    """The document with former names of tables and keys replaced.

    Raises
    ------
    InputError: a table or key under its former and its present name.
    """
    tables = _renamed(document, FORMER_TABLES, "")
    return {
        name: _renamed(table, FORMER_KEYS.get(name, {}), f"{name}.") if isinstance(table, Mapping) else table
        for name, table in tables.items()
    }


def _renamed(table: Mapping[str, Any], former: Mapping[str, str], prefix: str) -> dict[str, Any]:
    for old, new in former.items():
        if old in table and new in table:
            raise InputError(f"{prefix}{old} and {prefix}{new} are one setting; keep {prefix}{new}")
    return {former.get(key, key): value for key, value in table.items()}
