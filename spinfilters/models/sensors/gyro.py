"""A rate gyro on the body: samples of the body rate in axes g, rad/s, with constant bias and scale error.

First its measurement model `Gyro`, from which Jacobians, filters and smoother are made; then the sensor `GyroSensor`: file format,
binding of a recording to a state, initial motion, simulation and faults. The last line is its entry for the table of sensors
(`spinfilters.models.sensor_registry`).
"""

from collections.abc import Sequence
from typing import Final

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float

from spinfilters.core.attitude_expressions import Expression
from spinfilters.io.camera import Rig
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.sensor_format import NoiseOption, SensorFormat, SensorNoise
from spinfilters.io.sensor_tables import require_turns
from spinfilters.io.stated_values import RATE, NumberRange
from spinfilters.io.text_table import Table
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.sensor import (
    AnalysedSensor,
    BoundStream,
    CameraView,
    MotionSamples,
    Scene,
    Sensor,
    SimulatedStream,
    model_over,
    noise_level,
    with_noise,
)
from spinfilters.models.sensor_noise import (
    IsotropicNoise,
    NoiseLevel,
    SensorNoiseModel,
    noise_model,
    noise_parameters,
)
from spinfilters.models.state_blocks import GYRO_BIAS, GYRO_SCALE
from spinfilters.models.state_layout import StateLayout


