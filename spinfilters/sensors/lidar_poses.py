"""Poses of g in i from registered lidar scans.

Each with the covariance of its own scan.
"""

from typing import Final

import numpy as np

from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.data.sensor_format import SensorNoise
from spinfilters.models.sensor_models.pose_model import LidarPose
from spinfilters.sensors.pose import PoseSensor, pose_format
from spinfilters.sensors.sensor import CameraView, MotionSamples

SURE_ROTATION_STD: Final = 0.1
"""rad: a scan that leaves an attitude less certain says nothing directly of the initial motion."""


class LidarPosesSensor(PoseSensor):
    """A `PoseSensor` of scans, of which some do not determine the whole pose."""

    name = "lidar-poses"
    format = pose_format(name, "lidar_poses.tum", "lidar")
    model = LidarPose
    analysis = None

    def initial_motion(
        self, stream: MeasurementStream, noise: SensorNoise, view: CameraView | None
    ) -> MotionSamples:
        """Poses as samples of the motion."""
        kept = np.ones(len(stream), dtype=bool)
        if stream.covariance is not None:
            worst = np.linalg.eigvalsh(stream.covariance[:, 3:, 3:])[:, -1]
            kept = worst < max(SURE_ROTATION_STD**2, float(np.median(worst)) * 2)
        return MotionSamples(stream.time[kept], stream.values[kept, 3:], positions=stream.values[kept, :3])


LIDAR_POSES = LidarPosesSensor()
