"""Simulation of a scenario: its motion, inspector, sensors and truth."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import matrix_from_quaternion, quaternion_from_euler321
from spinfilters.core.camera_trajectory import CameraTrajectory, in_camera
from spinfilters.core.conventions import RPM
from spinfilters.core.errors import InputError
from spinfilters.core.mass_distribution import from_inertia
from spinfilters.io.consider_parameter import exact_calibration
from spinfilters.io.dataset import Dataset, DatasetOptions
from spinfilters.io.disturbances import WHITE_FORCE
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.io.sensor_format import dataset_kinds
from spinfilters.io.sensor_tables import KnownMap
from spinfilters.io.truth import Truth
from spinfilters.models.feature_tracks import (
    Surface,
    ball,
    could_stay_in_view,
    stays_in_view,
)
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.models.sensor import Scene, SimulatedStream
from spinfilters.models.sensor_registry import has_error, sensor_of
from spinfilters.models.state_blocks import GYRO_BIAS
from spinfilters.models.state_layout import FULL_BLOCKS, POSE_BLOCKS, StateLayout
from spinfilters.simulation.inspector import INSPECTORS, STATIC, InspectorPath, told_trajectory
from spinfilters.simulation.scenario_record import IMAGE_KIND, RICH_RPM, THESIS_RPM, Scenario

__all__ = ["RICH_RPM", "THESIS_RPM", "Motion", "Progress", "Scenario", "measured", "simulate", "without_map"]

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
    process : TorqueFreeProcess
        With the densities of the disturbances.
    start : ndarray of shape (..., m)
        State or states at ``time[0]``.
    time : ndarray of shape (n,)
        Epochs, s.
    generator : np.random.Generator
        Of the disturbances.
    progress : Callable[[int, int], None]
        Called after every epoch with how many are done, and of how many.
    substeps : int
        Noise kicks per interval.
    """
    q, blocks = process.layout.mean_slice("a"), -(-process.disturbed_dim // 3)
    states, x = [start], start
    for interval in np.diff(time):
        drawn = generator.standard_normal((substeps, 2, blocks, *x.shape[:-1], 3))
        normal = np.moveaxis(drawn, (1, 2), (-3, -2)).reshape(substeps, *x.shape[:-1], 2, 3 * blocks)
        x = process.disturbed_steps(x, float(interval) / substeps, normal[..., : process.disturbed_dim])
        x[..., q] /= np.linalg.norm(x[..., q], axis=-1, keepdims=True)
        states.append(x)
        progress(len(states), len(time))
    return np.stack(states)


def simulate(scenario: Scenario, progress: Progress = silent) -> Dataset:
    """A data set with truth, from a seed; tracks come with the map of their landmarks.

    Parameters
    ----------
    scenario : Scenario
        Of a kind that is not rendered.
    progress : Callable[[int, int], None]
        Called after every epoch of the motion with how many are done, and of how many.
    """
    if scenario.kind == IMAGE_KIND:
        raise InputError(
            f"{IMAGE_KIND} are rendered, not simulated; use 'spinfilters simulate --kind {IMAGE_KIND}'"
        )
    generator = np.random.default_rng(scenario.seed)
    layout = StateLayout(FULL_BLOCKS)
    process = TorqueFreeProcess(layout, scenario.noise)
    time = np.unique(np.concatenate(list(scenario.times.values())))
    candidates = scenario.candidates if scenario.sees_landmarks else 1
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
    path = _path_of(scenario)
    told = None if path is None else told_trajectory(path, motion.time, dict(scenario.inspector_errors))
    surface = ball(scenario.landmarks, scenario.radius_m, generator)
    simulated = [
        simulated_stream(
            scenario, kind, motion if not scenario.beside else motion.at(time), surface, generator
        )
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
        truth=truth_of(scenario, motion),
        rig=next((each.rig for each in simulated if each.rig is not None), None),
        known_map=known_map,
        inspector=None if told is None else MeasurementStream("pose", told.time, told.poses),
        options=_options(scenario, {name: std for each in simulated for name, std in each.noise.items()}),
    )


def simulated_stream(
    scenario: Scenario, kind: str, motion: Motion, surface: Surface, generator: np.random.Generator
) -> SimulatedStream:
    """Simulated measurements of one sensor at its own epochs."""
    inspector = inspector_of(scenario, motion.time)
    scene = Scene(motion, motion.seen_from(inspector), surface, scenario.front_end, scenario, generator)
    return sensor_of(dataset_kinds()[kind].name).simulate(scene)


def inspector_of(scenario: Scenario, time: Float[np.ndarray, " n"]) -> CameraTrajectory | None:
    """Inspector's true trajectory about the body's first place; None of a resting one."""
    path = _path_of(scenario)
    return None if path is None else CameraTrajectory(time, path(time - time[0]))


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
    options = replace(dataset.options, densities={}, sensor_noise={})
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


def truth_of(scenario: Scenario, motion: Motion) -> Truth:
    """Truth of a motion and of the scenario's body."""
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
    noise = {**scenario.noise.densities, **sensor_noise}
    stated = {name: value for name, value in noise.items() if value > 0}
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
        # the pushes were drawn before all others, to see whether the body stays in view
        at = process.impulse_columns[WHITE_FORCE.name]
        others = generator.standard_normal((*shape[:-1], process.disturbed_dim - shape[-1]))
        normal = np.concatenate([others[..., : at.start], pushes, others[..., at.start :]], axis=-1)
        states = process.disturbed_path(start, scenario.interval, normal)
        motion = Motion(layout, time, states)
        if last or stays_in_view(motion.seen_from(inspector), scenario.radius_m):
            return motion
    raise AssertionError("a scenario has at least one candidate")


def _path(scenario: Scenario, normal: Float[np.ndarray, "n k 2 3"]) -> Float[np.ndarray, "n 3"]:
    """Centre of mass at every epoch but the first, m, frame i: straight lines between the kicks of its velocity."""
    intervals, steps = normal.shape[:2]
    h = scenario.interval / steps
    # of the kicks at begin and end of every step: what they add up to over an interval, and over how many of its steps each acts
    acting = np.arange(steps, 0, -1)[:, np.newaxis] - [0, 1]
    weights = np.stack([np.ones(2 * steps), acting.ravel()])
    sums = np.sqrt(scenario.noise.force_psd * (h / 2)) * (weights @ normal.reshape(intervals, 2 * steps, 3))
    velocity = np.cumsum(sums[:, 0], axis=0) - sums[:, 0] + np.array(scenario.velocity)
    return np.array([0.0, 0.0, scenario.range_m]) + np.cumsum(steps * velocity + sums[:, 1], axis=0) * h
