"""Simulated data sets: a tumbling body before a stereo camera, or with a gyro, or with a pose sensor on it."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.attitude.conversions import matrix_from_quaternion, quaternion_from_euler321
from spinfilters.conventions import RPM
from spinfilters.dynamics.mass_distribution import from_inertia
from spinfilters.errors import InputError
from spinfilters.logs.camera import StereoRig
from spinfilters.logs.dataset import Dataset
from spinfilters.logs.dataset_options import DatasetOptions
from spinfilters.logs.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.logs.track_files import KnownMap
from spinfilters.logs.truth import Truth
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.sensors.stereo_landmark import StereoLandmark, stereo_parameters
from spinfilters.simulation.motion import simulate_motion
from spinfilters.state.layout import FULL_BLOCKS, StateLayout

KINDS = ("stereo-tracks", "pose", "gyro")


@dataclass(frozen=True)
class Scenario:
    """What to simulate. The defaults are the thesis' own experiment: a SPHERES-like body at 10 rpm about its intermediate axis.

    Attributes
    ----------
    kind: "stereo-tracks", "pose" or "gyro".
    principal_moments: along the principal axes x, y, z, any scale (Tweddle 2013, section 6.5.2).
    rate_rpm: initial rate about the principal axes.
    frames, interval: number of frames and seconds between them.
    range_m: distance of the centre of mass along the camera's axis.   velocity: of the centre of mass, m/s, frame i.
    center_of_mass_g: m.   axes_euler_g: yaw, pitch, roll of the principal axes in g, rad.
    landmarks: on the surface of a ball of ``radius_m``, seen when they face the camera; the default shows about 215 a frame, as
        the thesis' 24,723 observations in 115 frames.
    detection: probability that a visible landmark is found in a frame.
    pixel_std px, position_std m, rotation_std rad, gyro_std rad/s: white noise of the sensors.
    noise: disturbances of the motion (Tweddle 2013, section 6.4).
    seed: of everything random.
    """

    kind: str = "stereo-tracks"
    principal_moments: tuple[float, float, float] = (1.0322, 1.0, 0.8596)
    rate_rpm: tuple[float, float, float] = (0.5, 10.0, 0.5)
    frames: int = 115
    interval: float = 0.5
    range_m: float = 0.6
    velocity: tuple[float, float, float] = (0.002, 0.001, -0.001)
    center_of_mass_g: tuple[float, float, float] = (0.02, -0.015, 0.01)
    axes_euler_g: tuple[float, float, float] = (0.5, -0.3, 0.2)
    landmarks: int = 925
    radius_m: float = 0.11
    detection: float = 0.9
    pixel_std: float = 1.0
    position_std: float = 0.005
    rotation_std: float = 0.01
    gyro_std: float = 0.002
    noise: ProcessNoise = field(default_factory=ProcessNoise)
    seed: int = 0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(f"scenario kind {self.kind!r} is unknown; use one of {', '.join(KINDS)}")
        if self.frames < 2 or not self.interval > 0:
            raise InputError(
                f"a scenario of {self.frames} frames at {self.interval} s; give at least 2 frames and a positive interval"
            )
        if not 0 < self.detection <= 1 or self.landmarks < 4:
            raise InputError(
                f"detection {self.detection} must lie in (0, 1] and landmarks {self.landmarks} be at least 4"
            )
        if not self.range_m > self.radius_m > 0:
            raise InputError(
                f"the body of radius {self.radius_m} m must lie in front of the camera, range_m is {self.range_m} m"
            )


RIG = StereoRig(fx=466.7, fy=466.7, cx=320.0, cy=240.0, width=640, height=480, baseline_m=0.09)
"""The Goggles' cameras (Tweddle 2013, Tables 5.1 and 5.4)."""

FACING_COSINE = 0.35
"""A landmark is seen when its outward normal makes less than about 70 degrees with the line of sight."""


def simulate(scenario: Scenario) -> Dataset:
    """A data set with truth, from a seed."""
    generator = np.random.default_rng(scenario.seed)
    layout = StateLayout(FULL_BLOCKS)
    process = TorqueFreeProcess(layout, scenario.noise)
    time = scenario.interval * np.arange(scenario.frames)
    states = simulate_motion(process, _first_state(scenario, layout), time, generator)
    landmarks, normals = _ball(scenario, generator)
    stream = {"stereo-tracks": _stereo_tracks, "pose": _poses, "gyro": _gyro}[scenario.kind]
    log = MeasurementLog((stream(scenario, layout, time, states, (landmarks, normals), generator),))
    stereo = scenario.kind == "stereo-tracks"
    known_map = KnownMap(np.arange(scenario.landmarks), landmarks) if stereo else None
    return Dataset(
        kind=scenario.kind,
        log=log,
        description=f"simulated {scenario.kind}, {scenario.frames} frames at {scenario.interval} s, seed {scenario.seed}",
        truth=_truth(scenario, layout, time, states),
        rig=RIG if stereo else None,
        known_map=known_map,
        options=_options(scenario),
    )


def _first_state(scenario: Scenario, layout: StateLayout) -> Float[np.ndarray, " m"]:
    R_gb = _principal_axes(scenario)
    x = layout.origin()
    c = np.array(scenario.center_of_mass_g)
    x[layout.mean_slice("t")] = np.array([0.0, 0.0, scenario.range_m]) - c
    x[layout.mean_slice("v")] = scenario.velocity
    x[layout.mean_slice("w")] = R_gb @ np.array(scenario.rate_rpm) * RPM
    x[layout.mean_slice("c")] = c
    x[layout.mean_slice("s")] = from_inertia(R_gb @ np.diag(scenario.principal_moments) @ R_gb.T)
    return x


