"""Factors of a study: what a recording is made of, and the initial belief drawn around its truth.

The defaults are those of a `Scenario`: the bundled example.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Final

import numpy as np
from jaxtyping import Float

from spinfilters.campaigns.row_columns import noise_levels
from spinfilters.core.errors import InputError
from spinfilters.evaluation.consistency import true_states
from spinfilters.inference.initial_estimate import InitialEstimate
from spinfilters.inference.setup import Setup
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import value_text
from spinfilters.io.sensor_format import dataset_kinds
from spinfilters.io.stated_values import LENGTH, RATE, SPEED, NumberRange
from spinfilters.models.feature_tracks import EveryAppearance, Recognition, SomeAppearances
from spinfilters.models.process import ProcessNoise
from spinfilters.models.sensor_registry import sensor_of
from spinfilters.models.state_layout import StateLayout
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings, TruthValue
from spinfilters.simulation.bundled_example import RECOGNITION
from spinfilters.simulation.measurement_faults import (
    Dropout,
    Fault,
    FewAtFirst,
    FrozenFrames,
    GrossError,
    NewIds,
    Outliers,
    PointsAtInfinity,
    WrongAssociations,
)
from spinfilters.simulation.model_faults import model_faults
from spinfilters.simulation.scenario import Scenario
from spinfilters.smoother.priors import FirstStatePrior

RPM = NumberRange(-1e6, 1e6, "rpm")
MOMENT = NumberRange(1e-6, 1e6)
STD = NumberRange(1e-12, 1e6)
SHARE = NumberRange(0.0, 1.0)
SHAPE = NumberRange(1e-6, 1e6)
SECONDS = NumberRange(0.0, 1e9, "s")
PSD = NumberRange(1e-20, 1e6, zero=True)
EPOCHS = NumberRange(5, 100_000, whole=True)
COUNT = NumberRange(0, 100_000, whole=True)
EPOCH = NumberRange(-100_000, 100_000, whole=True)
EXAMPLE = Scenario()
"""Defaults of all factors."""
MULTIPLE = NumberRange(1e-6, 1e6)
Triple = tuple[Annotated[float, LENGTH], Annotated[float, LENGTH], Annotated[float, LENGTH]]


@dataclass(frozen=True)
class MotionFactor:
    """Initial motion of the body, and the epochs at which it is observed.

    Attributes
    ----------
    rate_rpm : tuple[float, float, float]
        About the principal axes.
    velocity_m_s : tuple[float, float, float]
        Of the centre of mass, frame i.
    range_m : float
        Along the camera's axis.
    attempts : int
        Motions drawn until one stays in view; the last is taken if none does.
    """

    rate_rpm: tuple[Annotated[float, RPM], Annotated[float, RPM], Annotated[float, RPM]] = EXAMPLE.rate_rpm
    epochs: Annotated[int, EPOCHS] = EXAMPLE.epochs
    interval_s: Annotated[float, NumberRange(1e-6, 1e5, "s")] = EXAMPLE.interval
    velocity_m_s: tuple[Annotated[float, SPEED], Annotated[float, SPEED], Annotated[float, SPEED]] = (
        EXAMPLE.velocity
    )
    range_m: Annotated[float, NumberRange(1e-3, 1e6, "m")] = EXAMPLE.range_m
    attempts: Annotated[int, NumberRange(1, 10_000, whole=True)] = EXAMPLE.candidates


@dataclass(frozen=True)
class BodyFactor:
    """The body: inertia, centre of mass and landmarks.

    Principal moments of any scale, centre of mass in g, axes by yaw, pitch and roll.
    """

    principal_moments: tuple[Annotated[float, MOMENT], Annotated[float, MOMENT], Annotated[float, MOMENT]] = (
        EXAMPLE.principal_moments
    )
    center_of_mass_m: Triple = EXAMPLE.center_of_mass_g
    axes_euler_rad: Triple = EXAMPLE.axes_euler_g
    landmarks: Annotated[int, NumberRange(4, 100_000, whole=True)] = EXAMPLE.landmarks
    radius_m: Annotated[float, NumberRange(1e-3, 1e6, "m")] = EXAMPLE.radius_m

    def __post_init__(self) -> None:
        smallest, middle, largest = sorted(self.principal_moments)
        if not smallest + middle > largest:
            raise InputError(
                f"body.principal_moments are {list(self.principal_moments)}, of no rigid body; each must be less than the sum of "
                "the other two"
            )


@dataclass(frozen=True)
class SensorFactor:
    """The sensor, and how a camera finds landmarks (`spinfilters.models.feature_tracks.FrontEnd`).

    Attributes
    ----------
    known_map : bool
        Whether estimators are told where the landmarks are.
    recognition : tuple[float, ...]
        Two shapes of the Beta distribution of how often an appearance is known again; empty for always.
    """

    kind: str = EXAMPLE.kind
    known_map: Annotated[bool, TruthValue()] = False
    detection: Annotated[float, NumberRange(1e-6, 1.0)] = EXAMPLE.detection
    facing_cosine: Annotated[float, NumberRange(-1.0, 0.999)] = EXAMPLE.facing_cosine
    recognition: tuple[Annotated[float, SHAPE], ...] = RECOGNITION
    fewest_observations: Annotated[int, COUNT] = EXAMPLE.fewest_observations

    def __post_init__(self) -> None:
        if len(self.recognition) not in (0, 2):
            raise InputError(
                f"sensor.recognition has {len(self.recognition)} numbers; give two, or [] for always"
            )

    @property
    def recognised(self) -> Recognition:
        """Re-detection model of the landmarks in view."""
        return SomeAppearances(*self.recognition) if self.recognition else EveryAppearance()


@dataclass(frozen=True)
class NoiseFactor:
    """True noise of the sensors and densities of the disturbances.

    Attributes
    ----------
    sensors : Mapping[str, float]
        By noise option, as in the settings' table [sensors], where it differs from the levels that sensors share.
    stated : bool
        Whether estimators are told it, unless ``settings`` say otherwise; if not, they identify it.
    calibrated : bool
        Whether they are told that the calibration has no error; if not, they consider the errors that are
        usual.
    """

    pixel_std: Annotated[float, STD] = EXAMPLE.pixel_std
    position_std_m: Annotated[float, STD] = EXAMPLE.position_std
    rotation_std_rad: Annotated[float, STD] = EXAMPLE.rotation_std
    gyro_std_rad_s: Annotated[float, STD] = EXAMPLE.gyro_std
    gyro_bias_rad_s: tuple[Annotated[float, RATE], Annotated[float, RATE], Annotated[float, RATE]] = (
        EXAMPLE.gyro_bias
    )
    sensors: Mapping[str, Annotated[float, STD]] = field(default_factory=dict)
    force_psd: Annotated[float, PSD] = EXAMPLE.noise.force_psd
    torque_psd: Annotated[float, PSD] = EXAMPLE.noise.torque_psd
    stated: Annotated[bool, TruthValue()] = True
    calibrated: Annotated[bool, TruthValue()] = True


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
            *_made(WrongAssociations, _given(self.wrong_associations)),
            *_made(Outliers, _given(self.outliers)),
            *_made(Dropout, self.dropout_s),
            *_made(FrozenFrames, self.frozen_epochs),
            *_made(PointsAtInfinity, _given(self.points_at_infinity)),
            *_made(NewIds, self.new_ids_s),
            *_made(FewAtFirst, self.few_at_first),
            *([GrossError(self.gross_error, self.gross_error_epoch)] if self.gross_error else []),
        ]


def _given(value: float) -> tuple[float, ...]:
    """A value of its own; nothing for zero."""
    return (value,) if value else ()


def _made(kind: Callable[..., Fault], values: tuple[float, ...]) -> list[Fault]:
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
        motion, body, sensor, noise, model = self.motion, self.body, self.sensor, self.noise, self.fault.model
        if model and sensor.kind not in model_faults()[model].kinds:
            raise InputError(
                f"fault.model {model} is none of {sensor.kind}; use {' or '.join(model_faults()[model].kinds)}"
            )
        return Scenario(
            kind=sensor.kind,
            principal_moments=body.principal_moments,
            rate_rpm=motion.rate_rpm,
            epochs=motion.epochs,
            interval=motion.interval_s,
            range_m=motion.range_m,
            velocity=motion.velocity_m_s,
            center_of_mass_g=body.center_of_mass_m,
            axes_euler_g=body.axes_euler_rad,
            landmarks=body.landmarks,
            radius_m=body.radius_m,
            detection=sensor.detection,
            facing_cosine=sensor.facing_cosine,
            recognition=sensor.recognised,
            fewest_observations=sensor.fewest_observations,
            pixel_std=noise.pixel_std,
            position_std=noise.position_std_m,
            rotation_std=noise.rotation_std_rad,
            gyro_std=noise.gyro_std_rad_s,
            sensor_noise=tuple(noise.sensors.items()),
            gyro_bias=noise.gyro_bias_rad_s,
            noise=ProcessNoise(noise.force_psd, noise.torque_psd),
            candidates=motion.attempts,
        )

    @property
    def levels(self) -> dict[str, float]:
        """True noise levels by the name of their option or density."""
        scenario = self.scenario
        true = {"force_psd": scenario.noise.force_psd, "torque_psd": scenario.noise.torque_psd}
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
        return drawn_start(layout, true_states(truth, layout)[0], belief, generator)

    return prepare(dataset, settings, initial)


def require_frames(sensor: SensorFactor) -> None:
    """Refuse sensors whose frames are not those of the truth.

    A belief is drawn in the frames of the truth, which unknown landmarks do not tell.
    """
    if not sensor.known_map and not sensor_of(dataset_kinds()[sensor.kind].name).tells_frames:
        raise InputError(
            "a drawn belief needs a sensor that tells the frames of the truth; give sensor.known_map = true, or "
            'initialisation = "data"'
        )


def drawn_start(
    layout: StateLayout, true: Float[np.ndarray, " m"], belief: BeliefFactor, generator: np.random.Generator
) -> InitialEstimate:
    """An initialisation of one epoch whose error is drawn from its own covariance.

    The truth is ``mean [+] e`` with e ~ N(0, P); drawn as mean = true [+] (-e), which is the same to first order.
    """
    std = np.zeros(layout.error_dim)
    for block in layout.blocks:
        std[layout.slice(block)] = belief.by_block.get(block, 1e-3)
    mean = layout.retract(true, std * generator.standard_normal(layout.error_dim))
    prior = FirstStatePrior(mean, std)
    factor = prior.factor[np.newaxis]
    return InitialEstimate(layout, prior, mean[np.newaxis], factor, 0.0, 0, 0, 0, 0, converged=True)
