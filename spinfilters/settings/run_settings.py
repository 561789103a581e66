"""Everything that can be set about a run: tables, keys, ranges and defaults, read from and written to TOML."""

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, asdict, dataclass, field, fields, make_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, Literal

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.core.plugins import in_order, members_above
from spinfilters.core.robust_losses import LOSS_NAMES, RobustLoss, build_loss
from spinfilters.filters.error_coordinates import InvariantOptions
from spinfilters.filters.iterated_update import IterationOptions
from spinfilters.filters.measurement_prediction import SigmaPointOptions
from spinfilters.filters.noise_levels import AdaptationOptions
from spinfilters.filters.outlier_rejection import RobustOptions
from spinfilters.filters.shared_modes import LandmarkOptions
from spinfilters.filters.timeline import Timeline, times_of
from spinfilters.io.consider_parameter import consider_parameters
from spinfilters.io.disturbances import DENSITIES, DISTURBANCES, density_rows
from spinfilters.io.input_file import nearest_text, path_text, read_toml, unknown_key, value_text
from spinfilters.io.sensor_format import noise_options
from spinfilters.io.stated_values import NumberRange, plain_number
from spinfilters.models.process import ProcessNoise
from spinfilters.models.state_blocks import (
    BLOCKS,
    CENTRE_OF_MASS,
    DRAG,
    LINEAR_DRAG,
    MASS_DISTRIBUTION,
    VELOCITY,
    StateBlock,
)
from spinfilters.settings.stated_belief import require_belief
from spinfilters.smoother.sliding_smoother import SmootherOptions
from spinfilters.smoother.solver import STEP_RULES
from spinfilters.smoother.window import FixedLag, FullSmoothing, LandmarkMarginalization, WindowPolicy

PRIOR_STD = NumberRange(1e-9, 1e9)
"""Of a prior in the settings, in its unit."""
_OPTIONAL_PRIORS = {block.prior_option: block.prior_range for block in BLOCKS.values() if block.prior_range}
"""Ranges of the options of blocks that a state has only where they are set."""


class TruthValue:
    """Strict bool of a setting: no number, no text."""

    def __str__(self) -> str:
        return "true or false"

    def __get_pydantic_core_schema__(self, _source: object, _handler: object) -> Any:
        from pydantic_core import core_schema

        truth = core_schema.bool_schema(strict=True)
        return core_schema.no_info_before_validator_function(plain_number, truth)


def _record_of(
    name: str, doc: str, kinds: Mapping[str, Any], defaults: Mapping[str, Any], bases: tuple[type, ...] = ()
) -> type:
    """Frozen dataclass of options that a table of the package lists: type and default of each."""
    return make_dataclass(
        name,
        [(option, kind, field(default=defaults[option])) for option, kind in kinds.items()],
        bases=bases,
        frozen=True,
        namespace={"__doc__": doc, "__module__": __name__},
    )


