"""Measured attitude of g in i."""

import numpy as np
from jaxtyping import Float

from spinfilters.data.camera import Rig
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.data.sensor_format import NoiseOption, SensorFormat, SensorNoise
from spinfilters.data.stated_values import NumberRange
from spinfilters.models.sensor_models.attitude_model import Attitude, attitude_parameters
from spinfilters.sensors.sensor import (
    AnalysedSensor,
    BoundStream,
    CameraView,
    MotionSamples,
    Sensor,
    diagonal_factor,
    model_over,
    row_covariance,
)
from spinfilters.sensors.simulated_scene import Scene, SimulatedStream
from spinfilters.state.layout import StateLayout


class AttitudeSensor(Sensor):
    """Values (qx, qy, qz, qw): unit q_ig; covariance of the body-side attitude error, rad^2."""

    name = "attitude"
    format = SensorFormat(
        name="attitude",
        kind="attitude",
        file="attitudes.csv",
        columns=("qx", "qy", "qz", "qw"),
        dimension=3,
        noise=(NoiseOption("attitude_std", "attitudes", NumberRange(1e-12, 1e3, "rad"), 0.01, (0, 1, 2)),),
        quaternion=0,
    )
    tells_frames = True
    analysis = AnalysedSensor(Attitude, diagonal_factor(0.01, 0.01, 0.01), "attitude 0.01 rad", tells=("a",))

    def bind(
        self, stream: MeasurementStream, layout: StateLayout, noise: SensorNoise, view: CameraView | None
    ) -> BoundStream:
        """Attitudes with their noise, rad."""
        parameters = attitude_parameters(row_covariance(stream, np.full(3, noise.attitude_std)))
        return BoundStream(model_over(Attitude, layout), stream.time, stream.values, parameters)

    def initial_motion(
        self, stream: MeasurementStream, noise: SensorNoise, view: CameraView | None
    ) -> MotionSamples:
        """Attitudes as samples of the motion."""
        return MotionSamples(stream.time, stream.values)

    def simulate(self, scene: Scene) -> SimulatedStream:
        """True attitudes turned by white noise."""
        exact, std = scene.motion.block("a"), scene.noise.rotation_std
        noisy = StateLayout(("a",)).retract(exact, std * scene.generator.standard_normal((len(exact), 3)))
        return SimulatedStream(MeasurementStream(self.name, scene.motion.time, noisy), {"attitude_std": std})

    def outliers(
        self, count: int, rig: Rig | None, generator: np.random.Generator
    ) -> Float[np.ndarray, "count 4"]:
        """Uniform over all rotations."""
        q = generator.standard_normal((count, 4))
        return q / np.linalg.norm(q, axis=1, keepdims=True)


ATTITUDE = AttitudeSensor()
