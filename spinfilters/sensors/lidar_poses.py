"""Poses of g in i from registered lidar scans, each with the covariance of its own scan."""

from pathlib import Path

import numpy as np

from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.data.noise_levels import SensorNoise
from spinfilters.data.number_range import NumberRange
from spinfilters.data.pose_files import read_tum, write_tum
from spinfilters.data.sensor_format import NoiseOption, SensorFormat
from spinfilters.models.sensors.pose import Pose, pose_parameters
from spinfilters.sensors.scene import Scene, SimulatedStream
from spinfilters.sensors.sensor import (
    BoundStream,
    CameraView,
    MotionSamples,
    Sensor,
    model_over,
    row_covariance,
)
from spinfilters.state.layout import StateLayout

NAME = "lidar-poses"
SURE_ROTATION_STD = 0.1
"""rad: a scan that leaves an attitude less certain says nothing directly of the initial motion."""


def _read(path: Path) -> MeasurementStream:
    stream = read_tum(path)
    return MeasurementStream(NAME, stream.time, stream.values)


class LidarPosesSensor(Sensor):
    """Values (tx, ty, tz, qx, qy, qz, qw): origin of g in i, m, and unit q_ig; covariance over (t, a), m and rad."""

    name = NAME
    format = SensorFormat(
        name=NAME,
        kind=NAME,
        file="lidar_poses.tum",
        columns=("tx", "ty", "tz", "qx", "qy", "qz", "qw"),
        dimension=6,
        noise=(
            NoiseOption("lidar_position_std", "positions", NumberRange(1e-12, 1e9, "m"), 0.01, (0, 1, 2)),
            NoiseOption("lidar_rotation_std", "attitudes", NumberRange(1e-12, 1e3, "rad"), 0.01, (3, 4, 5)),
        ),
        quaternion=3,
        read=_read,
        write=write_tum,
    )
    sees_place = True
    tells_frames = True

    def bind(
        self, stream: MeasurementStream, layout: StateLayout, noise: SensorNoise, view: CameraView | None
    ) -> BoundStream:
        std = np.repeat([noise.lidar_position_std, noise.lidar_rotation_std], 3)
        parameters = pose_parameters(row_covariance(stream, std))
        return BoundStream(model_over(Pose, layout), stream.time, stream.values, parameters)

    def initial_motion(
        self, stream: MeasurementStream, noise: SensorNoise, view: CameraView | None
    ) -> MotionSamples:
        kept = np.ones(len(stream), dtype=bool)
        if stream.covariance is not None:
            worst = np.linalg.eigvalsh(stream.covariance[:, 3:, 3:])[:, -1]
            kept = worst < max(SURE_ROTATION_STD**2, float(np.median(worst)) * 2)
        return MotionSamples(stream.time[kept], stream.values[kept, 3:], positions=stream.values[kept, :3])

    def simulate(self, scene: Scene) -> SimulatedStream:
        small, motion = StateLayout(("t", "a")), scene.motion
        exact = np.concatenate([motion.block("t"), motion.block("a")], axis=1)
        stated = (scene.noise.position_std, scene.noise.rotation_std)
        std = np.repeat(stated, 3)
        values = small.retract(exact, std * scene.generator.standard_normal((len(exact), 6)))
        noise = {"lidar_position_std": stated[0], "lidar_rotation_std": stated[1]}
        return SimulatedStream(MeasurementStream(self.name, motion.time, values), noise)


SENSOR = LidarPosesSensor()
