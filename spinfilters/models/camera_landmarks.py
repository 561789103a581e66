"""Landmarks in the images of one camera or of a stereo pair: measurement models, and rows of tracks with a known map."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.core.attitude_expressions import Expression, conjugate, rotate
from spinfilters.core.camera_trajectory import in_inertial
from spinfilters.core.cameras import Camera, Monocular, StereoPair
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.sensor_format import NoiseOption
from spinfilters.io.sensor_tables import KnownMap
from spinfilters.io.stated_values import NumberRange
from spinfilters.models.measurement import LandmarkSensor, MeasurementModel
from spinfilters.models.sensor import CameraView, MotionSamples
from spinfilters.models.sensor_noise import IsotropicNoise, NoiseLevel, SensorNoiseModel, noise_parameters
from spinfilters.models.state_layout import StateLayout

CameraType = TypeVar("CameraType", bound=Camera)


class CameraPoseModel(ABC):
    """T_ic, written with ``parameter_dim`` parameters of a measurement."""

    parameter_dim: int

    @abstractmethod
    def in_camera(self, point: Expression, parameters: Expression) -> Expression:
        """p_c = R_ic' (p_i - t_ic)."""

    @abstractmethod
    def in_inertial(self, point: Expression, parameters: Expression) -> Expression:
        """p_i = R_ic p_c + t_ic."""


@dataclass(frozen=True)
class RestingCamera(CameraPoseModel):
    """Camera at rest that defines frame i, without parameters."""

    parameter_dim = 0

    def in_camera(self, point: Expression, parameters: Expression) -> Expression:
        """p_c = p_i."""
        return point

    def in_inertial(self, point: Expression, parameters: Expression) -> Expression:
        """p_i = p_c."""
        return point


@dataclass(frozen=True)
class MovingCamera(CameraPoseModel):
    """Parameters (t_ic 3 m, q_ic 4)."""

    parameter_dim = 7

    def in_camera(self, point: Expression, parameters: Expression) -> Expression:
        """p_c = R_ic' (p_i - t_ic)."""
        return rotate(conjugate(parameters[3:]), point - parameters[:3])

    def in_inertial(self, point: Expression, parameters: Expression) -> Expression:
        """p_i = R_ic p_c + t_ic."""
        return rotate(parameters[3:], point) + parameters[:3]


RESTING, MOVING = RestingCamera(), MovingCamera()


def camera_pose_model(poses: Float[np.ndarray, "k 7"] | None) -> CameraPoseModel:
    """Camera pose model of measurements at such poses."""
    return RESTING if poses is None else MOVING


def with_camera_poses(
    parameters: Float[np.ndarray, "k p"], poses: Float[np.ndarray, "k 7"] | None
) -> Float[np.ndarray, "k q"]:
    """Parameters of measurements with the camera's poses (t_ic m, q_ic) after them; none where it rests."""
    return parameters if poses is None else np.concatenate([parameters, poses], axis=1)


