"""Noise as settings and data sets state it, and which of it nobody states."""

from dataclasses import replace

from spinfilters.data.dataset import Dataset
from spinfilters.data.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.data.sensor_format import noise_options, sensor_format
from spinfilters.estimators.identification.components import DISTURBANCES
from spinfilters.estimators.timeline import SensorNoise
from spinfilters.models.process import THESIS_NOISE, ProcessNoise
from spinfilters.pipeline.gyro_noise import disturbance_psd
from spinfilters.pipeline.identified_noise import Unstated
from spinfilters.sensors.sensor import sensor_of
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
    """Disturbances: the data set's own, else of the kind, else the thesis'.

    Rate sensors of unknown error have what is known of these.
    """
    force_psd, torque_psd = dataset.options.force_psd, dataset.options.torque_psd
    if torque_psd is None and unknown is not None:
        torque_psd = disturbance_psd(unknown)
    return ProcessNoise(force_psd or THESIS_NOISE.force_psd, torque_psd or THESIS_NOISE.torque_psd)


def log_with_noise(log: MeasurementLog, settings: Settings) -> MeasurementLog:
    """The log without those covariances of its rows in whose place the settings state a number."""

    def is_stated(stream: MeasurementStream) -> bool:
        """Whether a noise level is stated."""
        options = [each for each in sensor_format(stream.sensor).noise if each.components is not None]
        return any(_setting(settings, option.name) != AUTO for option in options)

    streams = (replace(s, covariance=None) if is_stated(s) else s for s in log.streams)
    return MeasurementLog(tuple(streams))


def levels_of_rows(log: MeasurementLog, dataset: Dataset) -> dict[str, float]:
    """Noise options that rows state for themselves, with their variances' inflation.

    Parameters
    ----------
    log: with the noise of the settings (`log_with_noise`), which may replace that of rows.
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
    """The stream whose sensor's error is to be identified.

    None where there is none or somebody states it.
    """
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
        for name in DISTURBANCES
        if getattr(dataset.options, name) is None and getattr(settings.process, name) == AUTO
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
        for option in sensor_format(stream.sensor).noise:
            if option.components is not None and option.name in names:
                options.setdefault(option.name, {})[stream.sensor] = option.components
    densities = tuple(name for name in DISTURBANCES if name in names)
    return Unstated(options, () if unknown is not None else densities)