def _principal_axes(scenario: Scenario) -> Float[np.ndarray, "3 3"]:
    """R_gb: columns are the principal axes in g."""
    return matrix_from_quaternion(quaternion_from_euler321(np.array(scenario.axes_euler_g)))


def _ball(scenario: Scenario, generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Landmarks (m, frame g) on a slightly dented ball about the origin of g, and outward normals."""
    normals = generator.standard_normal((scenario.landmarks, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    depth = scenario.radius_m * generator.uniform(0.8, 1.0, (scenario.landmarks, 1))
    return depth * normals, normals


def _stereo_tracks(
    scenario: Scenario,
    layout: StateLayout,
    time: np.ndarray,
    states: np.ndarray,
    surface: tuple[np.ndarray, np.ndarray],
    generator: np.random.Generator,
) -> MeasurementStream:
    landmarks, normals = surface
    camera = StereoLandmark(layout)
    parameters = stereo_parameters(landmarks, RIG.calibration, scenario.pixel_std)
    times, ids, values = [], [], []
    for t, x in zip(time, states, strict=True):
        pixels = camera.predict(x, parameters)
        seen = _visible(layout, x, landmarks, normals, pixels) & (
            generator.random(len(landmarks)) < scenario.detection
        )
        times.append(np.full(np.count_nonzero(seen), t))
        ids.append(np.flatnonzero(seen))
        values.append(pixels[seen] + scenario.pixel_std * generator.standard_normal((times[-1].size, 3)))
    if not sum(map(len, times)):
        raise InputError(
            "no landmark is ever visible; move the body into the camera's view (range_m, velocity)"
        )
    return MeasurementStream("stereo", np.concatenate(times), np.concatenate(values), np.concatenate(ids))


def _visible(
    layout: StateLayout, x: np.ndarray, landmarks: np.ndarray, normals: np.ndarray, pixels: np.ndarray
) -> Bool[np.ndarray, " k"]:
    R = matrix_from_quaternion(x[layout.mean_slice("a")])
    points, outward = landmarks @ R.T + x[layout.mean_slice("t")], normals @ R.T
    facing = -np.einsum("ij,ij->i", outward, points) > FACING_COSINE * np.linalg.norm(points, axis=1)
    u_left, v_left, u_right = pixels.T
    inside = (u_right >= 0) & (u_left < RIG.width) & (v_left >= 0) & (v_left < RIG.height)
    return facing & inside & (points[:, 2] > 0.05)


def _poses(
    scenario: Scenario,
    layout: StateLayout,
    time: np.ndarray,
    states: np.ndarray,
    _: object,
    generator: np.random.Generator,
) -> MeasurementStream:
    small = StateLayout(("t", "a"))
    exact = np.concatenate([states[:, layout.mean_slice("t")], states[:, layout.mean_slice("a")]], axis=1)
    std = np.repeat([scenario.position_std, scenario.rotation_std], 3)
    noisy = small.retract(exact, std * generator.standard_normal((len(time), 6)))
    return MeasurementStream("pose", time, noisy, None, np.tile(np.diag(std**2), (len(time), 1, 1)))


def _gyro(
    scenario: Scenario,
    layout: StateLayout,
    time: np.ndarray,
    states: np.ndarray,
    _: object,
    generator: np.random.Generator,
) -> MeasurementStream:
    rates = states[:, layout.mean_slice("w")]
    return MeasurementStream("gyro", time, rates + scenario.gyro_std * generator.standard_normal(rates.shape))


def _truth(scenario: Scenario, layout: StateLayout, time: np.ndarray, states: np.ndarray) -> Truth:
    rotations = matrix_from_quaternion(states[:, layout.mean_slice("a")])
    R_gb = _principal_axes(scenario)
    order = np.argsort(scenario.principal_moments)
    axes = R_gb.T[order]
    axes[2] *= np.sign(np.linalg.det(axes))
    return Truth(
        time=time,
        center_of_mass=states[:, layout.mean_slice("t")] + rotations @ np.array(scenario.center_of_mass_g),
        q_ig=states[:, layout.mean_slice("a")],
        velocity=states[:, layout.mean_slice("v")],
        rate_i=np.einsum("kij,kj->ki", rotations, states[:, layout.mean_slice("w")]),
        principal_moments=np.array(scenario.principal_moments)[order] / max(scenario.principal_moments),
        principal_axes_g=axes,
        center_of_mass_g=np.array(scenario.center_of_mass_g),
    )


def _options(scenario: Scenario) -> DatasetOptions:
    notes: dict[str, str | int | float | bool] = {
        "seed": scenario.seed,
        "force_psd": scenario.noise.force_psd,
        "torque_psd": scenario.noise.torque_psd,
    }
    if scenario.kind == "stereo-tracks":
        return DatasetOptions(pixel_std=scenario.pixel_std, notes=notes)
    if scenario.kind == "gyro":
        return DatasetOptions(gyro_noise_std=scenario.gyro_std, notes=notes)
    return DatasetOptions(
        pose_position_std=scenario.position_std, pose_rotation_std=scenario.rotation_std, notes=notes
    )
