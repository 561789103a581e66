"""The scenario: a simulated recording with its motion, inspector, sensors and truth."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import matrix_from_quaternion, quaternion_from_euler321
from spinfilters.core.camera_trajectory import CameraTrajectory, in_camera
from spinfilters.core.conventions import RPM
from spinfilters.core.errors import InputError
from spinfilters.core.mass_distribution import from_inertia
from spinfilters.io.consider_parameter import exact_calibration
from spinfilters.io.dataset import Dataset, DatasetOptions
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.io.sensor_format import SensorNoise, dataset_kinds, noise_options
from spinfilters.io.sensor_tables import KnownMap
from spinfilters.io.truth import Truth
from spinfilters.models.feature_tracks import (
    EveryAppearance,
    FrontEnd,
    Recognition,
    SomeAppearances,
    Surface,
    ball,
    could_stay_in_view,
    stays_in_view,
)
from spinfilters.models.process import THESIS_NOISE, ProcessNoise, TorqueFreeProcess
from spinfilters.models.sensor import Scene, SimulatedStream
from spinfilters.models.sensor_registry import has_error, sensor_of
from spinfilters.models.state_blocks import GYRO_BIAS
from spinfilters.models.state_layout import FULL_BLOCKS, POSE_BLOCKS, StateLayout
from spinfilters.simulation import bundled_example
from spinfilters.simulation.inspector import (
    INSPECTORS,
    STATIC,
    InspectorPath,
    require_inspector_errors,
    told_trajectory,
)

SUBSTEPS = 40
"""Noise kicks per epoch interval: the splitting error falls with its square."""
Progress = Callable[[int, int], None]
"""Called with how many epochs are done, and of how many."""


def silent(done: int, total: int) -> None:
    """Progress callback that does nothing."""


@dataclass(frozen=True)
class Motion:
    """States (n, mean_dim) of one layout at ``time`` (n,) s."""

    layout: StateLayout
    time: Float[np.ndarray, " n"]
    states: Float[np.ndarray, "n m"]

    def block(self, name: str) -> Float[np.ndarray, "n b"]:
        """One block at every time; the attitude as quaternions q_ig."""
        return self.states[:, self.layout.mean_slice(name)]

    @property
    def rotations(self) -> Float[np.ndarray, "n 3 3"]:
        """R_ig at every time."""
        return matrix_from_quaternion(self.block("a"))

    def at(self, time: Float[np.ndarray, " k"]) -> "Motion":
        """The motion at some of its own times, s."""
        return Motion(self.layout, time, self.states[np.searchsorted(self.time, time)])

    def seen_from(self, inspector: CameraTrajectory | None) -> "Motion":
        """Poses of g in the epoch of a moving camera; of none the motion itself."""
        if inspector is None:
            return self
        poses = np.concatenate([self.block("t"), self.block("a")], axis=1)
        return Motion(StateLayout(POSE_BLOCKS), self.time, in_camera(poses, inspector.at(self.time)))


def simulate_motion(
    process: TorqueFreeProcess,
    start: Float[np.ndarray, "*batch m"],
    time: Float[np.ndarray, " n"],
    generator: np.random.Generator,
    progress: Progress = silent,
    substeps: int = SUBSTEPS,
) -> Float[np.ndarray, "n *batch m"]:
    """States at every time of one or many motions that begin at ``start`` (time[0]).

    Between epochs the noise-free step and white kicks of rate and velocity alternate (Strang splitting: half a kick, a step, half a
    kick), so it does not rest on the process model's own noise covariance.

    Parameters
    ----------
    progress: called after every epoch with how many are done, and of how many.   substeps: noise kicks per interval.
    """
    q, blocks = process.layout.mean_slice("a"), process.disturbed_dim // 3
    states, x = [start], start
    for interval in np.diff(time):
        drawn = generator.standard_normal((substeps, 2, blocks, *x.shape[:-1], 3))
        normal = np.moveaxis(drawn, (1, 2), (-3, -2)).reshape(substeps, *x.shape[:-1], 2, 3 * blocks)
        x = process.disturbed_steps(x, float(interval) / substeps, normal)
        x[..., q] /= np.linalg.norm(x[..., q], axis=-1, keepdims=True)
        states.append(x)
        progress(len(states), len(time))
    return np.stack(states)


THESIS_RPM: Final = bundled_example.RATE_RPM
"""Initial rate about the principal axes of the thesis' experiment."""
RICH_RPM: Final = (4.0, 9.0, 3.0)
"""Initial rate about the principal axes of a motion in which everything is well observable."""
SHORTEST_INTERVAL: Final = 1e-6
"""Of a sensor beside another, s."""
_DECIMALS, _ROUNDING = 9, 1e-9  # of the epochs of several sensors, s


