"""Noise that is not stated: the levels that `identification` has to find, and a gyro's error, found from its whole recording."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import NUMERICAL_ERRORS, InputError, numerical
from spinfilters.filters.noise_levels import ComponentRows, VarianceComponent
from spinfilters.filters.timeline import SensorNoise, Timeline, build_timeline, by_sensor
from spinfilters.inference.initial_estimate import InitialEstimate, initialise
from spinfilters.inference.noise_model import NoiseModel
from spinfilters.io.disturbances import DENSITIES
from spinfilters.io.input_file import reason
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.io.sensor_format import noise_options, sensor_format
from spinfilters.io.sensor_tables import require_motion
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.sensor import MotionSamples, Sensor
from spinfilters.models.sensor_registry import sensor_of
from spinfilters.settings.run_settings import InitialisationOptions
from spinfilters.smoother.problem import Problem

WHOLE_RECORDING = 400
"""Samples, at most, from which the error of a rate sensor is identified."""
FIRST_SCALE = 0.01
"""Relative error from which the identification begins: a per cent is what phones do."""
SMALLEST_SCALE = 1e-5
"""Relative error below which no gyro is: torque-free motion then explains the rates to what a simulation without noise leaves."""
WHITE = 2.5
"""Correlation time, in samples, below which an error counts as white: simulated white noise stays below 2, phones lie above 4."""
LARGEST_ERROR = 0.04
"""Relative rms of a gyro's residual: beyond it this is no torque-free flight of a rigid body."""
DISTURBANCE = 0.01
"""Angular acceleration noise of a body that a phone rides on, relative to |w|, in (rad/s^2)/sqrt(Hz) per rad/s: air, straps and
what the gyro's slow errors look like, one per cent of the rate in a second. Without it the clean phone tosses are predicted 0.3 s
ahead to 6 % of the rate at worst, with it to 4 % (``python -m experiments.gyro_throws``)."""


@dataclass(frozen=True)
class GyroNoise:
    """Identified gyro error.

    Attributes
    ----------
    relative_error : float
        Rms per axis relative to |w|.
    correlation_time : float
        Tau, in samples, at least 1.
    """

    relative_error: float
    correlation_time: float

    @property
    def is_white(self) -> bool:
        """Whether errors of successive samples are uncorrelated."""
        return self.correlation_time < WHITE

    @property
    def is_noise_free(self) -> bool:
        """Whether it is smaller than that of any gyro, as of a simulation without noise.

        What is left of the rates is rounding, whose correlation says nothing of a gyro.
        """
        return self.relative_error < SMALLEST_SCALE

    @property
    def is_of_flight(self) -> bool:
        """Whether it is small enough for a gyro in free flight.

        What is larger is an error of the motion's model.
        """
        return self.relative_error <= LARGEST_ERROR

    @property
    def scale_std(self) -> float:
        """Standard deviation, relative to |w|, of equivalent white noise."""
        return max(self.relative_error, SMALLEST_SCALE) * float(np.sqrt(self.correlation_time))


def disturbance_psd(gyro: MeasurementStream) -> float:
    """Density of the angular acceleration of a recording whose gyro is of unknown error, (rad/s^2)^2/Hz."""
    return float(DISTURBANCE * np.mean(np.linalg.norm(gyro.values, axis=1))) ** 2


def white_level(gyro: MeasurementStream, found: GyroNoise) -> dict[str, float]:
    """First level of a white error by its noise option, rad/s."""
    (option,) = sensor_format(gyro.sensor).levels
    rate = float(np.sqrt(np.mean(np.sum(gyro.values**2, axis=1))))
    return {option: max(found.relative_error, SMALLEST_SCALE) * rate}


def identify_gyro_noise(residuals: Float[np.ndarray, "n 3"], rates: Float[np.ndarray, "n 3"]) -> GyroNoise:
    """Gyro error from its residuals.

    Parameters
    ----------
    residuals : (n, 3) float array
        Samples less what is expected of them, bias and scale error included, rad/s.
    rates : (n, 3) float array
        Body rates at the samples, rad/s.
    """
    relative = residuals / np.linalg.norm(rates, axis=1, keepdims=True)
    return GyroNoise(float(np.sqrt(np.mean(relative**2))), _correlation_time(relative))


def recorded_gyro_noise(
    stream: MeasurementStream, process: TorqueFreeProcess, noise: SensorNoise, options: InitialisationOptions
) -> tuple[GyroNoise, str]:
    """Error of a rate sensor from the whole recording, and its option."""
    sensor = sensor_of(stream.sensor)
    option, rates = sensor.identified_option, sensor.measured_rates(stream)
    assert option is not None
    assert rates is not None  # what is identified is an error of rates
    require_motion(len(rates))
    if rates.any() and (rates == rates[0]).all():
        raise InputError(
            f"the {sensor.name}'s rates never change, so its noise cannot be distinguished from a motion: the body is held at one "
            "rate or the sensor hangs; choose a part where the body tumbles (--segment), or another recording"
        )
    layout = process.layout.without_translation
    rotation = process if layout == process.layout else TorqueFreeProcess(layout, process.noise)
    whole = replace(options, epochs=WHOLE_RECORDING, share=1.0)
    timeline = build_timeline(MeasurementLog((stream,)), layout, replace(noise, **{option: FIRST_SCALE}))
    samples = MotionSamples(stream.time, rates=rates)
    try:
        fitted = initialise(rotation, timeline, samples, whole)
        found = identify_gyro_noise(*_residuals_and_rates(timeline, fitted))
    except NUMERICAL_ERRORS as error:
        raise _unidentified_error(sensor, reason(numerical(error))) from None
    if not np.isfinite(found.scale_std):
        raise _unidentified_error(sensor, "what is left of its rates is not finite")
    return found, option


