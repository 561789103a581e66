"""Interface of a sensor: format, measurement model, what it measures of the initial motion, simulator and faults."""

from abc import ABC, abstractmethod
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Protocol

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.camera_trajectory import CameraTrajectory
from spinfilters.core.errors import InputError
from spinfilters.io.camera import Rig
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.sensor_format import SensorNoise, StoredSensor
from spinfilters.io.sensor_tables import KnownMap
from spinfilters.models.feature_tracks import FrontEnd, Surface, TrueMotion
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.sensor_noise import NoiseLevel
from spinfilters.models.state_blocks import StateBlock
from spinfilters.models.state_layout import FULL_BLOCKS, ROTATION_BLOCKS, StateLayout


class SceneNoise(Protocol):
    """True errors of a scene's sensors (`spinfilters.simulation.scenario.Scenario`)."""

    def level(self, option: str) -> float:
        """True value of a noise option (`spinfilters.io.sensor_format.NoiseOption`), in its unit."""
        ...

    @property
    def gyro_bias(self) -> tuple[float, float, float]:
        """Constant error of a body rate, rad/s, axes g."""
        ...


@dataclass(frozen=True, eq=False)
class Scene:
    """A true motion before a sensor.

    Attributes
    ----------
    motion : TrueMotion
        Of the body in i.
    seen : TrueMotion
        The same in the frame of the camera, of which the blocks t and a count.
    surface : Surface
        Its landmarks.
    front_end : FrontEnd
        How a camera finds them.
    noise : SceneNoise
        True noise of the sensors, by option: ``noise.level("gyro_noise_std")``.
    generator : np.random.Generator
        Of everything random.
    """

    motion: TrueMotion
    seen: TrueMotion
    surface: Surface
    front_end: FrontEnd
    noise: SceneNoise
    generator: np.random.Generator


@dataclass(frozen=True, eq=False)
class SimulatedStream:
    """Measurements of a scene.

    Attributes
    ----------
    noise : Mapping[str, float]
        Standard deviations that the data set states, by noise option.
    landmarks : Int[np.ndarray, ' m'] | None
        Rows of the surface that landmarks 0, 1, 2 ... are, and rig: of the camera; None for sensors without
        landmarks.
    """

    stream: MeasurementStream
    noise: Mapping[str, float]
    landmarks: Int[np.ndarray, " m"] | None = None
    rig: Rig | None = None


def with_noise(
    exact: Float[np.ndarray, "n m"], std: float, generator: np.random.Generator
) -> Float[np.ndarray, "n m"]:
    """Values with white noise of one standard deviation."""
    return exact + std * generator.standard_normal(exact.shape)


