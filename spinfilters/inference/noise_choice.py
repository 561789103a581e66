"""Which noise a run uses: stated by settings or data set, else identified, or adapted by its filters."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from spinfilters.filters.noise_levels import NoiseScale, VarianceComponent, raised_logarithm
from spinfilters.filters.timeline import SensorNoise
from spinfilters.inference.identified_noise import (
    GyroNoise,
    Unstated,
    disturbance_psd,
    recorded_gyro_noise,
    white_level,
)
from spinfilters.inference.setup import Setup
from spinfilters.io.consider_parameter import ConsideredDeviation, consider_parameters
from spinfilters.io.dataset import Dataset
from spinfilters.io.disturbances import DENSITIES, WHITE_TORQUE
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.io.sensor_format import noise_options, sensor_format
from spinfilters.models.process import THESIS_NOISE, ProcessNoise, TorqueFreeProcess
from spinfilters.models.sensor_registry import sensor_of
from spinfilters.models.state_layout import StateLayout
from spinfilters.settings.run_settings import AUTO, Settings


def sensor_noise(dataset: Dataset, settings: Settings) -> SensorNoise:
    """Settings first, then the data set's own, then the defaults."""
    chosen: dict[str, float] = {}
    for name in noise_options():
        stated = _setting(settings, name)
        value = dataset.options.sensor_noise.get(name) if stated == AUTO else stated
        if value is not None:
            chosen[name] = float(value)
    return SensorNoise(chosen)


def _setting(settings: Settings, option: str) -> float | str:
    """The setting of a noise option.

    A plug-in that came after the settings were built is "auto".
    """
    return getattr(settings.sensors, option, AUTO)


def disturbances(dataset: Dataset, unknown: MeasurementStream | None) -> ProcessNoise:
    """Disturbance densities of the data set, else those of a rate sensor of unknown noise, else the thesis'."""
    of_rates = {} if unknown is None else {WHITE_TORQUE.option: disturbance_psd(unknown)}
    return replace(THESIS_NOISE, **{**of_rates, **dataset.options.densities})


LEAST_STEP: Final = 1e-9
"""Deviation of position (m) and attitude (rad) that a density stated as zero adds in an interval. The covariance of a step must not
be singular; with ten times less, throws at 300 epochs a second fail by rounding."""


def least_density(log: MeasurementLog) -> float:
    """Density in place of one that is stated as zero: variance q h^3 / 3 of a median interval h is that of `LEAST_STEP`."""
    time = np.unique(np.concatenate([stream.time for stream in log.streams]))
    return 3 * LEAST_STEP**2 / float(np.median(np.diff(time))) ** 3 if len(time) > 1 else LEAST_STEP**2


def _regular(noise: ProcessNoise, log: MeasurementLog) -> ProcessNoise:
    """Densities without zeros."""
    if all(noise.densities.values()):
        return noise
    least = least_density(log)
    return ProcessNoise(**{name: psd or least for name, psd in noise.densities.items()})


def log_with_noise(log: MeasurementLog, settings: Settings) -> MeasurementLog:
    """The log without those covariances of its rows in whose place the settings state a number."""

    def is_stated(stream: MeasurementStream) -> bool:
        """Whether a noise level is stated."""
        return any(_setting(settings, option) != AUTO for option in sensor_format(stream.sensor).levels)

    streams = (replace(s, covariance=None) if is_stated(s) else s for s in log.streams)
    return MeasurementLog(tuple(streams))


def levels_of_rows(log: MeasurementLog, dataset: Dataset) -> dict[str, float]:
    """Noise options that rows state for themselves, with their variances' inflation.

    Parameters
    ----------
    log : MeasurementLog
        With the noise of the settings (`log_with_noise`), which may replace that of rows.
    """
    rows = [stream for stream in log.streams if stream.covariance is not None]
    return {
        option.name: dataset.options.covariance_inflation
        for stream in rows
        for option in sensor_format(stream.sensor).noise
    }


def sensor_of_unknown_noise(
    log: MeasurementLog, dataset: Dataset, settings: Settings
) -> MeasurementStream | None:
    """The stream whose sensor noise is to be identified; None where there is none or its noise is stated."""
    for stream in log.streams:
        option = sensor_of(stream.sensor).identified_option
        names = {each.name for each in sensor_format(stream.sensor).noise}
        told = names - unstated_names(dataset, settings) or stream.covariance is not None
        if option is not None and not told:
            return stream
    return None


def unstated_names(dataset: Dataset, settings: Settings) -> frozenset[str]:
    """Noise options and densities that neither the data set nor the settings state."""
    options = {
        name
        for name in noise_options()
        if name not in dataset.options.sensor_noise and _setting(settings, name) == AUTO
    }
    densities = {
        name
        for name in DENSITIES
        if name not in dataset.options.densities and getattr(settings.process, name) == AUTO
    }
    return frozenset(options | densities)