def _residuals_and_rates(
    timeline: Timeline, fitted: InitialEstimate
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Residuals of a rate sensor's samples after a fit to its first epochs, and the body rates at them, rad/s."""
    (samples,) = by_sensor(timeline[: len(fitted.mean)])
    states, measured = fitted.mean[samples.epoch], samples.measurement
    residuals, _ = measured.model.innovations(states, measured.parameters, measured.values)
    return residuals, states[:, fitted.layout.mean_slice("w")]


def _correlation_time(residual: Float[np.ndarray, "n 3"]) -> float:
    """1 + 2 sum of the autocorrelation up to where it first reaches zero, in samples."""
    n = len(residual)
    products = np.array(
        [float(np.sum(residual[lag:] * residual[: n - lag])) for lag in range(max(n // 2, 1))]
    )
    if products[0] <= 0:
        return 1.0
    correlation = products / products[0]
    crossing = np.flatnonzero(correlation <= 0)
    last = int(crossing[0]) if crossing.size else len(correlation)
    return max(1.0, 1.0 + 2.0 * float(correlation[1:last].sum()))


def _unidentified_error(sensor: Sensor, why: str) -> InputError:
    options = " and ".join(f"sensors.{option.name}" for option in sensor_format(sensor.name).noise)
    return InputError(
        f"the {sensor.name}'s noise cannot be identified from the recording ({why}); state {options} in a config file"
    )


SMALLEST_SHARE_OF_DEFAULT: Final[float] = 1e-4
"""Of a noise option's default, the least level that is identified: no such sensor is better. Less is a simulation without
noise, whose residuals are those of rounding and of integration (1e-9 of a step) and identify no level."""


@dataclass(frozen=True)
class Unstated:
    """Noise that neither settings nor data set state.

    Attributes
    ----------
    options : Mapping[str, Mapping[str, tuple[int, ...]]]
        By option, the components of the innovation that it scales, by sensor.
    densities : tuple[str, ...]
        Names of the disturbances' densities.
    """

    options: Mapping[str, Mapping[str, tuple[int, ...]]]
    densities: tuple[str, ...]

    def __bool__(self) -> bool:
        return bool(self.options or self.densities)

    @classmethod
    def of_all(cls, log: MeasurementLog, noise: ProcessNoise) -> "Unstated":
        """All levels that a recording has, as if none were stated."""
        options: dict[str, dict[str, tuple[int, ...]]] = {}
        for stream in log.streams:
            for option, components in sensor_format(stream.sensor).levels.items():
                options.setdefault(option, {})[stream.sensor] = components
        return cls(options, tuple(name for name, psd in noise.densities.items() if psd > 0))


def smallest_level(option: str) -> float:
    """Level of a noise option below which none is identified, in its unit."""
    return SMALLEST_SHARE_OF_DEFAULT * noise_options()[option].default


AT_FLOOR: Final = 1.01
"""Times the smallest level that can be identified, below which an identified one is that smallest level."""


def is_smallest(level: VarianceComponent) -> bool:
    """Whether an identified level of a sensor is the smallest there is: its measurements show no noise."""
    return not level.is_density and level.value < AT_FLOOR * smallest_level(level.name)


def noise_model(problem: Problem, noise: SensorNoise, unstated: Unstated) -> NoiseModel | None:
    """The problem of some epochs with its unknown levels; None where it has none."""
    seen = (
        set() if problem.observations is None else {group.model.name for group in problem.observations.groups}
    )
    components = []
    for option, rows_of in unstated.options.items():
        rows = {
            k: innovation_rows(sensor.model, rows_of[sensor.model.name])
            for k, sensor in enumerate(problem.motion.sensors)
            if sensor.model.name in rows_of
        }
        rows = {k: own for k, own in rows.items() if own}
        if rows or seen & set(rows_of):
            value = getattr(noise, option)
            tracks = bool(seen & set(rows_of))
            components.append(ComponentRows(option, value, rows, tracks, smallest_level(option)))
    blocks = problem.layout.blocks
    densities = tuple(name for name in unstated.densities if DENSITIES[name].block in blocks)
    return NoiseModel(problem, tuple(components), densities) if components or densities else None


def innovation_rows(model: MeasurementModel, components: tuple[int, ...]) -> tuple[int, ...]:
    """Components of the innovation that a noise reaches.

    All of a camera are pixels; a row with more noises than innovations has the first.
    """
    every = tuple(range(model.dim))
    return every if sensor_format(model.name).has_landmarks else tuple(k for k in components if k in every)
