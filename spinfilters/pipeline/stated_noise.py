"""Models and noise as settings and data sets state them, and which noise nobody states."""

from dataclasses import dataclass, replace

from spinfilters.data.dataset import Dataset
from spinfilters.data.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.data.sensor_format import noise_options, sensor_format
from spinfilters.estimators.identification.components import DISTURBANCES
from spinfilters.estimators.timeline import SensorNoise
from spinfilters.models.process import THESIS_NOISE, ProcessNoise, TorqueFreeProcess
from spinfilters.pipeline.gyro_noise import GyroNoise, disturbance_psd, recorded_gyro_noise, white_level
from spinfilters.pipeline.identified_noise import Unstated
from spinfilters.pipeline.setup import Setup
from spinfilters.sensors.sensor_registry import sensor_of, sensors_in
from spinfilters.settings.run_settings import AUTO, LINEAR, Settings
from spinfilters.state.blocks.acceleration import ACCELERATION
from spinfilters.state.blocks.drag import DRAG
from spinfilters.state.blocks.linear_drag import LINEAR_DRAG
from spinfilters.state.blocks.rotor import ROTOR
from spinfilters.state.blocks.torque import TORQUE
from spinfilters.state.layout import FULL_BLOCKS, ROTATION_BLOCKS, StateLayout


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


def layout_of(log: MeasurementLog, settings: Settings) -> StateLayout:
    """Layout of what the sensors observe, with the constants that the settings ask for."""
    sensors = sensors_in(log)
    layout = StateLayout(FULL_BLOCKS if any(sensor.sees_place for sensor in sensors) else ROTATION_BLOCKS)
    # "auto" has been decided where epochs are smoothed, and is quadratic where they are not
    if settings.process.drag:
        layout = layout.joined(LINEAR_DRAG if settings.process.drag == LINEAR else DRAG)
    if settings.process.gravity is True and layout.translates:
        layout = layout.joined(ACCELERATION)
    if settings.process.body_torque:
        layout = layout.joined(TORQUE)
    if settings.process.rotor:
        layout = layout.joined(ROTOR)
    for block in (block for sensor in sensors for block in sensor.error_blocks):
        if settings.initialisation.states_prior(block):
            layout = layout.joined(block)
    return layout


@dataclass(frozen=True)
class StatedModels:
    """Process and noise before the initialisation.

    Attributes
    ----------
    gyro_noise: correlated error of a gyro, identified from its whole recording.   unknown: the stream that it is of.
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
    process = TorqueFreeProcess(layout, settings.process.noise(automatic), settings.process.tolerance)
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


def models_beside(beside: Setup, layout: StateLayout, settings: Settings) -> StatedModels:
    """Process and noise of another setup of the recording, over a layout."""
    process = TorqueFreeProcess(layout, beside.process.noise, settings.process.tolerance)
    return StatedModels(process, beside.noise, beside.gyro_noise)