class Gyro(MeasurementModel):
    """z = (1 + k) w + b + n, rad/s.

    Bias b and relative error of the scale k where the layout holds them.
    The noise n has the covariance N + (scale_std |w|)^2 I, with N = noise_std^2 I or each sample's own.
    Consumer gyros carry scale, cross-axis and timing errors that grow with the rate; ``scale_std`` covers them, because a
    fixed noise makes the normalised innovations of a fast spin tens to hundreds of times too large.
    Every sample comes with its parameters: first those of N (such as noise_std, rad/s), last scale_std (no unit).
    """

    name = "gyro"
    dim = 3
    value_dim = 3
    needs = ("w",)
    reads_rate = True

    def __init__(self, layout: StateLayout, noise: SensorNoiseModel | None = None) -> None:
        super().__init__(layout)
        self.noise = noise or IsotropicNoise(3)
        self.parameter_dim = self.noise.parameter_dim + 1
        self.needs = (*self.needs, *(block.name for block in (GYRO_BIAS, GYRO_SCALE) if layout.has(block)))

    def symbolic(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Body rate in g axes, with scale error and bias where the state has them, rad/s."""
        rate = state["w"]
        if self.layout.has(GYRO_SCALE):
            rate = (1 + state["k"]) * rate
        return rate + state["b"] if self.layout.has(GYRO_BIAS) else rate

    def noise_factor(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Square root of N + (scale_std |w|)^2 I, rad/s."""
        w, own = state["w"], self.noise.parameter_dim
        return self.noise.factor(parameters[:own], parameters[own] ** 2 * ca.dot(w, w))


def gyro_parameters(count: int, noise: NoiseLevel, scale_std: float) -> Float[np.ndarray, "count p"]:
    """Parameters of ``count`` gyro samples: noise_std (rad/s) of all, or (count, 3, 3) covariances ((rad/s)^2)."""
    return np.concatenate([noise_parameters(noise, count), np.full((count, 1), scale_std)], axis=1)


GYRO_FULL_SCALE: Final = 35.0
"""Largest rate of an outlier, rad/s: 2000 deg/s, the full scale of a common sensor."""


def require_slow_turns(table: Table) -> None:
    """Raise InputError where the body turns so often between samples that the times are probably not in seconds."""
    require_turns(table, np.linalg.norm(table.values[:, 1:], axis=1))


class GyroSensor(Sensor):
    """The gyro as files, initialisation and simulation know it."""

    name = "gyro"
    format = SensorFormat(
        name="gyro",
        kind="gyro",
        file="gyro.csv",
        columns=("wx", "wy", "wz"),
        logged_again=True,  # fast loggers write a sample again until the next one comes
        dimension=3,
        noise=(
            NoiseOption(
                "gyro_noise_std",
                "gyro",
                NumberRange(1e-12, 1e6, "rad/s"),
                default=0.005,
                components=(0, 1, 2),
                # Simulations take its level from this field of a Scenario, which older sensors have. A new sensor states
                # `simulated=` here instead, as the magnetometer does.
                scene_level="gyro_std",
            ),
            NoiseOption(
                "gyro_scale_std",
                "gyro, of the rate",
                NumberRange(1e-9, 1e3, zero=True),
                default=0.0,
                in_dataset=False,
                remark="White noise of each sample in proportion to the rate. A constant error is calibration.gyro_scale_std.",
            ),
        ),
        allowed=RATE,
        check=require_slow_turns,
    )
    # Where no noise is stated, this level is identified from residuals divided by |w|: errors of usual gyros grow with the rate.
    identified_option = "gyro_scale_std"
    error_blocks = (GYRO_BIAS, GYRO_SCALE)
    analysis = AnalysedSensor(
        model=Gyro,
        parameters=(0.002, 0.0),  # noise_std in rad/s, scale_std
        noise={"gyro_noise_std": (0,), "gyro_scale_std": (1,)},  # where each stands in the parameters
        tells=("w",),
        assumption="the gyro has no bias",
        bias=GYRO_BIAS,
    )

    def bind(
        self, stream: MeasurementStream, layout: StateLayout, noise: SensorNoise, view: CameraView | None
    ) -> BoundStream:
        """The measurement model over a state, with times, values and parameters of all samples; a gyro needs no ``view``."""
        level = noise_level(stream, noise.gyro_noise_std)
        parameters = gyro_parameters(len(stream), level, noise.gyro_scale_std)
        return BoundStream(
            model_over(Gyro, layout, noise_model(level, 3)), stream.time, stream.values, parameters
        )

    def initial_motion(
        self, stream: MeasurementStream, noise: SensorNoise, view: CameraView | None
    ) -> MotionSamples:
        """What this sensor says of the motion, its rates; what it does not say `spinfilters.smoother.closed_form` computes."""
        return MotionSamples(stream.time, rates=stream.values)

    def measured_rates(self, stream: MeasurementStream) -> Float[np.ndarray, "n 3"]:
        """Body rates that the recording shows directly, (n, 3), rad/s."""
        return stream.values

    def diagnostics(self, stream: MeasurementStream) -> Sequence[str]:
        """A sentence with the number of saturated samples, if there are any."""
        count = int(np.count_nonzero(saturated(stream.values)))
        return [f"{count} gyro samples are saturated"] if count else []

    def simulate(self, scene: Scene) -> SimulatedStream:
        """True rates with bias and white noise."""
        rates, std = scene.motion.block("w"), scene.noise.level("gyro_noise_std")
        values = with_noise(rates + scene.noise.gyro_bias, std, scene.generator)
        stream = MeasurementStream(self.name, scene.motion.time, values)
        return SimulatedStream(stream, {"gyro_noise_std": std})

    def flipped(self, values: Float[np.ndarray, " v"]) -> Float[np.ndarray, " v"]:
        """The rate with the opposite sign, as if all axes pointed the other way."""
        return np.negative(values)

    def outliers(
        self, count: int, rig: Rig | None, generator: np.random.Generator
    ) -> Float[np.ndarray, "count 3"]:
        """Uniform within +-`GYRO_FULL_SCALE`."""
        return generator.uniform(-GYRO_FULL_SCALE, GYRO_FULL_SCALE, (count, 3))


FLAT_TOP: Final[float] = 1e-3
"""Relative distance from the largest |rate| of an axis within which clipped samples lie, since offsets are corrected after
clipping."""
NEAR_TOP: Final[float] = 2e-2
"""Relative distance within which few samples lie next to clipped ones. Of a smooth peak's samples within it, the share
sqrt(FLAT_TOP / NEAR_TOP) lies within `FLAT_TOP`."""
FEWEST_CLIPPED: Final[int] = 3
"""Samples that can make a flat top."""
CHANCE: Final[float] = 1e-4
"""Probability that a smooth peak has as flat a top; where it is smaller, the top counts as clipped at any full scale."""
FULL_SCALES: Final = np.deg2rad(125.0 * 2.0 ** np.arange(6))
"""Full scales of usual gyros, rad/s: a flat top of few samples counts as clipped where it lies at one of them."""
FULL_SCALE_TOLERANCE: Final[float] = 5e-3
"""Relative distance from a full scale that still counts as at it."""


def saturated(rate: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    """Whether a component of the rate is clipped at its largest magnitude.

    An axis that stays at its largest rate most of the time spins steadily and does not count as clipped; nor does a peak whose flat
    top can be chance or the sensor's resolution.
    """
    clipped = np.zeros(len(rate), dtype=bool)
    for axis in np.asarray(rate).T:
        clipped |= _flat_top(np.abs(axis), np.sign(axis))
    return clipped


def _flat_top(size: Float[np.ndarray, " n"], sign: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Clipped samples of an axis."""
    from scipy.special import bdtrc  # slow to import: every command lists the sensors, few ask for this

    largest, nothing = size.max(initial=0.0), np.zeros(len(size), dtype=bool)
    if not 0 < largest < np.inf:
        return nothing
    resolution = np.diff(np.unique(size)).min(initial=largest) / largest
    flat = max(FLAT_TOP, 1.5 * resolution)
    top, near = size >= (1 - flat) * largest, size >= (1 - flat * NEAR_TOP / FLAT_TOP) * largest
    together = bool(np.any(top[1:] & top[:-1] & (sign[1:] == sign[:-1])))
    count, near_count = np.count_nonzero(top), np.count_nonzero(near)  # the near samples include the top
    if not together or not FEWEST_CLIPPED <= count <= len(size) / 2 or 2 * count <= near_count:
        return nothing
    usual = bool(np.any(np.abs(largest / FULL_SCALES - 1) < FULL_SCALE_TOLERANCE))
    by_chance = float(bdtrc(count - 1, near_count, np.sqrt(FLAT_TOP / NEAR_TOP)))
    return top if usual or by_chance < CHANCE else nothing


GYRO = GyroSensor()