@dataclass(frozen=True)
class _OptionsOfEveryState:
    """Options of the initialisation that every state has; see `InitialisationOptions`.

    Attributes
    ----------
    epochs : int
        Largest number of epochs of the initialisation.
    share : float
        Largest share of the recording; a third more if filters need it.
    duration : float
        Largest duration of the initialisation, s.
    iterations : int
        Largest number of iterations of its smoother.
    mass_std : float
        Standard deviation of the prior of the mass distribution about the sphere, in ln of second moments (2 for a phone).
    centre_std : float
        Standard deviation of the prior of the centre of mass about the origin of g, m.
    speed_std : float
        Standard deviation of the prior of its velocity, m/s.
    drag_std : float
        Standard deviation of the prior of quadratic drag, 1/rad.
    linear_drag_std : float
        Standard deviation of the prior of linear drag, 1/s.
    mean : dict
        Mean of a belief at the first epoch, from which every estimator starts instead of smoothed epochs. Its blocks are position
        (of frame g in i, m), attitude (q_ig), velocity (of the centre of mass, m/s), rate (rad/s, g axes), center_of_mass (m, g),
        and mass_distribution or principal_moments (about the axes of g).
    std : dict
        Standard deviations of that belief, by block. Without them velocity, centre of mass and mass distribution have speed_std,
        centre_std and mass_std; the others must be stated.
    covariance : tuple of tuples of float
        Covariance instead of standard deviations, of the errors in the order of the state.
    from_truth : bool
        Whether the mean of that belief is the truth of the first epoch with an error drawn from std or covariance.
    draw : int
        Seed of that error.
    """

    epochs: Annotated[int, NumberRange(1, 100_000, whole=True)] = 60
    share: Annotated[float, NumberRange(1e-6, 1e6)] = 0.6
    duration: Annotated[float, NumberRange(1e-6, 1e11, "s")] = 60.0
    iterations: Annotated[int, NumberRange(1, 10_000, whole=True)] = 40
    mass_std: Annotated[float, PRIOR_STD] = MASS_DISTRIBUTION.prior_std
    centre_std: Annotated[float, PRIOR_STD] = CENTRE_OF_MASS.prior_std
    speed_std: Annotated[float, PRIOR_STD] = VELOCITY.prior_std
    drag_std: Annotated[float, PRIOR_STD] = DRAG.prior_std
    linear_drag_std: Annotated[float, PRIOR_STD] = LINEAR_DRAG.prior_std
    mean: dict[str, Any] = field(default_factory=dict, hash=False)
    std: dict[str, Any] = field(default_factory=dict, hash=False)
    covariance: tuple[tuple[float, ...], ...] = ()
    from_truth: Annotated[bool, TruthValue()] = False
    draw: Annotated[int, NumberRange(0, 2**63 - 1, whole=True)] = 0

    def __post_init__(self) -> None:
        require_belief(self.mean, self.std, self.covariance)
        if self.from_truth and self.mean:
            raise InputError("initialisation.from_truth takes the mean from the truth; leave out mean")
        if (self.std or self.covariance) and not self.states_belief:
            raise InputError(
                "initialisation.std and covariance are of a belief; state its mean too, or from_truth = true"
            )
        for name in _NUMBERS:
            value = getattr(self, name)
            allowed = value >= 0 if name in _OPTIONAL_PRIORS else value > 0
            if not (np.isfinite(value) and allowed):
                raise InputError(f"initialisation.{name} is {value}; it must be positive")

    @property
    def states_belief(self) -> bool:
        """Whether every estimator begins from a belief that is stated, and no first epochs are smoothed."""
        return bool(self.mean) or self.from_truth

    def states_prior(self, block: StateBlock) -> bool:
        """Whether the option that a block names for its prior is set."""
        return bool(block.prior_option and getattr(self, block.prior_option))

    def prior_std(self, block: StateBlock) -> float:
        """Prior standard deviation of a block.

        The option that the block names where that is set, or the block's own.
        """
        return (getattr(self, block.prior_option) if block.prior_option else 0.0) or block.prior_std

    def count(self, timeline: Timeline) -> int:
        """Number of epochs used for initialisation."""
        time = times_of(timeline)
        inside = int(np.searchsorted(time, time[0] + self.duration, "right"))
        return max(4, min(self.epochs, inside, round(self.share * len(timeline))))


_NUMBERS: Final = (
    *("epochs", "share", "duration", "iterations", "mass_std", "centre_std", "speed_std"),
    *("drag_std", "linear_drag_std", *_OPTIONAL_PRIORS),
)
"""Options that are numbers, which must be positive."""

if TYPE_CHECKING:

    class InitialisationOptions(_OptionsOfEveryState):
        """Options of the initialisation.

        In addition to those named in `_OptionsOfEveryState` each state block with a `prior_range` has one, by default 0: such as
        gyro_bias_std, of the prior of a gyro's bias, rad/s, or gyro_scale_error_std, of that of its relative scale error.
        """

        mean: dict[str, Any]
        std: dict[str, Any]
        covariance: tuple[tuple[float, ...], ...]

        def __init__(self, **options: Any) -> None: ...

        def __getattr__(self, name: str) -> float: ...

else:
    InitialisationOptions = _record_of(
        "InitialisationOptions",
        "Options of the initialisation, see the module.",
        {name: Annotated[float, allowed] for name, allowed in _OPTIONAL_PRIORS.items()},
        dict.fromkeys(_OPTIONAL_PRIORS, 0.0),
        (_OptionsOfEveryState,),
    )


PRESETS: Final = Path(__file__).parent / "presets"
"""Folder of the settings that have a name."""
DEFAULT_ESTIMATORS: Final = ("mekf", "ukf", "smoother")
"""Estimators of a comparison unless some are named."""


class NamedEstimator:
    """An estimator as far as settings know it.

    Attributes
    ----------
    name : str
        As in ``--estimators``; also its folder in a run.
    order : int
        Of the table and of messages.
    """

    name: str
    order: int = 100


