"""Measured poses of frame g in frame i: of a tracker or an absolute orientation, and of registered lidar scans."""

from pathlib import Path
from typing import Final

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import multiply, quaternion_from_rotation_vector
from spinfilters.core.attitude_expressions import Expression, conjugate, product, short_mrp_from_quaternion
from spinfilters.io.camera import Rig
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.sensor_format import NoiseOption, SensorFormat, SensorNoise, sensor_format
from spinfilters.io.sensor_tables import read_tum, write_tum
from spinfilters.io.stated_values import NumberRange
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.sensor import (
    AnalysedSensor,
    BoundStream,
    CameraView,
    MotionSamples,
    Scene,
    Sensor,
    SimulatedStream,
    diagonal_factor,
    diagonal_places,
    model_over,
    pose_samples,
    row_covariance,
)
from spinfilters.models.sensor_noise import factor_of, parameters_of
from spinfilters.models.state_layout import StateLayout


class Pose(MeasurementModel):
    """z = (t, q_ig) with an innovation of dimension 6.

    (t, 4 x MRP on the body side).
    Parameters of a measurement: the 21 entries, row by row, of the lower Cholesky factor of its covariance (m, rad).
    """

    name = "pose"
    dim = 6
    value_dim = 7
    parameter_dim = 21
    needs = ("t", "a")

    def symbolic(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """(t, q_ig)."""
        return ca.vertcat(state["t"], state["q"])

    def innovation(self, expected: Expression, measured: Expression) -> Expression:
        """Difference of the positions, m, and 4 x MRP of that of the attitudes, rad."""
        turn = product(conjugate(expected[3:]), measured[3:])
        return ca.vertcat(measured[:3] - expected[:3], short_mrp_from_quaternion(turn))

    def noise_factor(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Lower factor of (t, a), m and rad."""
        return factor_of(parameters, 6)


class LidarPose(Pose):
    """A pose from a registered scan: its noise is a lidar's own."""

    name = "lidar-poses"


def pose_parameters(covariance: Float[np.ndarray, "count 6 6"]) -> Float[np.ndarray, "count 21"]:
    """Parameters of poses with these covariances, order (t, a).

    Raises
    ------
    numpy.linalg.LinAlgError
        When a covariance is not positive definite.
    """
    return parameters_of(covariance)


POSE_REACH_M: Final = 1.0
"""Largest coordinate of an outlier, m."""


def pose_format(
    name: str, file: str, prefix: str, suffixes: tuple[str, ...] = (), suffix_words: str = ""
) -> SensorFormat:
    """TUM poses of a sensor, with the noise options ``prefix``_position_std and ``prefix``_rotation_std.

    Parameters
    ----------
    suffixes, suffix_words
        Of single files that are read as this sensor's.
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
        logged_again=True,  # displays and robots hold the latest pose of a slower tracker
        dimension=6,
        noise=(
            NoiseOption(
                f"{prefix}_position_std",
                "positions",
                NumberRange(1e-12, 1e9, "m"),
                0.01,
                (0, 1, 2),
                scene_level="position_std",
            ),
            NoiseOption(
                f"{prefix}_rotation_std",
                "attitudes",
                NumberRange(1e-12, 1e3, "rad"),
                0.01,
                (3, 4, 5),
                scene_level="rotation_std",
            ),
        ),
        quaternion=3,
        read=read,
        write=write_tum,
        suffixes=suffixes,
        suffix_words=suffix_words,
    )


class PoseSensor(Sensor):
    """Values (tx, ty, tz, qx, qy, qz, qw) of a pose: origin of g in i, m, and unit q_ig.

    The covariance is over (t, a), in m and rad.
    """

    name = "pose"
    format = pose_format(
        name, "poses.tum", "pose", suffixes=(".tum", ".txt"), suffix_words="a TUM .tum or .txt"
    )
    sees_place = True
    model: type[Pose] = Pose
    analysis = AnalysedSensor(
        Pose,
        diagonal_factor(*(0.005,) * 3, *(0.01,) * 3),
        {"pose_position_std": diagonal_places(6)[:3], "pose_rotation_std": diagonal_places(6)[3:]},
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
        stated = [scene.noise.level(name) for name in self._options]
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

    def flipped(self, values: Float[np.ndarray, "7"]) -> Float[np.ndarray, "7"]:
        """The place on the other side of the camera."""
        return np.append(-values[:3], values[3:])

    def turned(
        self, values: Float[np.ndarray, "7"], rotation_vector: Float[np.ndarray, "3"]
    ) -> Float[np.ndarray, "7"]:
        """The attitude turned on the body side, in the same place."""
        return np.append(values[:3], multiply(values[3:], quaternion_from_rotation_vector(rotation_vector)))

    @property
    def _options(self) -> tuple[str, ...]:
        """Noise of the positions and of the attitudes."""
        return tuple(option.name for option in sensor_format(self.name).noise)


POSE = PoseSensor()


SURE_ROTATION_STD: Final = 0.1
"""rad: a scan that leaves an attitude less certain says nothing directly of the initial motion."""


class LidarPosesSensor(PoseSensor):
    """A `PoseSensor` of scans, of which some do not determine the whole pose."""

    name = "lidar-poses"
    format = pose_format(name, "lidar_poses.tum", "lidar")
    model = LidarPose
    analysis = AnalysedSensor(
        Pose,
        diagonal_factor(*(0.005,) * 3, *(0.01,) * 3),
        {"lidar_position_std": diagonal_places(6)[:3], "lidar_rotation_std": diagonal_places(6)[3:]},
        tells=("t", "a"),
    )

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
