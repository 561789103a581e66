"""A landmark of the map seen by a stereo pair."""

from spinfilters.attitude.expressions import Expression, conjugate, rotate
from spinfilters.geometry.cameras import StereoPair
from spinfilters.models.landmark_sensor import LandmarkSensor
from spinfilters.models.sensor_models.camera_landmark import RESTING, CameraLandmark, CameraPoseModel
from spinfilters.models.sensor_noise import SensorNoiseModel
from spinfilters.state.layout import StateLayout

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
