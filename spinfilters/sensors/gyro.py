"""A rate gyro on the body: samples of the body rate in axes g, rad/s."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.data.camera import Rig
from spinfilters.data.gyro_files import read_gyro_csv, saturated, write_gyro_csv
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.data.sensor_format import NoiseOption, SensorFormat, SensorNoise
from spinfilters.data.stated_values import RATE, NumberRange
from spinfilters.models.sensor_models.gyro_model import Gyro, gyro_parameters
from spinfilters.models.sensor_noise import noise_model
from spinfilters.sensors.sensor import (
    AnalysedSensor,
    BoundStream,
    CameraView,
    MotionSamples,
    Sensor,
    model_over,
    noise_level,
)
from spinfilters.sensors.simulated_scene import Scene, SimulatedStream, with_noise
from spinfilters.state.blocks.gyro_bias import GYRO_BIAS
from spinfilters.state.blocks.gyro_scale import GYRO_SCALE
from spinfilters.state.layout import StateLayout

GYRO_FULL_SCALE: Final = 35.0
"""Largest rate of an outlier, rad/s: 2000 deg/s, the full scale of a common sensor."""


class GyroSensor(Sensor):
    """Sensor of the model `spinfilters.models.sensor_models.gyro_model.Gyro`."""

    name = "gyro"
    format = SensorFormat(
        name="gyro",
        kind="gyro",
        file="gyro.csv",
        columns=("wx", "wy", "wz"),
        logged_again=True,
        dimension=3,
        noise=(
            NoiseOption("gyro_noise_std", "gyro", NumberRange(1e-12, 1e6, "rad/s"), 0.005, (0, 1, 2)),
            NoiseOption(
                "gyro_scale_std",
                "gyro, of the rate",
                NumberRange(1e-9, 1e3, zero=True),
                0.0,
                in_dataset=False,
            ),
        ),
        allowed=RATE,
        read=read_gyro_csv,
        write=write_gyro_csv,
    )
    identified_option = "gyro_scale_std"
    error_blocks = (GYRO_BIAS, GYRO_SCALE)
    analysis = AnalysedSensor(
        Gyro, (0.002, 0.0), "gyro 0.002 rad/s", tells=("w",), assumption="the gyro has no bias"
    )

    def bind(
        self, stream: MeasurementStream, layout: StateLayout, noise: SensorNoise, view: CameraView | None
    ) -> BoundStream:
        """Rates with their noise, rad/s."""
        level = noise_level(stream, noise.gyro_noise_std)
        parameters = gyro_parameters(len(stream), level, noise.gyro_scale_std)
        return BoundStream(
            model_over(Gyro, layout, noise_model(level, 3)), stream.time, stream.values, parameters
        )

    def initial_motion(
        self, stream: MeasurementStream, noise: SensorNoise, view: CameraView | None
    ) -> MotionSamples:
        """Rates as samples of the motion."""
        return MotionSamples(stream.time, rates=stream.values)

    def measured_rates(self, stream: MeasurementStream) -> Float[np.ndarray, "n 3"]:
        """Measured rates (n, 3), rad/s, unchanged."""
        return stream.values

    def diagnostics(self, stream: MeasurementStream) -> Sequence[str]:
        """Reason on saturated samples, with their number."""
        count = int(np.count_nonzero(saturated(stream.values)))
        return [f"{count} gyro samples are saturated"] if count else []

    def simulate(self, scene: Scene) -> SimulatedStream:
        """True rates with bias and white noise."""
        rates = scene.motion.block("w")
        values = with_noise(rates + scene.noise.gyro_bias, scene.noise.gyro_std, scene.generator)
        stream = MeasurementStream(self.name, scene.motion.time, values)
        return SimulatedStream(stream, {"gyro_noise_std": scene.noise.gyro_std})

    def outliers(
        self, count: int, rig: Rig | None, generator: np.random.Generator
    ) -> Float[np.ndarray, "count 3"]:
        """Uniform within +-`GYRO_FULL_SCALE`."""
        return generator.uniform(-GYRO_FULL_SCALE, GYRO_FULL_SCALE, (count, 3))


GYRO = GyroSensor()
