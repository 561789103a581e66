"""Smoothed first epochs of a data set, from which all estimators continue."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from spinfilters.data.dataset import Dataset
from spinfilters.data.input_file import reason
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.data.sensor_files import require_motion
from spinfilters.data.sensor_format import sensor_format
from spinfilters.errors import NUMERICAL_ERRORS, InputError, numerical
from spinfilters.estimators.initialisation.initial_estimate import InitialEstimate
from spinfilters.estimators.initialisation.initialiser import initialise, initialised_again
from spinfilters.estimators.initialisation.options import InitialisationOptions
from spinfilters.estimators.timeline import CameraView, SensorNoise, Timeline, build_timeline, times_of
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.pipeline.identified_noise import NoisyModels
from spinfilters.pipeline.initialisation_length import beyond_share, long_enough_initialisation
from spinfilters.sensors.sensor import MotionSamples
from spinfilters.sensors.sensor_registry import sensor_of
from spinfilters.settings.run_settings import Settings
from spinfilters.state.layout import StateLayout

LEADING_EPOCHS = 16
"""Of the sensor that tells most of a motion, in an initialisation, where faster sensors stand beside it."""
COMPARED_EPOCHS = 480
"""Of which two models of a motion are compared, or all of a shorter recording."""

GivenInitialisation = Callable[[StateLayout], InitialEstimate]
"""Gives the initialisation over a layout, in place of one that is made from data."""


@dataclass(frozen=True)
class FirstEpochs:
    """First epochs of a data set, with models and noise.

    Attributes
    ----------
    view: what rows of landmarks are measured against, None without any.
    """

    dataset: Dataset
    view: CameraView | None
    process: TorqueFreeProcess
    timeline: Timeline
    noise: SensorNoise

    def smoothed(
        self, options: InitialisationOptions, before: InitialEstimate | None = None
    ) -> InitialEstimate:
        """Smoothed first epochs, as many as filters need.

        A failed smoothing leaves none of them finite, and its status says why.

        Parameters
        ----------
        before: of the same data at other noise, whose motion, map and associations are used again where they serve.
        """
        options = self._with_leading_epochs(options)
        if before is not None:
            count = len(before.mean)
            options = replace(
                options,
                epochs=max(options.epochs, count),
                share=max(options.share, count / len(self.timeline)),
                duration=max(options.duration, self._duration(count)),
            )

        made: dict[int, InitialEstimate] = {}

        def make(options: InitialisationOptions) -> InitialEstimate:
            """The initialisation with these options."""
            count = options.count(self.timeline)
            if count not in made:  # of twice the epochs both a filter is judged and a longer start made
                made[count] = self._again(options, before) or self._made(options)
            return made[count]

        try:
            with np.errstate(all="ignore"):  # what is not finite becomes a status
                return long_enough_initialisation(self.process, self.timeline, make, options)
        except NUMERICAL_ERRORS as error:
            return InitialEstimate.failed(
                self.process.layout, options.count(self.timeline), reason(numerical(error))
            )

    def beyond_share(self, options: InitialisationOptions, start: InitialEstimate) -> InitialEstimate | None:
        """Smoothed epochs beyond their share.

        None where filters need no more, or cannot go on from these either.

        Parameters
        ----------
        start: `smoothed` with these options.
        """
        if start.has_failed:
            return None
        options = self._with_leading_epochs(options)
        with np.errstate(all="ignore"):
            return beyond_share(self.process, self.timeline, self._made, options, start)

    def near(
        self, likely: InitialEstimate, options: InitialisationOptions, before: InitialEstimate | None = None
    ) -> InitialEstimate:
        """Smoothed first epochs, `COMPARED_EPOCHS` whatever filters need.

        Parameters
        ----------
        likely: of the same motion, whose mass distribution they are smoothed from.   before: see `smoothed`.
        """
        count = min(len(self.timeline), max(COMPARED_EPOCHS, len(likely.mean)))
        duration = max(options.duration, self._duration(count))
        options = replace(options, epochs=count, share=1.0, duration=duration)
        try:
            with np.errstate(all="ignore"):
                return self._again(options, before) or self._made(options, likely)
        except NUMERICAL_ERRORS as error:
            return InitialEstimate.failed(self.process.layout, count, reason(error))

    def _again(
        self, options: InitialisationOptions, before: InitialEstimate | None
    ) -> InitialEstimate | None:
        return None if before is None else initialised_again(self.process, self.timeline, before, options)

    def _made(self, options: InitialisationOptions, likely: InitialEstimate | None = None) -> InitialEstimate:
        """From the measurements alone; nothing of landmarks after the last epoch is looked at."""
        end = self.timeline[options.count(self.timeline) - 1].time
        streams = [
            stream.slice(self.timeline[0].time, end) if sensor_format(stream.sensor).has_landmarks else stream
            for stream in self.dataset.log.streams
        ]
        samples = initial_samples([s for s in streams if s is not None], self.noise, self.view)
        return initialise(self.process, self.timeline, samples, options, likely)

    def _duration(self, epochs: int) -> float:
        return self.timeline[epochs - 1].time - self.timeline[0].time

    def _with_leading_epochs(self, options: InitialisationOptions) -> InitialisationOptions:
        """The options with enough leading epochs of the main sensor.

        `LEADING_EPOCHS` of the sensor that tells most of the motion.
        Beside a fast gyro the first epochs would hold none or two of a camera.
        """
        leading = max(self.dataset.log.streams, key=_told).epoch_times
        last = leading[min(LEADING_EPOCHS, len(leading)) - 1]
        count = int(np.searchsorted(times_of(self.timeline), last, "right"))
        return replace(options, epochs=max(options.epochs, count))


@dataclass(frozen=True)
class BoundLog:
    """A log to be bound to models, with an initialisation made or given.

    Attributes
    ----------
    likely: estimate beside which this one is made, of epochs that do not depend on either.
    """

    dataset: Dataset
    view: CameraView | None
    layout: StateLayout
    settings: Settings
    initial: GivenInitialisation | None
    likely: InitialEstimate | None

    def __call__(
        self, process: TorqueFreeProcess, noise: SensorNoise, before: InitialEstimate | None
    ) -> NoisyModels:
        timeline = build_timeline(self.dataset.log, self.layout, noise, self.view)
        require_motion(len(timeline))
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


def initial_samples(
    streams: Sequence[MeasurementStream], noise: SensorNoise, view: CameraView | None
) -> MotionSamples:
    """Initial motion samples of the most informative stream.

    Landmarks are asked before places, these before attitudes, these before rates.

    Raises
    ------
    InputError: streams that do not tell a motion.
    """
    for stream in sorted(streams, key=_told, reverse=True):
        samples = sensor_of(stream.sensor).initial_motion(stream, noise, view)
        if samples is not None:
            return samples
    raise InputError(
        f"{' and '.join(s.sensor for s in streams)} measurements do not tell how the body moves at first; "
        "give those of another sensor too"
    )


def _told(stream: MeasurementStream) -> tuple[bool, ...]:
    """Comparable measure of the motion that a stream tells."""
    sensor = sensor_of(stream.sensor)
    return sensor_format(stream.sensor).has_landmarks, sensor.sees_place, sensor.tells_frames
