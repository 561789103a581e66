"""A measured pose of g in i: from absolute orientation, a scan match or an external tracker."""

from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.data.camera import Rig
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.data.noise_levels import SensorNoise
from spinfilters.data.number_range import NumberRange
from spinfilters.data.pose_files import read_tum, write_tum
from spinfilters.data.sensor_format import NoiseOption, SensorFormat
from spinfilters.models.sensors.pose import Pose, pose_parameters
from spinfilters.sensors.scene import Scene, SimulatedStream
from spinfilters.sensors.sensor import (
    AnalysedSensor,
    BoundStream,
    CameraView,
    MotionSamples,
    Sensor,
    diagonal_factor,
    model_over,
    pose_samples,
    row_covariance,
)
from spinfilters.state.layout import StateLayout

POSE_REACH_M: Final = 1.0
"""Largest coordinate of an outlier, m."""


class PoseSensor(Sensor):
    """Values (tx, ty, tz, qx, qy, qz, qw): origin of g in i, m, and unit q_ig; covariance over (t, a), m and rad."""

    name = "pose"
    format = SensorFormat(
        name="pose",
        kind="pose",
        file="poses.tum",
        columns=("tx", "ty", "tz", "qx", "qy", "qz", "qw"),
        dimension=6,
        noise=(
            NoiseOption("pose_position_std", "positions", NumberRange(1e-12, 1e9, "m"), 0.01, (0, 1, 2)),
            NoiseOption("pose_rotation_std", "attitudes", NumberRange(1e-12, 1e3, "rad"), 0.01, (3, 4, 5)),
        ),
        quaternion=3,
        read=read_tum,
        write=write_tum,
        suffixes=(".tum", ".txt"),
        suffix_words="a TUM .tum or .txt",
    )
    sees_place = True
    tells_frames = True
    analysis = AnalysedSensor(
        Pose,
        diagonal_factor(*(0.005,) * 3, *(0.01,) * 3),
        "pose 0.005 m, 0.01 rad",
        tells=("t", "a"),
    )

    def bind(
        self, stream: MeasurementStream, layout: StateLayout, noise: SensorNoise, view: CameraView | None
    ) -> BoundStream:
        std = np.repeat([noise.pose_position_std, noise.pose_rotation_std], 3)
        parameters = pose_parameters(row_covariance(stream, std))
        return BoundStream(model_over(Pose, layout), stream.time, stream.values, parameters)

    def initial_motion(
        self, stream: MeasurementStream, noise: SensorNoise, view: CameraView | None
    ) -> MotionSamples:
        return pose_samples(stream)

    def simulate(self, scene: Scene) -> SimulatedStream:
        small, motion = StateLayout(("t", "a")), scene.motion
        exact = np.concatenate([motion.block("t"), motion.block("a")], axis=1)
        std = np.repeat([scene.noise.position_std, scene.noise.rotation_std], 3)
        noisy = small.retract(exact, std * scene.generator.standard_normal((len(exact), 6)))
        covariance = np.tile(np.diag(std**2), (len(exact), 1, 1))
        stream = MeasurementStream(self.name, motion.time, noisy, None, covariance)
        stated = (scene.noise.position_std, scene.noise.rotation_std)
        return SimulatedStream(
            stream, dict(zip(("pose_position_std", "pose_rotation_std"), stated, strict=True))
        )

    def outliers(
        self, count: int, rig: Rig | None, generator: np.random.Generator
    ) -> Float[np.ndarray, "count 7"]:
        """Origin uniform within +-`POSE_REACH_M`, attitude uniform over all rotations."""
        q = generator.standard_normal((count, 4))
        place = generator.uniform(-POSE_REACH_M, POSE_REACH_M, (count, 3))
        return np.hstack([place, q / np.linalg.norm(q, axis=1, keepdims=True)])


SENSOR = PoseSensor()