def estimator_names() -> tuple[str, ...]:
    """Names of all estimators, in the order of the table. InputError: a plug-in that cannot be loaded.

    Returns
    -------
    tuple[str, ...]
        Names of this package's estimators, and those of installed distributions.
    """
    every = in_order(members_above("spinfilters.estimators", NamedEstimator))
    return tuple(dict.fromkeys(each.name for each in every))


def names_in(text: str) -> tuple[str, ...]:
    """Names that a text lists with commas.

    Parameters
    ----------
    text : str
        As "mekf, ukf".

    Returns
    -------
    tuple[str, ...]
        The names, without blanks.
    """
    return tuple(name.strip() for name in text.split(",") if name.strip())


MODES = ("automatic", "full", "frozen", "window")
FEW = 300
"""Epochs up to which "automatic" keeps everything."""


@dataclass(frozen=True)
class SmootherSettings:
    """Settings of the smoother on tracks without a map.

    Attributes
    ----------
    mode : str
        "full" keeps everything, "frozen" marginalizes landmarks that are unseen for some revolutions, "window" keeps the latest
        epochs; "automatic" is "full" for short recordings and "frozen" for others.
    epochs : int
        Smallest number of kept epochs in the modes "frozen" and "window".
    revolutions : float
        Revolutions after which an unseen landmark is marginalized in the mode "frozen".
    loss : str
        Loss of a residual: "gate" (none beyond width), "huber", "pseudo-huber", "barron" (alpha = shape) or "none" (least squares).
    width : float
        Residual from which the loss is no longer quadratic, standard deviations.
    shape : float
        Barron's alpha, at most 2.
    iterations : int
        Largest number of iterations per epoch.
    step : str
        How an iteration steps: "gauss-newton" (the whole step, halved while the cost rises) or "dogleg" (within a trust radius).
    """

    mode: str = "automatic"
    epochs: Annotated[int, NumberRange(2, 1_000_000, whole=True)] = 180
    revolutions: Annotated[float, NumberRange(1e-6, 1e9)] = 8.0
    loss: str = "gate"
    width: Annotated[float, NumberRange(1e-6, 1e9)] = 5.0
    shape: Annotated[float, NumberRange(-1e9, 2)] = 0.0
    iterations: Annotated[int, NumberRange(1, 1000, whole=True)] = 4
    step: str = "gauss-newton"

    def __post_init__(self) -> None:
        if self.mode not in MODES:
            raise InputError(f"smoother.mode {self.mode!r} is unknown; choose from {', '.join(MODES)}")
        if self.loss not in LOSS_NAMES:
            raise InputError(f"smoother.loss {self.loss!r} is unknown; choose from {', '.join(LOSS_NAMES)}")
        if self.step not in STEP_RULES:
            raise InputError(f"smoother.step {self.step!r} is unknown; choose from {', '.join(STEP_RULES)}")
        if not self.width > 0:
            raise InputError(f"smoother.width is {self.width}; give a positive number of standard deviations")
        LandmarkMarginalization(self.revolutions, self.epochs)
        self.options(0)

    def options(self, epochs: int) -> SmootherOptions:
        """For a recording of so many epochs.

        Parameters
        ----------
        epochs : int
            Number of epochs of the recording, by which the mode "automatic" decides.

        Returns
        -------
        SmootherOptions
            Options of the sliding smoother.
        """
        mode = self._mode(epochs)
        rule = STEP_RULES[self.step]()
        return SmootherOptions(mode, iterations=self.iterations, loss=self.robust_loss, step_rule=rule)

    @property
    def robust_loss(self) -> RobustLoss:
        """Robust loss of every sensor's residuals."""
        return build_loss(self.loss, self.width, self.shape)

    def _mode(self, epochs: int) -> WindowPolicy:
        if self.mode == "full" or (self.mode == "automatic" and epochs <= FEW):
            return FullSmoothing()
        return (
            FixedLag(self.epochs)
            if self.mode == "window"
            else LandmarkMarginalization(self.revolutions, self.epochs)
        )


AUTO: Final = "auto"
Auto = Literal["auto"]
LINEAR, QUADRATIC = "linear", "quadratic"
FULL, FILTER = "full", "filter"
DragLaw = Literal["linear", "quadratic", "auto"]

