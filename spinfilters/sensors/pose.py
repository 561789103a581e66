"""Measured pose of g in i.

From absolute orientation, a scan match or an external tracker.
"""

from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.data.camera import Rig
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.data.pose_files import read_tum, write_tum
from spinfilters.data.sensor_format import NoiseOption, SensorFormat, SensorNoise, sensor_format
from spinfilters.data.stated_values import NumberRange
from spinfilters.models.sensor_models.pose_model import Pose, pose_parameters
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
from spinfilters.sensors.simulated_scene import Scene, SimulatedStream
from spinfilters.state.layout import StateLayout

POSE_REACH_M: Final = 1.0
"""Largest coordinate of an outlier, m."""


def pose_format(
    name: str, file: str, prefix: str, suffixes: tuple[str, ...] = (), suffix_words: str = ""
) -> SensorFormat:
    """TUM poses of a sensor, with the noise options ``prefix``_position_std and ``prefix``_rotation_std.

    Parameters
    ----------
    suffixes, suffix_words: of single files that are read as this sensor's.
    """

    def read(path: Path) -> MeasurementStream:
        """Poses of a file."""
        stream = read_tum(path)
        return MeasurementStream(name, stream.time, stream.values)

    return SensorFormat(
        name=name,
        kind=name,
        file=file,
        columns=("tx", "ty", "tz", "qx", "qy", "qz", "qw"),
        dimension=6,
        noise=(
            NoiseOption(f"{prefix}_position_std", "positions", NumberRange(1e-12, 1e9, "m"), 0.01, (0, 1, 2)),
            NoiseOption(
                f"{prefix}_rotation_std", "attitudes", NumberRange(1e-12, 1e3, "rad"), 0.01, (3, 4, 5)
            ),
        ),
        quaternion=3,
        read=read,
        write=write_tum,
        suffixes=suffixes,
        suffix_words=suffix_words,
    )


class PoseSensor(Sensor):
    """Values (tx, ty, tz, qx, qy, qz, qw) of a pose.

    Origin of g in i, m, and unit q_ig; covariance over (t, a), m and rad.
    """

    name = "pose"
    format = pose_format(
        name, "poses.tum", "pose", suffixes=(".tum", ".txt"), suffix_words="a TUM .tum or .txt"
    )
    sees_place = True
    tells_frames = True
    model: type[Pose] = Pose
    analysis = AnalysedSensor(
        Pose,
        diagonal_factor(*(0.005,) * 3, *(0.01,) * 3),
        "pose 0.005 m, 0.01 rad",
        tells=("t", "a"),
    )

    def bind(
        self, stream: MeasurementStream, layout: StateLayout, noise: SensorNoise, view: CameraView | None
    ) -> BoundStream:
        """Poses with their noise, m and rad."""
        std = np.repeat([getattr(noise, name) for name in self._options], 3)
        parameters = pose_parameters(row_covariance(stream, std))
        return BoundStream(model_over(self.model, layout), stream.time, stream.values, parameters)

    def initial_motion(
        self, stream: MeasurementStream, noise: SensorNoise, view: CameraView | None
    ) -> MotionSamples:
        """Poses as samples of the motion."""
        return pose_samples(stream)

    def simulate(self, scene: Scene) -> SimulatedStream:
        """True poses with white noise in position and attitude."""
        small, motion = StateLayout(("t", "a")), scene.motion
        exact = np.concatenate([motion.block("t"), motion.block("a")], axis=1)
        stated = (scene.noise.position_std, scene.noise.rotation_std)
        std = np.repeat(stated, 3)
        noisy = small.retract(exact, std * scene.generator.standard_normal((len(exact), 6)))
        covariance = np.tile(np.diag(std**2), (len(exact), 1, 1))
        stream = MeasurementStream(self.name, motion.time, noisy, None, covariance)
        return SimulatedStream(stream, dict(zip(self._options, stated, strict=True)))

    def outliers(
        self, count: int, rig: Rig | None, generator: np.random.Generator
    ) -> Float[np.ndarray, "count 7"]:
        """Origin uniform within +-`POSE_REACH_M`, attitude uniform over all rotations."""
        q = generator.standard_normal((count, 4))
        place = generator.uniform(-POSE_REACH_M, POSE_REACH_M, (count, 3))
        return np.hstack([place, q / np.linalg.norm(q, axis=1, keepdims=True)])

    @property
    def _options(self) -> tuple[str, ...]:
        """Noise of the positions and of the attitudes."""
        return tuple(option.name for option in sensor_format(self.name).noise)


POSE = PoseSensor()
