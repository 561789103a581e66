"""Factors of a study: what a recording is made of, and the initial belief drawn around its truth.

Motion, body, sensor and noise are groups of the fields of a `Scenario`: keys, defaults and ranges are those that it states.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cache
from inspect import get_annotations, getdoc
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, TypeVar, get_args, get_origin

import numpy as np

from spinfilters.campaigns.row_columns import noise_levels
from spinfilters.core.errors import InputError
from spinfilters.evaluation.consistency import true_states
from spinfilters.inference.initial_estimate import InitialEstimate
from spinfilters.inference.setup import Setup, knows_frames
from spinfilters.io.dataset import Dataset
from spinfilters.io.disturbances import DENSITIES, DISTURBANCES
from spinfilters.io.input_file import value_text
from spinfilters.io.sensor_format import dataset_kinds
from spinfilters.io.stated_values import NumberRange
from spinfilters.models.feature_tracks import EveryAppearance, SomeAppearances
from spinfilters.models.process import ProcessNoise
from spinfilters.models.state_layout import StateLayout
from spinfilters.run.preparation import OTHER_STD, drawn_start, prepare
from spinfilters.settings.run_settings import Settings, TruthValue
from spinfilters.simulation.measurement_faults import (
    Dropout,
    Fault,
    FewAtFirst,
    FrozenEpochs,
    GrossError,
    NewIds,
    Outliers,
    PointsAtInfinity,
    WrongAssociations,
)
from spinfilters.simulation.model_faults import model_faults
from spinfilters.simulation.scenario import simulate
from spinfilters.simulation.scenario_record import INTERVAL, RECOGNITION, Scenario

STD: Final = NumberRange(1e-12, 1e6)
SHARE: Final = NumberRange(0.0, 1.0)
SHAPE: Final = NumberRange(1e-6, 1e6)
SECONDS: Final = NumberRange(0.0, 1e9, "s")
PSD: Final = NumberRange(1e-20, 1e6, zero=True)
COUNT: Final = NumberRange(0, 100_000, whole=True)
EPOCH: Final = NumberRange(-100_000, 100_000, whole=True)
MULTIPLE: Final = NumberRange(1e-6, 1e6)
Truth = Annotated[bool, TruthValue()]


class ScenarioFactor:
    """A factor whose keys are fields of a `Scenario`, with the defaults and ranges that these have there.

    Attributes
    ----------
    keys : Mapping[str, str]
        Key in the study file by the name of the scenario's field.
    """

    keys: ClassVar[Mapping[str, str]] = {}

    if TYPE_CHECKING:

        def __init__(self, **values: Any) -> None: ...

        def __getattr__(self, name: str) -> Any: ...

    @property
    def fields_of_scenario(self) -> dict[str, Any]:
        """Values by the names of the scenario's fields."""
        return {name: getattr(self, key) for name, key in self.keys.items()}


F = TypeVar("F", bound=ScenarioFactor)


def scenario_factor(table: str) -> Callable[[type[F]], type[F]]:
    """Decorator: a factor, with the fields of `Scenario` that its table holds (`StudyKey`) before its own."""

    def decorate(factor: type[F]) -> type[F]:
        """The factor as a frozen dataclass."""
        keys, hints = {}, {}
        for each in fields(Scenario):
            kind, *notes = get_args(each.type) if get_origin(each.type) is Annotated else (each.type,)
            for place in (note.study_key for note in notes):
                if place is not None and place.table == table:
                    key = keys[each.name] = place.key or each.name
                    hints[key] = kind if place.allowed is None else Annotated[kind, place.allowed]
                    setattr(factor, key, each.default)
        factor.keys = keys
        factor.__annotations__ = hints | get_annotations(factor)
        return dataclass(frozen=True)(factor)

    return decorate


def with_densities(factor: type[F]) -> type[F]:
    """Decorator: a factor, with the densities of the disturbances before its own fields."""
    for each in DISTURBANCES:
        setattr(factor, each.option, each.default)
    own = {each.option: Annotated[float, PSD] for each in DISTURBANCES}
    factor.__annotations__ = own | get_annotations(factor)
    rows = "".join(f"\n{each.option} : float\n    {each.words}" for each in DISTURBANCES)
    factor.__doc__ = f"{getdoc(factor)}{rows}"
    return factor


@scenario_factor("motion")
class MotionFactor(ScenarioFactor):
    """Initial motion of the body, and the epochs at which it is observed.

    ``attempts`` are the scenario's candidates: motions drawn until one stays in view; the last is taken if none does.
    """


@scenario_factor("body")
class BodyFactor(ScenarioFactor):
    """The body: inertia, centre of mass and landmarks."""

    def __post_init__(self) -> None:
        smallest, middle, largest = sorted(self.principal_moments)
        if not smallest + middle > largest:
            raise InputError(
                f"body.principal_moments are {list(self.principal_moments)}, of no rigid body; each must be less than the sum of "
                "the other two"
            )