if TYPE_CHECKING:

    class SensorSettings:
        """Standard deviations of the sensors.

        "auto" takes the data set's own, or the default where it is silent.
        Its fields are the `NoiseOption` of all sensors. "auto" of an option that a sensor identifies (`Sensor.identified_option`)
        identifies it from the recording when the sensor's noise is unspecified.
        """

        __dataclass_fields__: ClassVar[dict[str, Any]]

        def __init__(self, **options: float | str) -> None: ...

        def __getattr__(self, name: str) -> float | str: ...

else:
    SensorSettings = _record_of(
        "SensorSettings",
        "Standard deviations of the sensors, see the module.",
        {name: Auto | Annotated[float, option.allowed] for name, option in noise_options().items()},
        dict.fromkeys(noise_options(), AUTO),
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
    CalibrationSettings = _record_of(
        "CalibrationSettings",
        "Standard deviations of the calibration, see the module.",
        {name: Auto | Annotated[float, each.allowed] for name, each in consider_parameters().items()},
        dict.fromkeys(consider_parameters(), AUTO),
    )


if TYPE_CHECKING:

    @dataclass(frozen=True)
    class _DensitySettings:
        force_psd: float | Auto = AUTO
        torque_psd: float | Auto = AUTO

else:
    _DensitySettings = _record_of(
        "_DensitySettings",
        density_rows('float or "auto"'),
        {each.option: Auto | Annotated[float, each.allowed] for each in DISTURBANCES},
        {each.option: each.setting for each in DISTURBANCES},
    )


@dataclass(frozen=True)
class ProcessSettings(_DensitySettings):
    """The process model.

    Besides the attributes below, the density of each disturbance is a field: those of `spinfilters.io.disturbances.DENSITIES`.

    Attributes
    ----------
    drag : bool, "linear", "quadratic" or "auto"
        Whether the state has an aerodynamic drag coefficient, and its law: torques "quadratic" in the rate (or true) or
        "linear"; "auto" takes the likelier of both if the first epochs distinguish it from none (`spinfilters.run.preparation`).
    gravity : bool or "auto"
        Whether the state has a constant acceleration; "auto" if the first epochs of a sensor of positions need it.
    body_torque : bool
        Whether the state has a constant body torque.
    rotor : bool
        Whether the state has the angular momentum of a flywheel that turns steadily inside the body.
    tolerance : float
        Tolerance of the integrator, rad and relative rate per step.
    """

    drag: Annotated[bool, TruthValue()] | DragLaw = False
    gravity: Auto | Annotated[bool, TruthValue()] = AUTO
    body_torque: Annotated[bool, TruthValue()] = False
    rotor: Annotated[bool, TruthValue()] = False
    tolerance: Annotated[float, NumberRange(1e-12, 1e-2)] = 1e-8

    def noise(self, automatic: ProcessNoise) -> ProcessNoise:
        """Its noise densities, checked; ``automatic`` are those that are not set.

        Parameters
        ----------
        automatic : ProcessNoise
            Densities in place of those that are "auto".

        Returns
        -------
        ProcessNoise
            Densities of the disturbances.
        """
        stated = {name: getattr(self, name) for name in DENSITIES}
        chosen = {name: value for name, value in stated.items() if value != AUTO}
        return replace(automatic, **chosen)


@dataclass(frozen=True)
class Settings:
    """All settings of a run.

    The field names are those of the TOML file's tables and keys.
    Each table may be given as its own dataclass or as a mapping of its keys: ``Settings(sensors={"pixel_std": 0.5})``.

    Attributes
    ----------
    estimators : tuple[str, ...]
        Names of the estimators, in the order of the results.
    process : ProcessSettings
        Disturbances of the motion, and which constants the state has.
    sensors : SensorSettings
        Standard deviations of the sensors' noise.
    calibration : CalibrationSettings
        Standard deviations of the calibration's errors.
    initialisation : InitialisationOptions
        How many epochs begin the estimates, and the prior of their first state.
    ukf : SigmaPointOptions
        Spread and weights of the UKF's sigma points.
    invariant : InvariantOptions
        Error coordinates of the invariant EKF.
    landmarks : LandmarkOptions
        How filters represent landmarks of an unknown map.
    robust : RobustOptions
        Gate and robust loss of the filters.
    iteration : IterationOptions
        Iterated updates of the MEKF.
    adaptation : AdaptationOptions
        Which noise levels filters adapt to their innovations.
    smoother : SmootherSettings
        Window, robust loss and iterations of the smoother.
    verdict : "full" or "filter"
        Checks of the verdict: "full" makes all, "filter" only those that need no smoothed motion. These cost less, but every
        estimate is ``degraded`` at best, because they do not show errors of the models that a filter's state absorbs.

    Raises
    ------
    InputError
        An unknown key of a table, a value of another type or out of its range, an unknown or repeated estimator.
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
    invariant: InvariantOptions = field(default_factory=InvariantOptions)
    verdict: Literal["full", "filter"] = FULL

    def __post_init__(self) -> None:
        for name, value in self._validated().items():
            object.__setattr__(self, name, value)
        known = estimator_names() if self.estimators != DEFAULT_ESTIMATORS else DEFAULT_ESTIMATORS
        unknown = [name for name in self.estimators if name not in known]
        if unknown or not self.estimators:
            meant = nearest_text(unknown[0], estimator_names()) if unknown else ""
            raise InputError(
                f"unknown estimator {value_text(unknown[0]) if unknown else '(none given)'}; "
                f"{meant or 'choose from ' + ', '.join(estimator_names())}"
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
        own = {
            "estimators": list(self.estimators),
            "verdict": self.verdict,
        }  # keys of no table stand first in TOML
        return own | {name: _as_toml(table) for name, table in asdict(self).items() if name not in own}


def read_settings(path: Path) -> Settings:
    """Settings of a TOML file; what it does not mention keeps its default.

    Parameters
    ----------
    path : Path
        A TOML file, or the name of one in `PRESETS` where no file of that name is there.

    Returns
    -------
    Settings
        Validated settings.

    Raises
    ------
    InputError
        Missing, too large, not TOML, an unknown key, a value of another type or out of range.
    """
    preset = PRESETS / f"{path.name}.toml"
    if path == Path(path.name) and not path.exists() and preset.is_file():
        path = preset
    return settings_from(read_toml(path), path_text(path))


def settings_from(document: Mapping[str, Any], source: str) -> Settings:
    """Settings of parsed TOML; ``source`` names it in errors. Errors: `read_settings`.

    Parameters
    ----------
    document : Mapping[str, Any]
        Tables and keys, as TOML gives them.
    source : str
        Name of the file or caller, for messages.

    Returns
    -------
    Settings
        Validated settings.
    """
    try:
        present = with_present_keys(document)
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    values = {key: value for key, value in present.items() if key != "provenance"}
    known = [each.name for each in fields(Settings)]
    for key in values:
        if key not in known:
            raise InputError(f"{source}: {unknown_key(value_text(key), key, known)}")
    try:
        return Settings(**values)
    except InputError as error:
        raise InputError(f"{source}: {error}") from None


def with_keys(settings: Settings, changes: Sequence[str]) -> Settings:
    """The settings with some keys changed, each a text such as ``sensors.pixel_std=0.5``.

    The value is that of TOML; what is no TOML is a text. InputError: no key or value, or one that cannot be.
    """
    import tomllib  # slow to import, and rarely needed

    document = settings.document
    for text in changes:
        key, equals, value = text.partition("=")
        *tables, last = (part.strip() for part in key.split("."))
        if not equals or not last or not value.strip() or len(tables) > _DEEPEST:
            raise InputError(
                f"--set {value_text(text)} is no setting; give KEY=VALUE, such as sensors.pixel_std=0.5"
            )
        place: Any = document
        for table in tables:
            place = place.setdefault(table, {}) if isinstance(place, dict) else None
        if not isinstance(place, dict):
            raise InputError(f"--set {value_text(text)}: {'.'.join(tables)} is no table; give another key")
        try:
            read = tomllib.loads(f"value = {value}")
        except (ValueError, RecursionError):  # also an integer of more digits than Python reads
            read = {}
        place[last] = read["value"] if set(read) == {"value"} else value.strip()
    return settings_from(document, "--set")


_DEEPEST: Final = 3  # tables within tables


def _as_toml(value: Any) -> Any:
    """Tables and lists as TOML reads them again, so that a document equals the one of its file."""
    if isinstance(value, dict):
        return {name: _as_toml(inner) for name, inner in value.items()}
    return [_as_toml(inner) for inner in value] if isinstance(value, list | tuple) else value


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

    Parameters
    ----------
    document : Mapping[str, Any]
        Tables and keys, some perhaps under former names.

    Returns
    -------
    dict[str, Any]
        The same under present names.

    Raises
    ------
    InputError
        A table or key under its former and its present name.
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