@dataclass(frozen=True)
class CameraView:
    """What a camera's observations are compared with: landmarks in frame g, calibration and camera poses.

    Without a known map the estimators hold the landmarks, and measurements carry their ids. Only a data set with a camera's
    calibration has a view; its other sensors get the same one.

    Attributes
    ----------
    inspector : CameraTrajectory | None
        Known trajectory of the camera in i; None where frame i is the camera's.
    """

    known_map: KnownMap | None
    calibration: Float[np.ndarray, " c"]
    inspector: CameraTrajectory | None = None

    def camera_poses(self, time: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 7"] | None:
        """(t_ic m, q_ic) at these times (s); None where frame i is the camera's.

        Raises
        ------
        InputError
            Times that the trajectory does not cover.
        """
        return None if self.inspector is None else self.inspector.at(time)


def required_view(sensor: str, view: CameraView | None) -> CameraView:
    """The camera view. InputError: None given."""
    if view is None:
        raise InputError(f"{sensor} tracks need a calibration here; give the view they were taken with")
    return view


@dataclass(frozen=True, eq=False)
class BoundStream:
    """Rows of a stream with the model that predicts them over a state layout.

    Attributes
    ----------
    time : Float[np.ndarray, ' n']
        (n,) s.
    values : Float[np.ndarray, 'n v']
        (n, value_dim).
    parameters : Float[np.ndarray, 'n p']
        (n, parameter_dim).
    ids : Int[np.ndarray, ' n'] | None
        (n,) landmarks that an estimator holds in its state; None for a known map and sensors without landmarks.
    """

    model: MeasurementModel
    time: Float[np.ndarray, " n"]
    values: Float[np.ndarray, "n v"]
    parameters: Float[np.ndarray, "n p"]
    ids: Int[np.ndarray, " n"] | None = None


@dataclass(frozen=True, eq=False)
class MotionSamples:
    """Initial motion samples: what a stream says directly of the motion at k times.

    Attributes
    ----------
    time : Float[np.ndarray, ' k']
        (k,) s.
    attitude : Float[np.ndarray, 'k 4'] | None
        (k, 4) q_ig; None where the first sample defines frame i and rates are integrated from it.
    rates : Float[np.ndarray, 'k 3'] | None
        (k, 3) body rates, rad/s, axes g; None where attitudes are differenced.
    positions : Float[np.ndarray, 'k 3'] | None
        (k, 3) origins of g in i, m, or None.
    landmarks : KnownMap | None
        a map that was found with the poses, None where it was known or there is none.
    noise_ratio : float | None
        Standard deviation of the rows over the stated, None where the samples do not determine it.
    shared : Int[np.ndarray, ' k'] | None
        (k,) landmarks that an epoch has in common with the one before, of poses from tracks; else None.
    """

    time: Float[np.ndarray, " k"]
    attitude: Float[np.ndarray, "k 4"] | None = None
    rates: Float[np.ndarray, "k 3"] | None = None
    positions: Float[np.ndarray, "k 3"] | None = None
    landmarks: KnownMap | None = None
    noise_ratio: float | None = None
    shared: Int[np.ndarray, " k"] | None = None

    def joined(self, later: "MotionSamples") -> "MotionSamples":
        """With later samples of the same kind, both of a known map."""
        return MotionSamples(
            np.concatenate([self.time, later.time]),
            _joined(self.attitude, later.attitude),
            _joined(self.rates, later.rates),
            _joined(self.positions, later.positions),
        )


def _joined(
    one: Float[np.ndarray, "k c"] | None, later: Float[np.ndarray, "k2 c"] | None
) -> Float[np.ndarray, "k3 c"] | None:
    return None if one is None or later is None else np.concatenate([one, later])


@dataclass(frozen=True)
class AnalysedSensor:
    """Properties of a sensor for the observability analyser.

    Attributes
    ----------
    model : type[MeasurementModel]
        Over any layout: only its expressions are used.
    parameters : tuple[float, ...]
        Of a measurement, after the landmark's point where it sees points.
    noise : Mapping[str, tuple[int, ...]]
        Where each noise option stands among them; its value there is the analyser's default.
    sees_points : bool
        Whether it sees landmarks.
    has_image : bool
        Whether these must lie in front of it.
    words : str
        What it is called.
    tells : tuple[str, ...]
        State blocks that it measures in axes that are known: a pose ("t", "a"), a rate ("w",).
    is_linear : bool
        Whether its output is linear in axes that turn with the body, as a point, a pose or a rate is and a
        bearing is not.
    assumption : str
        What is taken as known, in words.
    bias : StateBlock or None
        Constant error that may be one more unknown, and then is no longer taken as known.
    """

    model: type[MeasurementModel]
    parameters: tuple[float, ...]
    noise: Mapping[str, tuple[int, ...]]
    sees_points: bool = False
    has_image: bool = False
    words: str = ""
    tells: tuple[str, ...] = ()
    is_linear: bool = True
    assumption: str = ""
    bias: StateBlock | None = None


class Sensor(StoredSensor, ABC):
    """A sensor of the registry.

    A subclass defines the attributes and `bind`; it overrides the other methods as far as it supports them.

    Attributes
    ----------
    name : str
        As in a `MeasurementStream`.
    sees_place : bool
        Whether it measures where g is; a log without such a sensor leaves out place, velocity and centre of mass.
    tells_frames : bool | None
        Whether it measures in frames i and g that are given, rather than defined by an estimator; None where its model shows it
        (`knows_frames`).
    identified_option : str | None
        Of its noise, what a recording identifies where the sensor's noise is not stated.
    error_blocks : tuple[StateBlock, ...]
        Its constant errors that a state can hold; it does where the settings give their prior.
    analysis : AnalysedSensor | None
        For the observability analyser, None where it cannot look at this sensor.
    """

    name: str
    sees_place: bool = False
    tells_frames: bool | None = None
    identified_option: str | None = None
    error_blocks: tuple[StateBlock, ...] = ()
    analysis: AnalysedSensor | None = None

    @abstractmethod
    def bind(
        self, stream: MeasurementStream, layout: StateLayout, noise: SensorNoise, view: CameraView | None
    ) -> BoundStream:
        """All rows with the model over a layout. InputError: rows of a camera without a view."""

    def knows_frames(self, stream: MeasurementStream) -> bool:
        """Whether rows are measured in frames i and g that are given.

        They are as `tells_frames` states. Where it is None, those of a model that reads the attitude are, except landmarks.
        """
        if self.tells_frames is not None:
            return self.tells_frames
        if stream.ids is not None:
            return False
        covariance = None if stream.covariance is None else stream.covariance[:1]
        row = MeasurementStream(stream.sensor, stream.time[:1], stream.values[:1], covariance=covariance)
        layout = StateLayout(FULL_BLOCKS if self.sees_place else ROTATION_BLOCKS)
        return self.bind(row, layout, SensorNoise(), None).model.reads_attitude

    def initial_motion(
        self, stream: MeasurementStream, noise: SensorNoise, view: CameraView | None
    ) -> MotionSamples | None:
        """Initial motion that the rows measure directly; None if they determine neither attitudes nor rates.

        Raises
        ------
        InputError
            Rows that no motion can be found from.
        """
        return None

    def samples_each_epoch(self, view: CameraView | None) -> bool:
        """Whether `initial_motion` at a time depends on the rows of that time alone."""
        return False

    def measured_rates(self, stream: MeasurementStream) -> Float[np.ndarray, "n 3"] | None:
        """Body rates of the rows, rad/s, axes g; None for a sensor that measures something else."""
        return None

    def diagnostics(self, stream: MeasurementStream) -> Sequence[str]:
        """Reasons to doubt what a stream leads to."""
        return ()

    def simulate(self, scene: Scene) -> SimulatedStream:
        """Measurements of a simulated motion. InputError: a sensor without a simulator."""
        raise InputError(f"the sensor {self.name} has no simulator; choose another kind")

    def outliers(
        self, count: int, rig: Rig | None, generator: np.random.Generator
    ) -> Float[np.ndarray, "count v"]:
        """Values that have nothing to do with the body. InputError: a sensor without such a fault."""
        raise InputError(f"the sensor {self.name} has no outliers; choose another fault")

    def flipped(self, values: Float[np.ndarray, " v"]) -> Float[np.ndarray, " v"]:
        """A row with a sign wrong. InputError: a sensor without such a fault."""
        raise InputError(f"no measurement of {self.name} is flipped; choose another gross error")

    def turned(
        self, values: Float[np.ndarray, " v"], rotation_vector: Float[np.ndarray, "3"]
    ) -> Float[np.ndarray, " v"]:
        """A row turned by a rotation vector (rad) on the body side. InputError: a sensor without such a fault."""
        raise InputError(f"no measurement of {self.name} is turned; choose another gross error")

    def points_at_infinity(
        self, count: int, rig: Rig | None, generator: np.random.Generator
    ) -> Float[np.ndarray, "count v"]:
        """Values of distant points that are not part of the body.

        Raises
        ------
        InputError
            A sensor without landmarks.
        """
        raise InputError(f"the sensor {self.name} sees no landmarks; choose another fault")

    def storable(self, values: Float[np.ndarray, "n v"]) -> Float[np.ndarray, "n v"]:
        """Values as its files may hold them."""
        return values


def pose_samples(poses: MeasurementStream) -> MotionSamples:
    """Initial motion samples of poses (t, q_ig)."""
    return MotionSamples(poses.time, poses.values[:, 3:], positions=poses.values[:, :3])


def noise_level(stream: MeasurementStream, std: float) -> NoiseLevel:
    """The rows' own covariances, or without any this standard deviation."""
    return std if stream.covariance is None else stream.covariance


def row_covariance(stream: MeasurementStream, std: Float[np.ndarray, " d"]) -> Float[np.ndarray, "n d d"]:
    """The rows' own covariances, or without any those of these standard deviations."""
    if stream.covariance is not None:
        return stream.covariance
    return np.tile(np.diag(np.square(std)), (len(stream), 1, 1))


def diagonal_factor(*std: float) -> tuple[float, ...]:
    """Entries, row by row, of the lower Cholesky factor of a covariance with these standard deviations."""
    return tuple(value if row == col else 0.0 for row, value in enumerate(std) for col in range(row + 1))


def diagonal_places(count: int) -> tuple[int, ...]:
    """Places of the diagonal among the entries of `diagonal_factor`."""
    return tuple(row * (row + 3) // 2 for row in range(count))


@cache
def model_over(
    kind: type[MeasurementModel],
    layout: StateLayout,
    *options: Hashable,
) -> MeasurementModel:
    """A sensor's model over a layout, cached.

    Parameters
    ----------
    options : Hashable
        Of its model, in order: noise; of a camera how it projects and whether it moves.
    """
    return kind(layout, *options)