@scenario_factor("sensor")
class SensorFactor(ScenarioFactor):
    """The sensor, and how a camera finds landmarks (`spinfilters.models.feature_tracks.FrontEnd`).

    Attributes
    ----------
    known_map : bool
        Whether estimators know where the landmarks are.
    beside : Mapping[str, float]
        Other sensors of the same motion, by kind, with their intervals in s.
    recognition : tuple[float, ...]
        Two shapes of the Beta distribution of how often an appearance is known again; empty for always.
    """

    known_map: Truth = False
    beside: Mapping[str, Annotated[float, INTERVAL]] = field(default_factory=dict)
    recognition: tuple[Annotated[float, SHAPE], ...] = RECOGNITION

    def __post_init__(self) -> None:
        if len(self.recognition) not in (0, 2):
            raise InputError(
                f"sensor.recognition has {len(self.recognition)} numbers; give two, or [] for always"
            )

    @property
    def fields_of_scenario(self) -> dict[str, Any]:
        """Values by the names of the scenario's fields, with the re-detection model of the landmarks in view."""
        recognition = SomeAppearances(*self.recognition) if self.recognition else EveryAppearance()
        return {
            **super().fields_of_scenario,
            "recognition": recognition,
            "beside": tuple(self.beside.items()),
        }


@scenario_factor("noise")
@with_densities
class NoiseFactor(ScenarioFactor):
    """True noise of the sensors and densities of the disturbances.

    Attributes
    ----------
    sensors : Mapping[str, float]
        By noise option, as in the settings' table [sensors], where it differs from the levels that sensors share.
    stated : bool
        Whether the data set states it to estimators, unless ``settings`` say otherwise; if not, they identify it.
    calibrated : bool
        Whether the calibration is stated to have no error; if not, estimators consider the errors that are usual.
    """

    sensors: Mapping[str, Annotated[float, STD]] = field(default_factory=dict)
    stated: Truth = True
    calibrated: Truth = True

    @property
    def fields_of_scenario(self) -> dict[str, Any]:
        """Values by the names of the scenario's fields, with the sensors' own noise and the densities of the disturbances."""
        return {
            **super().fields_of_scenario,
            "sensor_noise": tuple(self.sensors.items()),
            "noise": ProcessNoise(**{name: getattr(self, name) for name in DENSITIES}),
        }


@dataclass(frozen=True)
class FaultFactor:
    """Measurement faults (`spinfilters.simulation.measurement_faults`), applied in this order; none by default.

    Attributes
    ----------
    wrong_associations, outliers : float
        Shares.
    dropout_s : tuple[float, ...]
        Begin and end.
    frozen_epochs : tuple[int, ...]
        First epoch and how many repeat it.
    points_at_infinity : int
        How many in every epoch.
    new_ids_s : tuple[float, ...]
        Begin and end of a time in which no landmark is known again.
    few_at_first : tuple[float, ...]
        Share of the landmarks that are seen at first, and until when (s).
    gross_error : str
        Kind of a single wrong measurement (`spinfilters.simulation.measurement_faults`), "" for none.
    gross_error_epoch : int
        In which; negative ones count from the last.
    model : str
        What is wrong with the models (`spinfilters.simulation.model_faults`), "" for nothing.
    model_size : float
        Of that, in multiples of a plain size of its own.
    """

    wrong_associations: Annotated[float, SHARE] = 0.0
    outliers: Annotated[float, SHARE] = 0.0
    dropout_s: tuple[Annotated[float, SECONDS], ...] = ()
    frozen_epochs: tuple[Annotated[int, COUNT], ...] = ()
    points_at_infinity: Annotated[int, COUNT] = 0
    new_ids_s: tuple[Annotated[float, SECONDS], ...] = ()
    few_at_first: tuple[Annotated[float, SECONDS], ...] = ()
    gross_error: str = ""
    gross_error_epoch: Annotated[int, EPOCH] = 0
    model: str = ""
    model_size: Annotated[float, MULTIPLE] = 1.0

    def __post_init__(self) -> None:
        for name in ("dropout_s", "frozen_epochs", "new_ids_s", "few_at_first"):
            if len(getattr(self, name)) not in (0, 2):
                raise InputError(
                    f"fault.{name} has {len(getattr(self, name))} numbers; give two, or [] for none"
                )

        _ = self.faults  # refuses what no recording can have
        if self.model and self.model not in model_faults():
            raise InputError(
                f"fault.model is {value_text(self.model)}; use a name of the page on model errors, such as "
                f"{', '.join(list(model_faults())[:4])}"
            )

    @property
    def faults(self) -> list[Fault]:
        """Faults that the table asks for."""
        return [
            *_build_faults(WrongAssociations, _unless_zero(self.wrong_associations)),
            *_build_faults(Outliers, _unless_zero(self.outliers)),
            *_build_faults(Dropout, self.dropout_s),
            *_build_faults(FrozenEpochs, self.frozen_epochs),
            *_build_faults(PointsAtInfinity, _unless_zero(self.points_at_infinity)),
            *_build_faults(NewIds, self.new_ids_s),
            *_build_faults(FewAtFirst, self.few_at_first),
            *([GrossError(self.gross_error, self.gross_error_epoch)] if self.gross_error else []),
        ]