class CameraLandmark(MeasurementModel, Generic[CameraType]):
    """Pixels z of a landmark p_g in a camera.

    That of p_c = R_ic' (t + R_ig p_g - t_ic), as the camera projects it.
    Parameters of a measurement: (p_g 3 m, calibration of the camera, those of the noise, such as pixel_std px, those of the
    camera's pose, none where frame i is the camera's).
    """

    needs = ("t", "a")

    def __init__(
        self,
        layout: StateLayout,
        camera: CameraType,
        noise: SensorNoiseModel | None = None,
        pose: CameraPoseModel = RESTING,
    ) -> None:
        super().__init__(layout)
        self.camera, self.noise, self.pose = camera, noise or IsotropicNoise(camera.pixel_dim), pose
        self._noise = 3 + self.camera.parameter_dim
        self._pose = self._noise + self.noise.parameter_dim
        self.parameter_dim = self._pose + pose.parameter_dim
        self.known_pose = slice(self._pose, self.parameter_dim) if pose.parameter_dim else None

    def symbolic(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Pixels of the landmark."""
        return self.camera.project(self._in_camera(state, parameters), parameters[3 : self._noise])

    def noise_factor(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Noise factor of the pixels, px."""
        return self.noise.factor(parameters[self._noise : self._pose])

    def valid(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Positive before the camera, where the lens is one to one."""
        return self.camera.in_view(self._in_camera(state, parameters), parameters[3 : self._noise])

    def _in_camera(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        point = state["t"] + rotate(state["q"], parameters[:3])
        return self.pose.in_camera(point, parameters[self._pose :])


def camera_parameters(
    points: Float[np.ndarray, "count 3"], calibration: Float[np.ndarray, " c"], noise: NoiseLevel
) -> Float[np.ndarray, "count p"]:
    """Parameters of landmarks at ``points`` (frame g, m) for a calibrated camera whose frame is frame i.

    Parameters
    ----------
    noise : NoiseLevel
        pixel_std (px) of every coordinate, or (count, v, v) covariances (px^2).
    """
    count = len(points)
    rows = np.broadcast_to(calibration, (count, len(calibration)))
    return np.concatenate([points, rows, noise_parameters(noise, count)], axis=1)


SMALLEST_DENOMINATOR = 1e-6
"""Disparity in px that a division is guarded with; such a point is not `determined`."""
SMALLEST_DISPARITY = 5.0
"""In standard deviations of a disparity: a depth that is less certain is no point that a linear model could hold."""


class StereoLandmark(CameraLandmark[StereoPair], LandmarkSensor):
    """z = (u_left, v_left, u_right) in pixels of the point p_g; see `CameraLandmark`."""

    name = "stereo"
    dim = 3
    value_dim = 3
    images = 2

    def __init__(
        self,
        layout: StateLayout,
        noise: SensorNoiseModel | None = None,
        camera: StereoPair | None = None,
        pose: CameraPoseModel = RESTING,
    ) -> None:
        super().__init__(layout, camera or StereoPair(), noise, pose)

    def landmark(
        self, state: dict[str, Expression], measured: Expression, parameters: Expression
    ) -> Expression:
        """Point (3,), m, frame g, that the pixels triangulate to."""
        seen = self.camera.backproject(measured, parameters[3 : self._noise], SMALLEST_DENOMINATOR)
        point = self.pose.in_inertial(seen, parameters[self._pose :])
        return rotate(conjugate(state["q"]), point - state["t"])

    def determined(self, measured: Expression, parameters: Expression) -> Expression:
        """Positive where the disparity is clear of its own noise."""
        std = self.noise.difference_std(parameters[self._noise : self._pose], 0, 2)
        return self.camera.disparity(measured, parameters[3 : self._noise]) - SMALLEST_DISPARITY * std


class MonocularLandmark(CameraLandmark[Monocular]):
    """z = (u, v) in pixels of the point p_g; see `CameraLandmark`.

    A single view does not determine the distance, so a landmark cannot be initialised from one measurement: no `LandmarkSensor`.
    """

    name = "monocular"
    dim = 2
    value_dim = 2
    known_by = 3
    images = 1

    def __init__(
        self,
        layout: StateLayout,
        noise: SensorNoiseModel | None = None,
        camera: Monocular | None = None,
        pose: CameraPoseModel = RESTING,
    ) -> None:
        super().__init__(layout, camera or Monocular(), noise, pose)


PIXEL_STD: Final = NoiseOption(
    "pixel_std", "pixels", NumberRange(1e-12, 1e6, "px"), 1.0, (0, 1), scene_level="pixel_std"
)
"""Of each pixel coordinate: an option that cameras share."""
CALIBRATION: Final = (466.7, 470.0, 320.0, 240.0)
"""fx, fy, cx, cy of the analyser's cameras, px."""


def mapped_rows(
    stream: MeasurementStream, known_map: KnownMap
) -> tuple[slice | Bool[np.ndarray, " n"], Float[np.ndarray, "k 3"]]:
    """Rows that observe mapped landmarks (a full slice if all do), and the points of these landmarks in frame g, m."""
    assert stream.ids is not None  # a stream of landmarks always has them
    ids, last = known_map.ids, len(known_map.ids) - 1
    numbered = ids[0] == 0 and ids[-1] == last  # from 0 on: an id is its row
    row = np.clip(stream.ids if numbered else np.searchsorted(ids, stream.ids), 0, last)
    known = ids[row] == stream.ids
    return (slice(None), known_map.points[row]) if known.all() else (known, known_map.points[row[known]])


def posed_samples(
    time: Float[np.ndarray, " k"],
    poses: Float[np.ndarray, "k 7"],
    view: CameraView,
    landmarks: KnownMap | None = None,
) -> MotionSamples:
    """Initial motion samples from camera-frame poses (t m, q) of g, with the map found with them, if any."""
    camera_poses = view.camera_poses(time)
    if camera_poses is not None:
        poses = in_inertial(poses, camera_poses)
    return MotionSamples(time, poses[:, 3:], positions=poses[:, :3], landmarks=landmarks)
