"""A landmark of the map seen by a stereo pair."""

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.expressions import Expression, conjugate, rotate
from spinfilters.geometry.cameras import StereoPair
from spinfilters.models.camera_pose import RESTING, CameraPoseModel
from spinfilters.models.landmark_sensor import LandmarkSensor
from spinfilters.models.sensor_noise import IsotropicNoise, NoiseLevel, SensorNoiseModel, noise_parameters
from spinfilters.state.layout import StateLayout

SMALLEST_DENOMINATOR = 1e-6
"""Disparity in px that a division is guarded with; such a point is not `determined`."""
SMALLEST_DISPARITY = 5.0
"""In standard deviations of a disparity: a depth that is less certain is no point that a linear model could hold."""


class StereoLandmark(LandmarkSensor):
    """z = (u_left, v_left, u_right) in pixels of the point p_g.

    Of p_c = R_ic' (t + R_ig p_g - t_ic), as the camera projects it.
    Parameters of a measurement: (p_g 3 m, calibration of the pair, those of the noise, such as pixel_std px, those of the camera's
    pose, none where frame i is the camera's).
    """

    name = "stereo"
    dim = 3
    value_dim = 3
    needs = ("t", "a")

    def __init__(
        self,
        layout: StateLayout,
        noise: SensorNoiseModel | None = None,
        camera: StereoPair | None = None,
        pose: CameraPoseModel = RESTING,
    ) -> None:
        super().__init__(layout)
        self.noise, self.camera, self.pose = noise or IsotropicNoise(3), camera or StereoPair(), pose
        self._noise = 3 + self.camera.parameter_dim
        self._pose = self._noise + self.noise.parameter_dim
        self.parameter_dim = self._pose + pose.parameter_dim

    def symbolic(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Pixels (u_left, v, u_right) of the landmark."""
        return self.camera.project(self._in_camera(state, parameters), parameters[3 : self._noise])

    def noise_factor(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Of the pixels, px."""
        return self.noise.factor(parameters[self._noise : self._pose])

    def valid(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Positive before the cameras, where the lens is one to one."""
        return self.camera.in_view(self._in_camera(state, parameters), parameters[3 : self._noise])

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

    def _in_camera(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        point = state["t"] + rotate(state["q"], parameters[:3])
        return self.pose.in_camera(point, parameters[self._pose :])


def stereo_parameters(
    points: Float[np.ndarray, "count 3"], calibration: Float[np.ndarray, " c"], noise: NoiseLevel
) -> Float[np.ndarray, "count p"]:
    """Parameters of landmarks for a stereo pair (`StereoPair`).

    At ``points`` (frame g, m), with this calibration, frame i being its own.

    Parameters
    ----------
    noise: pixel_std (px) of every coordinate, or (count, 3, 3) covariances (px^2).
    """
    count = len(points)
    rows = np.broadcast_to(calibration, (count, len(calibration)))
    return np.concatenate([points, rows, noise_parameters(noise, count)], axis=1)