def _unless_zero(value: float) -> tuple[float, ...]:
    """A value of its own; nothing for zero."""
    return (value,) if value else ()


def _build_faults(kind: Callable[..., Fault], values: tuple[float, ...]) -> list[Fault]:
    """The fault of these values, if there are any."""
    return [kind(*values)] if values else []


@dataclass(frozen=True)
class BeliefFactor:
    """Standard deviations of the prior around the truth (``initialisation = "drawn"``)."""

    position_m: Annotated[float, STD] = 0.005
    attitude_rad: Annotated[float, STD] = 0.02
    velocity_m_s: Annotated[float, STD] = 0.005
    rate_rad_s: Annotated[float, STD] = 0.02
    center_of_mass_m: Annotated[float, STD] = 0.005
    mass_distribution: Annotated[float, STD] = 0.05

    @property
    def by_block(self) -> dict[str, float]:
        """Standard deviations by the name of the state block."""
        return {
            "t": self.position_m,
            "a": self.attitude_rad,
            "v": self.velocity_m_s,
            "w": self.rate_rad_s,
            "c": self.center_of_mass_m,
            "s": self.mass_distribution,
        }


@dataclass(frozen=True)
class RecordingFactors:
    """Everything that a simulated recording depends on but its seed."""

    motion: MotionFactor
    body: BodyFactor
    sensor: SensorFactor
    noise: NoiseFactor
    fault: FaultFactor

    @property
    def scenario(self) -> Scenario:
        """Simulated scenario of these factors.

        InputError: an unknown kind, a body that does not lie in front of the camera.
        """
        kind, model = self.sensor.kind, self.fault.model
        if model and kind not in model_faults()[model].kinds:
            raise InputError(
                f"fault.model {model} is none of {kind}; use {' or '.join(model_faults()[model].kinds)}"
            )
        values: dict[str, Any] = {}
        for factor in (self.motion, self.body, self.sensor, self.noise):
            values |= factor.fields_of_scenario
        return Scenario(**values)

    @property
    def levels(self) -> dict[str, float]:
        """True noise levels by the name of their option or density."""
        scenario = self.scenario
        true = scenario.noise.densities
        return {name: true[name] if name in true else scenario.level(name) for name in noise_levels()}


FACTORS: Final = ("motion", "body", "sensor", "noise", "fault", "belief", "settings", "estimator")
"""Factors of a study; the estimator varies fastest, so that runs of one recording follow one another."""


def prepared_with_drawn_belief(
    dataset: Dataset, settings: Settings, belief: BeliefFactor, generator: np.random.Generator
) -> Setup:
    """Prepared data set with an initial belief drawn around the truth.

    It is one of `require_frames`, for filters that begin at its first epoch.
    """
    truth = dataset.truth
    assert truth is not None  # what is simulated has one

    def initial(layout: StateLayout) -> InitialEstimate:
        """The drawn belief as an initialisation over a layout."""
        std = np.zeros(layout.error_dim)
        for block in layout.blocks:
            std[layout.slice(block)] = belief.by_block.get(block, OTHER_STD)
        return drawn_start(layout, true_states(truth, layout)[0], np.diag(std), generator)

    return prepare(dataset, settings, initial)


def prepared_about_truth(dataset: Dataset, settings: Settings, belief: BeliefFactor, seed: int) -> Setup:
    """Prepared data set of a user's own, with a belief drawn about its truth. InputError: it has none."""
    if dataset.truth is None:
        raise InputError(
            f"{dataset.name}: a drawn belief needs a truth (truth.csv), and this recording has none; give "
            'initialisation = "data" and seeds = 1'
        )
    drawn = replace(settings.initialisation, from_truth=True, draw=seed, std=dict(belief.by_block), mean={})
    return prepare(dataset, replace(settings, initialisation=drawn))


def require_frames(sensor: SensorFactor) -> None:
    """Refuse sensors whose frames are not those of the truth.

    A belief is drawn in the frames of the truth, which unknown landmarks do not determine.
    """
    if sensor.known_map:
        return
    form = dataset_kinds()[sensor.kind]
    if form.has_landmarks:
        raise InputError(
            "a drawn belief needs a sensor whose frames are those of the truth; give sensor.known_map = true, or "
            'initialisation = "data"'
        )
    if not _knows_frames(sensor.kind):
        raise InputError(
            f"a drawn belief needs a sensor whose frames are those of the truth, and {sensor.kind} defines none; give "
            'initialisation = "data", or another sensor.kind, such as "pose"'
        )


@cache
def _knows_frames(kind: str) -> bool:
    """Whether measurements of a kind, of which two epochs are simulated, are in frames that are given."""
    return knows_frames(simulate(Scenario.simplified(kind=kind, epochs=2)))
