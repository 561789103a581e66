"""A data set and settings made ready for any estimator: process, timeline, initialisation."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from spinfilters.data.dataset import Dataset
from spinfilters.data.input_file import reason
from spinfilters.data.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.data.sensor_files import EPOCHS_OF_MOTION, too_few_epochs
from spinfilters.data.sensor_format import sensor_format
from spinfilters.errors import NUMERICAL_ERRORS, InputError, numerical
from spinfilters.estimators.initialisation.initial_estimate import InitialEstimate
from spinfilters.estimators.initialisation.initialiser import initialise
from spinfilters.estimators.initialisation.options import InitialisationOptions
from spinfilters.estimators.timeline import CameraView, SensorNoise, Timeline, build_timeline
from spinfilters.geometry.camera_trajectory import CameraTrajectory
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.pipeline.acceleration_state import with_acceleration_if_told
from spinfilters.pipeline.considered_calibration import considered_deviations
from spinfilters.pipeline.first_epochs import FirstEpochs
from spinfilters.pipeline.gyro_noise import FIRST_SCALE, GyroNoise, identify_gyro_noise, white_level
from spinfilters.pipeline.identified_noise import (
    ROUNDS,
    NoisyModels,
    with_identified_noise,
)
from spinfilters.pipeline.setup import NOTHING_SOUGHT, Setup
from spinfilters.pipeline.stated_noise import (
    disturbances,
    levels_of_rows,
    log_with_noise,
    sensor_noise,
    sensor_of_unknown_noise,
    unstated_names,
    unstated_noise,
)
from spinfilters.sensors.sensor import MotionSamples, Sensor, sensor_of, sensors_in
from spinfilters.settings.run_settings import AUTO, Settings
from spinfilters.state.blocks.acceleration import ACCELERATION
from spinfilters.state.blocks.drag import DRAG
from spinfilters.state.blocks.torque import TORQUE
from spinfilters.state.layout import FULL_BLOCKS, ROTATION_BLOCKS, StateLayout

WHOLE_RECORDING = 400
"""Samples, at most, from which the error of a rate sensor is identified."""
BESIDE_ROUNDS = 2
"""Initialisations at most from the noise of another setup."""

Given = Callable[[StateLayout], InitialEstimate]
"""Gives the initialisation over a layout, in place of one that is made from data."""


def prepare(dataset: Dataset, settings: Settings, initial: Given | None = None) -> Setup:
    """Join a data set with models and smooth its first epochs.

    Parameters
    ----------
    initial: gives the initialisation where the first epochs are not to be smoothed.

    Raises
    ------
    InputError: too few epochs, no rotation, tracks that no pose can be found from. The text names the data set.
    """
    with dataset.naming():
        if initial is not None or settings.process.gravity != AUTO:
            return _setup(dataset, settings, initial)
        return with_acceleration_if_told(lambda own, beside: _setup(dataset, own, None, beside), settings)


def _setup(dataset: Dataset, settings: Settings, initial: Given | None, beside: Setup | None = None) -> Setup:
    """Beside another setup from its noise and body."""
    log = log_with_noise(dataset.log, settings)
    layout = _layout(log, settings)
    stated = (
        _stated(dataset, log, layout, settings) if beside is None else _as_beside(beside, layout, settings)
    )
    silent = NOTHING_SOUGHT
    likely = None if beside is None else beside.initial
    binding = _Binding(replace(dataset, log=log), camera_view(dataset), layout, settings, initial, likely)
    if initial is not None:
        made, components = binding(stated.process, stated.noise, None), ()
    else:
        silent = unstated_noise(log, dataset, settings, stated.unknown) if beside is None else beside.sought
        rounds = ROUNDS if beside is None else BESIDE_ROUNDS
        made, components = with_identified_noise(binding, stated.process, stated.noise, silent, rounds)
    known = None if dataset.known_map is None else dataset.known_map.points
    return Setup(
        *(dataset, log, made.process, made.timeline, made.noise, made.start),
        belief=made.start.joint_belief(settings.landmarks),
        map_points=made.start.points if made.start.has_landmarks else known,
        gyro_noise=stated.gyro_noise,
        identified=components,
        unstated=unstated_names(dataset, settings),
        sought=silent,
        is_given=initial is not None,
        calibration=considered_deviations(dataset, settings, layout),
        inflation=levels_of_rows(log, dataset),
    )


@dataclass(frozen=True)
class _StatedModels:
    """Process and noise before the initialisation.

    Attributes
    ----------
    gyro_noise: correlated error of a gyro, identified from its whole recording.   unknown: the stream that it is of.
    """

    process: TorqueFreeProcess
    noise: SensorNoise
    gyro_noise: GyroNoise | None = None
    unknown: MeasurementStream | None = None


def _stated(dataset: Dataset, log: MeasurementLog, layout: StateLayout, settings: Settings) -> _StatedModels:
    unknown = sensor_of_unknown_noise(log, dataset, settings)
    automatic = disturbances(dataset, unknown)
    process = TorqueFreeProcess(layout, settings.process.noise(automatic), settings.process.tolerance)
    for stream in log.streams:
        rates = sensor_of(stream.sensor).measured_rates(stream)
        if rates is not None:
            process.require_steps(stream.time, rates)
    noise = sensor_noise(dataset, settings)
    if unknown is None:
        return _StatedModels(process, noise)
    found, option = _identify(unknown, process, noise, settings.initialisation)
    if found.is_white:
        return _StatedModels(process, replace(noise, **white_level(unknown, found)))
    return _StatedModels(process, replace(noise, **{option: found.scale_std}), found, unknown)


def _as_beside(beside: Setup, layout: StateLayout, settings: Settings) -> _StatedModels:
    """Noise of another setup of the recording."""
    process = TorqueFreeProcess(layout, beside.process.noise, settings.process.tolerance)
    return _StatedModels(process, beside.noise, beside.gyro_noise)


@dataclass(frozen=True)
class _Binding:
    """A log bound to models, with the initialisation that follows from them or is given.

    Attributes
    ----------
    likely: estimate beside which this one is made, of epochs that do not depend on either.
    """

    dataset: Dataset
    view: CameraView | None
    layout: StateLayout
    settings: Settings
    initial: Given | None
    likely: InitialEstimate | None

    def __call__(
        self, process: TorqueFreeProcess, noise: SensorNoise, before: InitialEstimate | None
    ) -> NoisyModels:
        timeline = build_timeline(self.dataset.log, self.layout, noise, self.view)
        _require_epochs(len(timeline))
        if self.initial is not None:
            return NoisyModels(process, noise, timeline, self.initial(self.layout))
        first = self._first(process, noise, timeline)
        options = self.settings.initialisation
        if self.likely is not None:
            return NoisyModels(process, noise, timeline, first.near(self.likely, options, before))
        return NoisyModels(process, noise, timeline, first.smoothed(options, before))

    def beyond_share(self, made: NoisyModels) -> NoisyModels | None:
        """The models with a longer initialisation; None where filters need or get none."""
        if self.likely is not None:
            return None
        first = self._first(made.process, made.noise, made.timeline)
        start = first.beyond_share(self.settings.initialisation, made.start)
        return None if start is None else replace(made, start=start)

    def _first(self, process: TorqueFreeProcess, noise: SensorNoise, timeline: Timeline) -> FirstEpochs:
        return FirstEpochs(self.dataset, self.view, process, timeline, noise)


def _layout(log: MeasurementLog, settings: Settings) -> StateLayout:
    """Layout of what the sensors observe, with the constants that the settings ask for."""
    sensors = sensors_in(log)
    layout = StateLayout(FULL_BLOCKS if any(sensor.sees_place for sensor in sensors) else ROTATION_BLOCKS)
    if settings.process.drag:
        layout = layout.joined(DRAG)
    if settings.process.gravity is True and layout.translates:
        layout = layout.joined(ACCELERATION)
    if settings.process.body_torque:
        layout = layout.joined(TORQUE)
    for block in (block for sensor in sensors for block in sensor.error_blocks):
        if settings.initialisation.states_prior(block):
            layout = layout.joined(block)
    return layout


def camera_view(dataset: Dataset) -> CameraView | None:
    """Map and calibration that landmark rows are measured against; None without any."""
    if dataset.rig is None:
        return None
    return CameraView(dataset.known_map, dataset.rig.calibration, CameraTrajectory.of(dataset.inspector))


def _identify(
    stream: MeasurementStream, process: TorqueFreeProcess, noise: SensorNoise, options: InitialisationOptions
) -> tuple[GyroNoise, str]:
    """Error of a rate sensor from the whole recording, and its option."""
    sensor = sensor_of(stream.sensor)
    option, rates = sensor.identified_option, sensor.measured_rates(stream)
    assert option is not None
    assert rates is not None  # what is identified is an error of rates
    _require_epochs(len(rates))
    if rates.any() and (rates == rates[0]).all():
        raise InputError(
            f"the {sensor.name}'s rates never change, so nothing tells its noise from a motion: the body is held at one rate or "
            "the sensor hangs; choose a part where the body tumbles (--segment), or another recording"
        )
    layout = process.layout.without_translation
    rotation = process if layout == process.layout else TorqueFreeProcess(layout, process.noise)
    whole = replace(options, epochs=WHOLE_RECORDING, share=1.0)
    timeline = build_timeline(MeasurementLog((stream,)), layout, replace(noise, **{option: FIRST_SCALE}))
    samples = MotionSamples(stream.time, rates=rates)
    try:
        found = identify_gyro_noise(stream, initialise(rotation, timeline, samples, whole))
    except NUMERICAL_ERRORS as error:
        raise _unidentified(sensor, reason(numerical(error))) from None
    if not np.isfinite(found.scale_std):
        raise _unidentified(sensor, "what is left of its rates is not finite")
    return found, option


def _require_epochs(count: int) -> None:
    if count < EPOCHS_OF_MOTION:
        raise InputError(too_few_epochs(count))


def _unidentified(sensor: Sensor, why: str) -> InputError:
    options = " and ".join(f"sensors.{option.name}" for option in sensor_format(sensor.name).noise)
    return InputError(
        f"the {sensor.name}'s noise cannot be identified from the recording ({why}); state {options} in a config file"
    )
