"""Pixels of a landmark by any camera: projection, noise and the camera's pose."""

from typing import Generic, TypeVar

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.expressions import Expression, rotate
from spinfilters.geometry.cameras import Camera
from spinfilters.models.camera_pose import RESTING, CameraPoseModel
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.sensor_noise import IsotropicNoise, NoiseLevel, SensorNoiseModel, noise_parameters
from spinfilters.state.layout import StateLayout

CameraType = TypeVar("CameraType", bound=Camera)


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
