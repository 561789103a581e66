"""A magnetometer on the body: samples of a magnetic field in axes g, of which the field in frame i is known, T."""

from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.attitude_expressions import Expression, conjugate, rotate
from spinfilters.core.errors import InputError
from spinfilters.io.camera import Rig
from spinfilters.io.input_file import path_text
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.sensor_format import NoiseOption, SensorFormat, SensorNoise
from spinfilters.io.stated_values import NumberRange
from spinfilters.io.text_table import Table
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.sensor import (
    AnalysedSensor,
    BoundStream,
    CameraView,
    Scene,
    Sensor,
    SimulatedStream,
    model_over,
    noise_level,
    with_noise,
)
from spinfilters.models.sensor_noise import IsotropicNoise, SensorNoiseModel, noise_model, noise_parameters
from spinfilters.models.state_layout import StateLayout

FIELD: Final = (2e-5, -1e-5, 4e-5)
"""Field of a simulated scene, T, frame i: of the size of the Earth's in a low orbit."""
LARGEST_FIELD: Final = 1e-4
"""Of an outlier, T along each axis."""

STRONGEST_RATIO: Final = 10.0
"""Of the measured field over that of the model, or the reverse: beyond it both are hardly in one unit."""


def require_one_unit(table: Table) -> None:
    """Raise InputError where measured and modelled fields differ so much in strength that one of them is not in T."""
    measured, modelled = (
        float(np.median(np.linalg.norm(each, axis=1)))
        for each in (table.values[:, 1:4], table.values[:, 4:7])
    )
    if not measured < STRONGEST_RATIO * modelled or not modelled < STRONGEST_RATIO * measured:
        raise InputError(
            f"{path_text(table.path)}: the measured field bx, by, bz has {measured:.3g} T, that of the model fx, fy, fz "
            f"{modelled:.3g} T (medians); give both in tesla: 1 uT = 1e-6 T, 1 nT = 1e-9 T, 1 gauss = 1e-4 T"
        )


class Magnetometer(MeasurementModel):
    """z = R_ig' m_i + n, T.

    m_i is the field in frame i at the time of the sample, as a model gives it; n has the covariance N = noise_std^2 I, or each
    sample's own. Bias, scale and misalignment are taken as calibrated.
    Parameters of a measurement: (those of N, such as noise_std T, then m_i 3 T).
    """

    name = "magnetometer"
    dim = 3
    value_dim = 3
    needs = ("a",)

    def __init__(self, layout: StateLayout, noise: SensorNoiseModel | None = None) -> None:
        super().__init__(layout)
        self.noise = noise or IsotropicNoise(3)
        self.parameter_dim = self.noise.parameter_dim + 3

    def symbolic(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """The field in g axes, T."""
        return rotate(conjugate(state["q"]), parameters[self.noise.parameter_dim :])

    def noise_factor(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """White noise, T."""
        return self.noise.factor(parameters[: self.noise.parameter_dim])


class MagnetometerSensor(Sensor):
    """Values (bx, by, bz, fx, fy, fz): the field as measured, axes g, and as a model of the field gives it, frame i, T.

    One direction leaves the rotation about it open: poses or attitudes determine how the body moves at first.
    """

    name = "magnetometer"
    format = SensorFormat(
        name="magnetometer",
        kind="magnetometer",
        file="magnetometer.csv",
        columns=("bx", "by", "bz", "fx", "fy", "fz"),
        dimension=3,
        noise=(
            NoiseOption(
                "magnetometer_std",
                "magnetometer",
                NumberRange(1e-15, 1e3, "T"),
                1e-7,
                (0, 1, 2),
                simulated=1e-7,
            ),
        ),
        allowed=NumberRange(-1e3, 1e3, "T"),
        check=require_one_unit,
    )
    analysis = AnalysedSensor(
        Magnetometer,
        (1e-7, 0.0, 0.0, 5e-5),
        {"magnetometer_std": (0,)},
        words="a magnetometer",
        assumption="the magnetic field in frame i is known (in the exact rank, and without a recording, 5e-5 T along its z)",
    )

    def bind(
        self, stream: MeasurementStream, layout: StateLayout, noise: SensorNoise, view: CameraView | None
    ) -> BoundStream:
        """Fields with their noise and the field in frame i, T."""
        level = noise_level(stream, noise.magnetometer_std)
        own = noise_parameters(level, len(stream))
        parameters = np.concatenate([own, stream.values[:, 3:]], axis=1)
        model = model_over(Magnetometer, layout, noise_model(level, 3))
        return BoundStream(model, stream.time, np.ascontiguousarray(stream.values[:, :3]), parameters)

    def simulate(self, scene: Scene) -> SimulatedStream:
        """The constant field `FIELD` in axes g, with white noise."""
        std, motion = scene.noise.level("magnetometer_std"), scene.motion
        field = np.tile(FIELD, (len(motion.time), 1))
        exact = np.einsum("nji,nj->ni", matrix_from_quaternion(motion.block("a")), field)
        values = np.concatenate([with_noise(exact, std, scene.generator), field], axis=1)
        return SimulatedStream(MeasurementStream(self.name, motion.time, values), {"magnetometer_std": std})

    def flipped(self, values: Float[np.ndarray, "6"]) -> Float[np.ndarray, "6"]:
        """The measured field backwards."""
        return np.concatenate([-values[:3], values[3:]])

    def outliers(
        self, count: int, rig: Rig | None, generator: np.random.Generator
    ) -> Float[np.ndarray, "count 6"]:
        """Measured fields uniform within +-`LARGEST_FIELD`, of the field of a simulated scene."""
        measured = generator.uniform(-LARGEST_FIELD, LARGEST_FIELD, (count, 3))
        return np.concatenate([measured, np.tile(FIELD, (count, 1))], axis=1)


MAGNETOMETER = MagnetometerSensor()
