"""Measured attitudes of the body in frame i, unit quaternions."""

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_expressions import Expression, conjugate, product, short_mrp_from_quaternion
from spinfilters.io.camera import Rig
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.sensor_format import NoiseOption, SensorFormat, SensorNoise
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
    row_covariance,
)
from spinfilters.models.sensor_noise import factor_of, parameters_of
from spinfilters.models.state_layout import StateLayout


class Attitude(MeasurementModel):
    """z = q_ig with an innovation of 4 x MRP on the body side.

    Parameters of a measurement: the 6 entries, row by row, of the lower Cholesky factor of its covariance (rad).
    """

    name = "attitude"
    dim = 3
    value_dim = 4
    parameter_dim = 6
    needs = ("a",)

    def symbolic(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """q_ig."""
        return state["q"]

    def innovation(self, expected: Expression, measured: Expression) -> Expression:
        """4 x MRP of the rotation from the expected to the measured attitude, rad."""
        return short_mrp_from_quaternion(product(conjugate(expected), measured))

    def noise_factor(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Noise factor from the parameters, rad."""
        return factor_of(parameters, 3)


def attitude_parameters(covariance: Float[np.ndarray, "count 3 3"]) -> Float[np.ndarray, "count 6"]:
    """Parameters of attitudes with these covariances, rad^2.

    Raises
    ------
    numpy.linalg.LinAlgError
        When a covariance is not positive definite.
    """
    return parameters_of(covariance)


class AttitudeSensor(Sensor):
    """Values (qx, qy, qz, qw): unit q_ig; covariance of the body-side attitude error, rad^2."""

    name = "attitude"
    format = SensorFormat(
        name="attitude",
        kind="attitude",
        file="attitudes.csv",
        columns=("qx", "qy", "qz", "qw"),
        logged_again=True,  # fast loggers hold the latest attitude of a slower sensor
        dimension=3,
        noise=(
            NoiseOption(
                "attitude_std",
                "attitudes",
                NumberRange(1e-12, 1e3, "rad"),
                0.01,
                (0, 1, 2),
                scene_level="rotation_std",
            ),
        ),
        quaternion=0,
    )
    analysis = AnalysedSensor(
        Attitude, diagonal_factor(0.01, 0.01, 0.01), {"attitude_std": diagonal_places(3)}, tells=("a",)
    )

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
        exact, std = scene.motion.block("a"), scene.noise.level("attitude_std")
        noisy = StateLayout(("a",)).retract(exact, std * scene.generator.standard_normal((len(exact), 3)))
        return SimulatedStream(MeasurementStream(self.name, scene.motion.time, noisy), {"attitude_std": std})

    def outliers(
        self, count: int, rig: Rig | None, generator: np.random.Generator
    ) -> Float[np.ndarray, "count 4"]:
        """Uniform over all rotations."""
        q = generator.standard_normal((count, 4))
        return q / np.linalg.norm(q, axis=1, keepdims=True)


ATTITUDE = AttitudeSensor()