def unstated_noise(
    log: MeasurementLog, dataset: Dataset, settings: Settings, unknown: MeasurementStream | None
) -> Unstated:
    """Noise that is to be identified.

    That of rate sensors of unknown error is, by `identify_gyro_noise`, already.
    """
    options: dict[str, dict[str, tuple[int, ...]]] = {}
    names = unstated_names(dataset, settings)
    for stream in log.streams:
        if stream.covariance is not None or unknown is stream:
            continue
        for option, components in sensor_format(stream.sensor).levels.items():
            if option in names:
                options.setdefault(option, {})[stream.sensor] = components
    densities = tuple(name for name in DENSITIES if name in names)
    return Unstated(options, () if unknown is not None else densities)


@dataclass(frozen=True)
class StatedModels:
    """Process and noise before the initialisation.

    Attributes
    ----------
    gyro_noise : GyroNoise or None
        Correlated error of a gyro, identified from its whole recording.
    unknown : MeasurementStream or None
        The stream that it is of.
    """

    process: TorqueFreeProcess
    noise: SensorNoise
    gyro_noise: GyroNoise | None = None
    unknown: MeasurementStream | None = None


def stated_models(
    dataset: Dataset, log: MeasurementLog, layout: StateLayout, settings: Settings
) -> StatedModels:
    """Process and noise of a data set whose log has the noise of the settings (`log_with_noise`)."""
    unknown = sensor_of_unknown_noise(log, dataset, settings)
    automatic = disturbances(dataset, unknown)
    densities = _regular(settings.process.noise(automatic), log)
    process = TorqueFreeProcess(layout, densities, settings.process.tolerance)
    for stream in log.streams:
        rates = sensor_of(stream.sensor).measured_rates(stream)
        if rates is not None:
            process.require_steps(stream.time, rates)
    noise = sensor_noise(dataset, settings)
    if unknown is None:
        return StatedModels(process, noise)
    found, option = recorded_gyro_noise(unknown, process, noise, settings.initialisation)
    if found.is_white or found.is_noise_free:
        return StatedModels(process, replace(noise, **white_level(unknown, found)))
    return StatedModels(process, replace(noise, **{option: found.scale_std}), found, unknown)


STATED, PRIOR = "stated", "prior"


def considered_deviations(
    dataset: Dataset, settings: Settings, layout: StateLayout
) -> tuple[ConsideredDeviation, ...]:
    """Considered deviations of the sensors and the clock.

    Numbers that the state holds have none. Some may be zero.
    """
    found = []
    for name, parameter in consider_parameters().items():
        if (
            not parameter.concerns(dataset.log.sensors, dataset.inspector is not None)
            or parameter.block in layout.blocks
        ):
            continue
        stated = getattr(settings.calibration, name, AUTO)  # of a plug-in that came after the settings
        told = dataset.options.calibration.get(name) if stated == AUTO else float(stated)
        std = parameter.default if told is None else told
        found.append(ConsideredDeviation(parameter, std, PRIOR if told is None else STATED))
    return tuple(found)


def identified_scales(setup: Setup) -> dict[str, NoiseScale]:
    """Scales that the initialisation has identified, by source.

    The most probable level over that of the process and the sensors, with the information 2 / var that it rests on. A sensor has
    one scale, and none where a part of its noise is stated.
    """
    found = {each.name: each for each in setup.identified}
    scales = {}
    for source, options in _sources(setup).items():
        if all(name in found for name in options):
            information = sum(2 / found[name].log_std ** 2 for name in options)
            share = found[options[0]].share
            raised = sum(
                raised_logarithm(found[name].log_std ** 2, share)
                for name in options
                if found[name].is_density
            )
            scales[source] = NoiseScale(-raised, information, share)
    return scales


def adapted_levels(setup: Setup, level: Callable[[str], NoiseScale]) -> tuple[VarianceComponent, ...]:
    """Noise levels after a filter's adaptation."""
    first, sources = identified_scales(setup), _sources(setup)
    levels = []
    for each in setup.identified:
        source = next((s for s, options in sources.items() if each.name in options and s in first), None)
        if source is None:
            levels.append(each)
            continue
        before, after = first[source], level(source)
        share = before.information / after.information
        levels.append(each.scaled(after.logarithm - before.logarithm, share**0.5))
    return tuple(levels)


def _sources(setup: Setup) -> dict[str, tuple[str, ...]]:
    """Options of every source of noise that may adapt."""
    sources: dict[str, tuple[str, ...]] = {
        f"process.{DENSITIES[name].name}": (name,) for name in setup.sought.densities
    }
    for stream in setup.dataset.log.streams:
        options = tuple(sensor_format(stream.sensor).levels)
        if options and all(stream.sensor in setup.sought.options.get(name, ()) for name in options):
            sources[f"sensor.{stream.sensor}"] = options
    return sources
