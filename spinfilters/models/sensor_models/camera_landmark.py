"""Pixels of a landmark by any camera: projection, noise and the camera's pose."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.expressions import Expression, conjugate, rotate
from spinfilters.geometry.cameras import Camera
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.sensor_noise import IsotropicNoise, NoiseLevel, SensorNoiseModel, noise_parameters
from spinfilters.state.layout import StateLayout

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
    """Parameters of measurements with the camera's poses (t_ic m, q_ic) behind them; none where it rests."""
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
    """Parameters of landmarks at ``points`` (frame g, m) for a calibrated camera.

    Frame i is the camera's own.

    Parameters
    ----------
    noise: pixel_std (px) of every coordinate, or (count, v, v) covariances (px^2).
    """
    count = len(points)
    rows = np.broadcast_to(calibration, (count, len(calibration)))
    return np.concatenate([points, rows, noise_parameters(noise, count)], axis=1)