@dataclass(frozen=True)
class Scenario:
    """Scenario of a simulation, by default the bundled example: the thesis' own problem (Tweddle 2013, chapter 6).

    A SPHERES-like body at 10 rpm about its intermediate axis: about 2447 landmarks with 24,723 observations in 115 epochs, 215 in
    each, at least two of each landmark; percentiles 10, 50, 90 and 99 of the observations of a landmark: 2, 8, 22 and 36. A
    landmark stays for one to five epochs of a revolution and comes back after seven to ten. Of 48 motions the first is taken that
    the disturbing force does not carry out of view. `simplified` is easier: all landmarks are recognised, less force.

    Attributes
    ----------
    kind: of data set, such as "stereo-tracks" or "gyro" (`spinfilters.io.sensor_format.dataset_kinds`).
    principal_moments: along the principal axes x, y, z, any scale (Tweddle 2013, section 6.5.2).
    rate_rpm: initial rate about the principal axes, such as `THESIS_RPM` or `RICH_RPM`.
    epochs, interval: number of epochs and seconds between them.
    range_m: distance of the centre of mass along the camera's axis.   velocity: of the centre of mass, m/s, frame i.
    center_of_mass_g: m.   axes_euler_g: yaw, pitch, roll of the principal axes in g, rad.
    landmarks: on the surface of a ball of ``radius_m``, seen when they face the camera.
    detection, facing_cosine, recognition, fewest_observations: see `FrontEnd`.
    pixel_std px, position_std m, rotation_std rad, gyro_std rad/s: white noise of the sensors.
    sensor_noise: (option, true value) of noise options (`spinfilters.io.sensor_format.noise_options`) that differ from these.
    gyro_bias: constant error of the gyro's rates, g axes, rad/s.
    noise: disturbances of the motion; the thesis' are `spinfilters.models.process.THESIS_NOISE`.
    candidates: motions that are drawn where a sensor sees landmarks; the first that keeps the whole body in view is taken, or the
        first of all if none does.
    inspector: how the camera moves (`spinfilters.simulation.inspector.INSPECTORS`).
    inspector_errors: (name, size) of what is wrong with the poses that are told of it
        (`spinfilters.simulation.inspector.INSPECTOR_ERRORS`).
    beside: (kind, interval s) of other sensors on the same motion; at most one sensor sees landmarks.
    seed: of everything random.
    """

    kind: str = "stereo-tracks"
    principal_moments: tuple[float, float, float] = bundled_example.PRINCIPAL_MOMENTS
    rate_rpm: tuple[float, float, float] = THESIS_RPM
    epochs: int = bundled_example.EPOCHS
    interval: float = bundled_example.INTERVAL
    range_m: float = 0.6
    velocity: tuple[float, float, float] = (0.002, 0.001, -0.001)
    center_of_mass_g: tuple[float, float, float] = (0.02, -0.015, 0.01)
    axes_euler_g: tuple[float, float, float] = (0.5, -0.3, 0.2)
    landmarks: int = bundled_example.LANDMARKS
    radius_m: float = bundled_example.RADIUS_M
    detection: float = bundled_example.DETECTION
    facing_cosine: float = bundled_example.FACING_COSINE
    recognition: Recognition = field(default_factory=lambda: SomeAppearances(*bundled_example.RECOGNITION))
    fewest_observations: int = bundled_example.FEWEST_OBSERVATIONS
    pixel_std: float = 1.0
    position_std: float = 0.005
    rotation_std: float = 0.01
    gyro_std: float = 0.002
    sensor_noise: tuple[tuple[str, float], ...] = ()
    gyro_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    noise: ProcessNoise = THESIS_NOISE
    candidates: int = bundled_example.CANDIDATES
    inspector: str = STATIC
    inspector_errors: tuple[tuple[str, float], ...] = ()
    beside: tuple[tuple[str, float], ...] = ()
    seed: int = 0

    def __post_init__(self) -> None:
        kinds = dataset_kinds()
        for kind in self.kinds:
            if kind not in kinds:
                raise InputError(f"scenario kind {kind!r} is unknown; use one of {', '.join(kinds)}")
        _check_beside(self)
        if self.epochs < 2 or not self.interval > 0:
            raise InputError(
                f"a scenario of {self.epochs} epochs at {self.interval} s; give at least 2 epochs and a positive interval"
            )
        if self.landmarks < 4 or self.candidates < 1:
            raise InputError(
                f"landmarks {self.landmarks} must be at least 4 and candidates {self.candidates} at least 1"
            )
        _ = self.front_end, SensorNoise(dict(self.sensor_noise))  # refuses what no sensor has
        if self.inspector not in INSPECTORS:
            raise InputError(f"inspector {self.inspector!r} is unknown; use one of {', '.join(INSPECTORS)}")
        if self.inspector != STATIC and not any(kinds[kind].has_landmarks for kind in self.kinds):
            raise InputError(f"an inspector carries a camera, and a {self.kind} has none; leave it {STATIC}")
        require_inspector_errors(dict(self.inspector_errors))
        if self.inspector_errors and self.inspector == STATIC:
            others = ", ".join(name for name in INSPECTORS if name != STATIC)
            raise InputError(f"errors are of the poses of an inspector that moves; choose one: {others}")
        if not self.range_m > self.radius_m > 0:
            raise InputError(
                f"the body of radius {self.radius_m} m must lie in front of the camera, range_m is {self.range_m} m"
            )

    @classmethod
    def simplified(cls, **changes: Any) -> "Scenario":
        """The example with all landmarks recognised and little force, or with some of the fields changed besides.

        Its 925 landmarks show about 215 an epoch, as the example's; its disturbing force is a twenty-fifth in density.
        """
        easy = cls(
            landmarks=925,
            radius_m=0.11,
            detection=0.9,
            facing_cosine=0.35,
            recognition=EveryAppearance(),
            fewest_observations=0,
            noise=ProcessNoise(),
            candidates=1,
        )
        return replace(easy, **changes)

    @classmethod
    def rich(cls, seed: int = 0) -> "Scenario":
        """The simplified body and camera in a motion that makes everything observable."""
        return cls.simplified(rate_rpm=RICH_RPM, seed=seed)

    @classmethod
    def common_workload(cls, rate_rpm: tuple[float, float, float] = THESIS_RPM, seed: int = 0) -> "Scenario":
        """The bundled example at another rate: what a scenario is by default."""
        return cls(rate_rpm=rate_rpm, seed=seed)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of all sensors."""
        return self.kind, *(kind for kind, _ in self.beside)

    @property
    def times(self) -> Mapping[str, Float[np.ndarray, " n"]]:
        """Epochs of every kind, s; those of several fall together to the bit."""
        own = self.interval * np.arange(self.epochs)
        if not self.beside:
            return {self.kind: own}
        counts = {kind: int(own[-1] / step + _ROUNDING) + 1 for kind, step in self.beside}
        more = {kind: step * np.arange(counts[kind]) for kind, step in self.beside}
        return {kind: np.round(time, _DECIMALS) for kind, time in {self.kind: own, **more}.items()}

    def level(self, option: str) -> float:
        """True value of a noise option: its own, that of the level it shares with others, or its default.

        Raises
        ------
        InputError
            An option that no sensor has.
        """
        own = dict(self.sensor_noise)
        if option in own:
            return own[option]
        known = noise_options()
        if option not in known:
            raise InputError(f"sensor noise {option} is unknown; use {', '.join(known)}")
        chosen = known[option]
        if chosen.scene_level:
            return float(getattr(self, chosen.scene_level))
        return chosen.default if chosen.simulated is None else chosen.simulated

    @property
    def front_end(self) -> FrontEnd:
        """The simulated front end."""
        return FrontEnd(
            self.level("pixel_std"),
            self.detection,
            self.facing_cosine,
            self.recognition,
            self.fewest_observations,
        )


def simulate(scenario: Scenario, progress: Progress = silent) -> Dataset:
    """A data set with truth, from a seed; tracks come with the map of their landmarks.

    Parameters
    ----------
    progress: called after every epoch of the motion with how many are done, and of how many.
    """
    generator = np.random.default_rng(scenario.seed)
    layout = StateLayout(FULL_BLOCKS)
    process = TorqueFreeProcess(layout, scenario.noise)
    time = np.unique(np.concatenate(list(scenario.times.values())))
    sees = any(dataset_kinds()[kind].has_landmarks for kind in scenario.kinds)
    candidates = scenario.candidates if sees else 1
    starts = np.tile(first_state(scenario, layout), (candidates, 1))
    kicks = max(1, round(SUBSTEPS * scenario.epochs / len(time)))
    states = simulate_motion(process, starts, time, generator, progress, kicks)
    motions = [Motion(layout, time, states[:, k]) for k in range(candidates)]
    inspector = inspector_of(scenario, time)
    motion = next(
        (m for m in motions if stays_in_view(m.seen_from(inspector), scenario.radius_m)), motions[0]
    )
    return measured(scenario, motion, generator)


def measured(scenario: Scenario, motion: Motion, generator: np.random.Generator) -> Dataset:
    """A data set of a given true motion; surface and measurements are drawn."""
    told = _told_inspector(scenario, motion.time)
    surface = ball(scenario.landmarks, scenario.radius_m, generator)
    simulated = [
        _simulated(scenario, kind, motion if not scenario.beside else motion.at(time), surface, generator)
        for kind, time in scenario.times.items()
    ]
    rows = next((each.landmarks for each in simulated if each.landmarks is not None), None)
    known_map = None if rows is None else KnownMap(np.arange(len(rows)), surface.points[rows])
    others = "".join(f", {kind} at {step} s" for kind, step in scenario.beside)
    return Dataset(
        kind=scenario.kind,
        log=MeasurementLog(tuple(each.stream for each in simulated)),
        description=f"simulated {scenario.kind}, {scenario.epochs} epochs at {scenario.interval} s{others}, seed {scenario.seed}"
        + _inspector_words(scenario),
        truth=_truth(scenario, motion),
        rig=next((each.rig for each in simulated if each.rig is not None), None),
        known_map=known_map,
        inspector=None if told is None else MeasurementStream("pose", told.time, told.poses),
        options=_options(scenario, {name: std for each in simulated for name, std in each.noise.items()}),
    )


def _simulated(
    scenario: Scenario, kind: str, motion: Motion, surface: Surface, generator: np.random.Generator
) -> SimulatedStream:
    """Simulated measurements of one sensor at its own epochs."""
    inspector = inspector_of(scenario, motion.time)
    scene = Scene(motion, motion.seen_from(inspector), surface, scenario.front_end, scenario, generator)
    return sensor_of(dataset_kinds()[kind].name).simulate(scene)


def _check_beside(scenario: Scenario) -> None:
    """InputError: a kind twice, an interval that is not positive, two sensors of landmarks."""
    kinds, forms = scenario.kinds, dataset_kinds()
    if len(set(kinds)) < len(kinds):
        raise InputError(f"a scenario of {', '.join(kinds)} holds a kind twice; name each once")
    for kind, step in scenario.beside:
        if not (np.isfinite(step) and step >= SHORTEST_INTERVAL):
            raise InputError(
                f"{kind} beside it every {step} s; give an interval of {SHORTEST_INTERVAL:g} s or more"
            )
    seeing = [kind for kind in kinds if forms[kind].has_landmarks]
    if len(seeing) > 1:
        raise InputError(f"{' and '.join(seeing)} both need a camera of their own; simulate one of them")


def inspector_of(scenario: Scenario, time: Float[np.ndarray, " n"]) -> CameraTrajectory | None:
    """Inspector's true trajectory about the body's first place; None of a resting one."""
    path = _path_of(scenario)
    return None if path is None else CameraTrajectory(time, path(time - time[0]))


def _told_inspector(scenario: Scenario, time: Float[np.ndarray, " n"]) -> CameraTrajectory | None:
    """Trajectory that the data set tells of the inspector."""
    path = _path_of(scenario)
    return None if path is None else told_trajectory(path, time, dict(scenario.inspector_errors))


def _path_of(scenario: Scenario) -> InspectorPath | None:
    make = INSPECTORS[scenario.inspector]
    return None if make is None else make(np.array([0.0, 0.0, scenario.range_m]), scenario.seed)


def _inspector_words(scenario: Scenario) -> str:
    if scenario.inspector == STATIC:
        return ""
    errors = "".join(
        f", poses {name}" + (f" {size:g}" if size else "") for name, size in scenario.inspector_errors
    )
    return f", inspector: {scenario.inspector}{errors}"


def without_map(dataset: Dataset) -> Dataset:
    """The same data for estimators that must find the landmarks themselves."""
    return replace(dataset, known_map=None)


def without_noise(dataset: Dataset) -> Dataset:
    """The same data, which say nothing of their noise."""
    streams = tuple(replace(stream, covariance=None) for stream in dataset.log.streams)
    options = replace(dataset.options, force_psd=None, torque_psd=None, sensor_noise={})
    return replace(dataset, log=MeasurementLog(streams), options=options)


def first_state(scenario: Scenario, layout: StateLayout) -> Float[np.ndarray, " m"]:
    """The state at time zero, before any disturbance."""
    x, c, R_gb = layout.origin(), np.array(scenario.center_of_mass_g), _principal_axes(scenario)
    x[layout.mean_slice("t")] = np.array([0.0, 0.0, scenario.range_m]) - c
    x[layout.mean_slice("v")] = scenario.velocity
    x[layout.mean_slice("w")] = R_gb @ np.array(scenario.rate_rpm) * RPM
    x[layout.mean_slice("c")] = c
    x[layout.mean_slice("s")] = from_inertia(R_gb @ np.diag(scenario.principal_moments) @ R_gb.T)
    return x


def _principal_axes(scenario: Scenario) -> Float[np.ndarray, "3 3"]:
    """R_gb: columns are the principal axes in g."""
    return matrix_from_quaternion(quaternion_from_euler321(np.array(scenario.axes_euler_g)))


def _truth(scenario: Scenario, motion: Motion) -> Truth:
    rotations, order = motion.rotations, np.argsort(scenario.principal_moments)
    axes = _principal_axes(scenario).T[order]
    axes[2] *= np.sign(np.linalg.det(axes))
    return Truth(
        time=motion.time,
        center_of_mass=motion.block("t") + rotations @ np.array(scenario.center_of_mass_g),
        q_ig=motion.block("a"),
        velocity=motion.block("v"),
        rate_i=np.einsum("kij,kj->ki", rotations, motion.block("w")),
        principal_moments=np.array(scenario.principal_moments)[order] / max(scenario.principal_moments),
        principal_axes_g=axes,
        center_of_mass_g=np.array(scenario.center_of_mass_g),
        gyro_bias=np.array(scenario.gyro_bias) if has_error(scenario.kinds, GYRO_BIAS) else None,
    )


def _options(scenario: Scenario, sensor_noise: Mapping[str, float]) -> DatasetOptions:
    """Stated noise of sensor and motion (none of zero), an exact calibration."""
    motion = {"force_psd": scenario.noise.force_psd, "torque_psd": scenario.noise.torque_psd}
    stated = {name: value for name, value in {**motion, **sensor_noise}.items() if value > 0}
    told = scenario.inspector != STATIC and not scenario.inspector_errors  # of wrong poses nothing is said
    exact = exact_calibration((dataset_kinds()[kind].name for kind in scenario.kinds), inspector=told)
    return replace(DatasetOptions(notes={"seed": scenario.seed}, calibration=exact), **stated)


KICKS = 10
"""Of white noise per interval: the covariance that a path gathers over an interval is too large by 1 / (2 KICKS^2),
half a percent."""


def motion_in_view(scenario: Scenario, generator: np.random.Generator) -> Motion:
    """First motion in view of at most ``scenario.candidates``, or the last."""
    layout = StateLayout(FULL_BLOCKS)
    process = TorqueFreeProcess(layout, scenario.noise)
    start = first_state(scenario, layout)
    time = scenario.interval * np.arange(scenario.epochs)
    attempts = scenario.candidates if dataset_kinds()[scenario.kind].has_landmarks else 1
    inspector = inspector_of(scenario, time)
    offset = float(np.linalg.norm(scenario.center_of_mass_g))
    depth = float(start[layout.mean_slice("t")][2])
    for attempt in range(attempts):
        shape = (len(time) - 1, KICKS, 2, 3)
        pushes = generator.standard_normal(shape)
        last = attempt == attempts - 1
        path = _path(scenario, pushes)
        near = inspector is not None or could_stay_in_view(path, depth, scenario.radius_m, offset)
        if not last and not near:
            continue
        normal = np.concatenate([generator.standard_normal(shape), pushes], axis=-1)
        states = process.disturbed_path(start, scenario.interval, normal)
        motion = Motion(layout, time, states)
        if last or stays_in_view(motion.seen_from(inspector), scenario.radius_m):
            return motion
    raise AssertionError("a scenario has at least one candidate")


def _path(scenario: Scenario, normal: Float[np.ndarray, "n k 2 3"]) -> Float[np.ndarray, "n 3"]:
    """Centre of mass at every epoch but the first, m, frame i.

    Straight between the kicks of its velocity.
    """
    h = scenario.interval / normal.shape[1]
    kicks = np.sqrt(scenario.noise.force_psd * (h / 2)) * normal.reshape(-1, 2, 3)
    after = np.cumsum(kicks.sum(axis=1), axis=0) + np.array(scenario.velocity)
    moved = np.cumsum(after - kicks[:, 1], axis=0) * h
    return np.array([0.0, 0.0, scenario.range_m]) + moved[normal.shape[1] - 1 :: normal.shape[1]]
