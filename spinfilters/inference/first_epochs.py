"""Smoothed first epochs of a data set, from which all estimators continue: how many, and the noise that they identify."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from spinfilters.core.errors import NUMERICAL_ERRORS, InputError, numerical
from spinfilters.core.linear_algebra import normalised_square
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import ProcessModel
from spinfilters.filters.noise_levels import VarianceComponent
from spinfilters.filters.outlier_rejection import RobustOptions
from spinfilters.filters.square_root import triangular_factor
from spinfilters.filters.timeline import CameraView, SensorNoise, Timeline, build_timeline, run, times_of
from spinfilters.inference.identification import Identified, identify
from spinfilters.inference.identified_noise import Unstated, noise_model
from spinfilters.inference.initial_estimate import InitialEstimate, initialise, initialised_again
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import reason
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.sensor_format import sensor_format
from spinfilters.io.sensor_tables import require_motion
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.models.sensor import MotionSamples
from spinfilters.models.sensor_registry import sensor_of
from spinfilters.models.state_blocks import RATE
from spinfilters.models.state_layout import Gaussian, StateLayout
from spinfilters.settings.run_settings import InitialisationOptions
from spinfilters.smoother.landmark_factors import OBSERVATIONS_NEEDED
from spinfilters.smoother.mass_posterior import MassSampler, can_be_walked
from spinfilters.smoother.motion_factors import without_refused
from spinfilters.smoother.problem import problem_of

DETERMINED_STD = 0.12
"""Of a principal moment relative to the largest: what the first epochs must reach for filters to go on from them. On simulated
motions all starts below it were consistent, and half of those above it led to NEES of twice the degrees of freedom and more."""
LINEAR_STD, LINEAR_RATE_STD = 0.08, 0.02
"""Of the mass distribution (log second moments) and of the body rate relative to it, below which hardly anything is bent and no
filter is tried: simulated motions that went astray had begun beyond 0.1 or, with noisy sensors, beyond 0.04."""
LARGEST_DEPARTURE = 0.7
"""Of a filter from the smoother, in the length of the whole error in standard deviations: simulated filters below it kept a NEES of
their degrees of freedom to the end, and most of those beyond it did not."""
MOST_EPOCHS = 480
"""Up to which more seconds are looked at than `InitialisationOptions.duration`, where the motion is not known by then."""
BEYOND_SHARE, LARGEST_SHARE = 4 / 3, 0.8
"""Times its share of the recording, and of a recording, that an initialisation may have where filters cannot go on from less. On
the thesis' motion in noisy poses 60 % leaves moments uncertain by 0.12 to 0.3, and filters are off by up to 60 deviations; of 80 %
they are consistent."""

Make = Callable[[InitialisationOptions], InitialEstimate]
"""Makes an initialisation of a recording; nothing of landmarks after its last epoch is looked at."""


def long_enough_initialisation(
    process: ProcessModel, timeline: Timeline, make: Make, options: InitialisationOptions
) -> InitialEstimate:
    """An initialisation long enough for filters.

    The number of epochs is doubled until they can go on from it, or it has its share of the recording.

    Raises
    ------
    What ``make`` raises of the shortest start.
    """
    found = _check_moments(process, timeline, make, options)
    while not _is_enough(found):
        longer = _longer(options, timeline)
        if longer.count(timeline) == options.count(timeline):
            break
        options = longer
        try:
            found = _check_moments(process, timeline, make, options)
        except NUMERICAL_ERRORS:  # more epochs lead nowhere; the fewer did
            break
    return found


def beyond_share(
    process: ProcessModel,
    timeline: Timeline,
    make: Make,
    options: InitialisationOptions,
    found: InitialEstimate,
) -> InitialEstimate | None:
    """An initialisation of a third more epochs than its share.

    None where filters can go on from that of the share, or these determine the moments no better.

    Parameters
    ----------
    found : InitialEstimate
        The long enough initialisation with these options.
    """
    count = len(timeline)
    wider = min(BEYOND_SHARE * options.share, LARGEST_SHARE)
    if len(found.mean) < round(options.share * count) or wider <= options.share or _is_enough(found):
        return None
    span = timeline[-1].time - timeline[0].time
    longer = replace(options, epochs=count, share=wider, duration=max(span, options.duration))
    try:
        beyond = _check_moments(process, timeline, make, longer)
    except NUMERICAL_ERRORS:
        return None
    return beyond if _is_better(beyond, found) else None


def _is_better(beyond: InitialEstimate, found: InitialEstimate) -> bool:
    """Whether filters go on better from more epochs."""
    if beyond.moments_std > DETERMINED_STD:
        return False
    return found.moments_std > DETERMINED_STD or beyond.departure < found.departure


def departure_of(
    process: ProcessModel, timeline: Timeline, start: InitialEstimate, later: InitialEstimate
) -> float:
    """Distance of a filter from the smoother in the smoother's standard deviations.

    The filter has no gate: it takes in what the smoother does. A gross error that the smoother refuses is no linearisation's.

    Parameters
    ----------
    later : InitialEstimate
        Of more epochs; the filter goes on from ``start`` to its last. Infinite where the filter fails.
    """
    first, last = len(start.mean), len(later.mean)
    ungated = MultiplicativeEkf(process, RobustOptions(gate_probability=1.0))
    ungated.start(start.belief)
    taken_in = without_refused(timeline[:last], later.refused)
    history = run(ungated, timeline[first - 1].time, taken_in[first:])
    if history.has_failed:
        return np.inf
    return _length(later.belief, history.mean[-1])


def belief_beyond_tangent(process: ProcessModel, timeline: Timeline, start: InitialEstimate) -> Gaussian:
    """Belief at the end of an initialisation, wider by what its Gaussian lacks where filters depart from the smoother.

    The states that agree with the first epochs then lie along a curve, and the Gaussian follows its tangent. A filter keeps
    that for certain while its mean moves along the curve, so that it ends over-confident, above all without process noise. With
    the second derivatives c along the soft directions (`MassSampler.bends`) the mean square of the errors about the mean is

        P + 3/4 sum of c c'.

    Parameters
    ----------
    start : InitialEstimate
        Of the first epochs of the timeline.

    Returns
    -------
    Gaussian
        That of the estimate where filters do not depart from the smoother, or nothing can be computed.
    """
    count = len(start.mean)
    if not start.departure > LARGEST_DEPARTURE or start.has_landmarks or not np.isfinite(start.factor).all():
        return start.belief
    epochs = without_refused(timeline[:count], start.refused)
    problem = problem_of(process, epochs, start.ids, start.prior, OBSERVATIONS_NEEDED)
    if not can_be_walked(problem, count):
        return start.belief
    try:
        with np.errstate(all="ignore"):
            bends = MassSampler(problem).bends(start.mean)
    except NUMERICAL_ERRORS:
        return start.belief
    if not np.isfinite(bends).all():
        return start.belief
    rows = np.concatenate(
        [start.factor[-1], np.sqrt(0.75) * bends.T], axis=1
    )  # rows rows' = P + 3/4 sum of c c'
    return Gaussian(start.layout, start.mean[-1], triangular_factor(rows.T))


def _is_enough(found: InitialEstimate) -> bool:
    return found.moments_std <= DETERMINED_STD and found.departure <= LARGEST_DEPARTURE


def _longer(options: InitialisationOptions, timeline: Timeline) -> InitialisationOptions:
    """Twice the epochs, and where the seconds were the limit twice those, up to `MOST_EPOCHS`."""
    longer = replace(options, epochs=2 * options.epochs)
    if longer.count(timeline) > options.count(timeline) or options.count(timeline) >= MOST_EPOCHS:
        return longer
    return replace(longer, duration=2 * options.duration)


def _check_moments(
    process: ProcessModel, timeline: Timeline, make: Make, options: InitialisationOptions
) -> InitialEstimate:
    """An initialisation with the check of doubtful moments.

    A filter goes on from it where its moments would be enough and are not beyond doubt. With landmarks nothing is compared:
    which observations are believed differs between filter and smoother.
    """
    start = make(options)
    determined = is_bent(start.belief) and start.moments_std <= DETERMINED_STD
    count = len(start.mean)
    if not determined or start.has_landmarks or count == len(timeline):
        return start
    span = timeline[min(2 * count, len(timeline)) - 1].time - timeline[0].time
    ahead = replace(options, epochs=2 * count, share=1.0, duration=max(span, options.duration))
    try:
        later = make(ahead)
    except NUMERICAL_ERRORS:
        return start
    return replace(start, departure=departure_of(process, timeline, start, later))


def _length(belief: Gaussian, mean: np.ndarray) -> float:
    away = belief.layout.local(belief.mean, mean)
    return float(np.sqrt(normalised_square(away[np.newaxis], belief.factor[np.newaxis])[0]))


def is_bent(belief: Gaussian) -> bool:
    """Whether a belief is wide enough for a filter's linearisation to count; one that is not finite has no width."""
    if not np.isfinite(belief.factor).all():
        return False
    layout, rate = belief.layout, belief.mean[belief.layout.mean_slice(RATE.name)]
    masses, rates = (np.linalg.norm(belief.factor[layout.slice(b)], 2) for b in "sw")
    return bool(masses > LINEAR_STD or rates > LINEAR_RATE_STD * np.linalg.norm(rate))


LEADING_EPOCHS = 16
"""Of the sensor that shows most of a motion, in an initialisation, where there are faster sensors too."""
COMPARED_EPOCHS = 480
"""Of which two models of a motion are compared, or all of a shorter recording."""

GivenInitialisation = Callable[[StateLayout], InitialEstimate]
"""Gives the initialisation over a layout, in place of one that is made from data."""


@dataclass
class SampledEpochs:
    """Initial motion samples up to a time, s, that are known so far."""

    samples: MotionSamples | None = None
    end: float = -np.inf


@dataclass(frozen=True)
class FirstEpochs:
    """First epochs of a data set, with models and noise.

    Attributes
    ----------
    view : CameraView or None
        What rows of landmarks are measured against, None without any.
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
        before : InitialEstimate or None
            Of the same data at other noise, whose motion, map and associations are used again where they serve.
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
        sampled = SampledEpochs()

        def make(options: InitialisationOptions) -> InitialEstimate:
            """The initialisation with these options."""
            count = options.count(self.timeline)
            if count not in made:  # of twice the epochs both a filter is judged and a longer start made
                again = self._initialise_again(options, before)
                made[count] = again or self._initialise_from_measurements(options, sampled=sampled)
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
        start : InitialEstimate
            `smoothed` with these options.
        """
        if start.has_failed:
            return None
        options = self._with_leading_epochs(options)
        with np.errstate(all="ignore"):
            return beyond_share(
                self.process, self.timeline, self._initialise_from_measurements, options, start
            )

    def near(
        self, likely: InitialEstimate, options: InitialisationOptions, before: InitialEstimate | None = None
    ) -> InitialEstimate:
        """Smoothed first epochs, `COMPARED_EPOCHS` whatever filters need.

        Parameters
        ----------
        likely : InitialEstimate
            Of the same motion, whose mass distribution they are smoothed from.
        before : InitialEstimate or None
            See `smoothed`.
        """
        count = min(len(self.timeline), max(COMPARED_EPOCHS, len(likely.mean)))
        duration = max(options.duration, self._duration(count))
        options = replace(options, epochs=count, share=1.0, duration=duration)
        try:
            with np.errstate(all="ignore"):
                return self._initialise_again(options, before) or self._initialise_from_measurements(
                    options, likely
                )
        except NUMERICAL_ERRORS as error:
            return InitialEstimate.failed(self.process.layout, count, reason(error))

    def _initialise_again(
        self, options: InitialisationOptions, before: InitialEstimate | None
    ) -> InitialEstimate | None:
        return None if before is None else initialised_again(self.process, self.timeline, before, options)

    def _initialise_from_measurements(
        self,
        options: InitialisationOptions,
        likely: InitialEstimate | None = None,
        sampled: "SampledEpochs | None" = None,
    ) -> InitialEstimate:
        """From the measurements alone; nothing of landmarks after the last epoch is looked at."""
        end = self.timeline[options.count(self.timeline) - 1].time
        samples = self._samples_until(end, sampled or SampledEpochs())
        return initialise(self.process, self.timeline, samples, options, likely)

    def _samples_until(self, end: float, sampled: "SampledEpochs") -> MotionSamples:
        """Initial motion samples up to a time, s; where epochs stand by themselves, those of new ones join what is known."""
        leading = max(self.dataset.log.streams, key=_measure_motion)
        known, begin = sampled.samples, float(np.nextafter(sampled.end, np.inf))
        if known is None or end < begin or not sensor_of(leading.sensor).samples_each_epoch(self.view):
            begin = self.timeline[0].time
            streams = [
                stream.slice(begin, end) if sensor_format(stream.sensor).has_landmarks else stream
                for stream in self.dataset.log.streams
            ]
            samples = initial_samples([s for s in streams if s is not None], self.noise, self.view)
        else:
            samples, later = known, leading.slice(begin, end)
            if later is not None:
                with suppress(InputError):  # that no new epoch shows a pose
                    samples = known.joined(initial_samples([later], self.noise, self.view))
        sampled.samples, sampled.end = samples, end
        return samples

    def _duration(self, epochs: int) -> float:
        return self.timeline[epochs - 1].time - self.timeline[0].time

    def _with_leading_epochs(self, options: InitialisationOptions) -> InitialisationOptions:
        """The options with enough epochs to hold `LEADING_EPOCHS` of the most informative sensor.

        With a fast gyro the first epochs would otherwise hold one or two of a camera.
        """
        leading = max(self.dataset.log.streams, key=_measure_motion).epoch_times
        last = leading[min(LEADING_EPOCHS, len(leading)) - 1]
        count = int(np.searchsorted(times_of(self.timeline), last, "right"))
        return replace(options, epochs=max(options.epochs, count))


def initial_samples(
    streams: Sequence[MeasurementStream], noise: SensorNoise, view: CameraView | None
) -> MotionSamples:
    """Initial motion samples of the most informative stream: landmarks first, then places, attitudes and rates.

    Raises
    ------
    InputError
        Streams that do not show a motion, or show rates alone where others refer to frame i.
    """
    for stream in sorted(streams, key=_measure_motion, reverse=True):
        samples = sensor_of(stream.sensor).initial_motion(stream, noise, view)
        if samples is None:
            continue
        fixed = [s.sensor for s in streams if sensor_of(s.sensor).knows_frames(s)]
        if samples.attitude is None and fixed:
            raise InputError(
                f"{' and '.join(fixed)} measurements refer to frame i, and {stream.sensor} measurements do not show the attitude "
                "in it; give poses or attitudes too"
            )
        return samples
    raise InputError(
        f"{' and '.join(s.sensor for s in streams)} measurements do not determine the initial motion; "
        "give those of another sensor too"
    )


def _measure_motion(stream: MeasurementStream) -> tuple[bool, ...]:
    """Comparable measure of the motion that a stream shows."""
    sensor = sensor_of(stream.sensor)
    return sensor_format(stream.sensor).has_landmarks, sensor.sees_place, sensor.knows_frames(stream)


@dataclass(frozen=True)
class NoisyModels:
    """Models at some levels of noise, and the initialisation with them."""

    process: TorqueFreeProcess
    noise: SensorNoise
    timeline: Timeline
    start: InitialEstimate

    def levels(self, unstated: Unstated) -> dict[str, float]:
        """Variances and densities that the initialisation was made with."""
        levels = {name: getattr(self.noise, name) ** 2 for name in unstated.options}
        return levels | {name: getattr(self.process.noise, name) for name in unstated.densities}

    def identified(self, unstated: Unstated, from_residuals: bool) -> Identified | None:
        """Levels identified from the median residuals, or from those of the initialisation."""
        start = self.start
        if not start.has_states:
            return None
        epochs = self.timeline[: len(start.mean)]
        problem = problem_of(self.process, epochs, start.ids, start.prior, OBSERVATIONS_NEEDED)
        model = noise_model(problem, self.noise, unstated)
        if model is None:
            return None
        first = None if from_residuals else model.stated
        found = identify(model, start.mean, start.points, first)
        return found if found is not None and found.converged else None


@dataclass(frozen=True)
class Initialiser:
    """A log whose first epochs are smoothed with models at any levels of noise.

    Attributes
    ----------
    likely : InitialEstimate or None
        Estimate with which this one is compared, of epochs that depend on neither.
    """

    dataset: Dataset
    view: CameraView | None
    layout: StateLayout
    options: InitialisationOptions
    likely: InitialEstimate | None = None

    def at(
        self, process: TorqueFreeProcess, noise: SensorNoise, before: InitialEstimate | None = None
    ) -> NoisyModels:
        """The initialisation at this noise, from that at other noise where there is one."""
        timeline = build_timeline(self.dataset.log, self.layout, noise, self.view)
        require_motion(len(timeline))
        first = FirstEpochs(self.dataset, self.view, process, timeline, noise)
        if self.likely is not None:
            return NoisyModels(process, noise, timeline, first.near(self.likely, self.options, before))
        return NoisyModels(process, noise, timeline, first.smoothed(self.options, before))

    def beyond_share(self, made: NoisyModels) -> NoisyModels | None:
        """The models with a longer initialisation; None where filters need or get none."""
        if self.likely is not None:
            return None
        first = FirstEpochs(self.dataset, self.view, made.process, made.timeline, made.noise)
        start = first.beyond_share(self.options, made.start)
        return None if start is None else replace(made, start=start)


ROUNDS: Final[int] = 3
"""Initialisations at most: each linearises about what the noise of the one before made of the epochs."""
ALIKE: Final[float] = 0.2
"""Change of every ln variance below which the initialisation just made is the last."""
SAME_STATES: Final[float] = 0.3
"""Standard deviations of an epoch's whole state, within which two solutions are one."""
LONGER_ROUNDS: Final[int] = 2
"""Initialisations at most of more epochs than the share."""


def with_identified_noise(
    initialiser: Initialiser,
    process: TorqueFreeProcess,
    noise: SensorNoise,
    unstated: Unstated,
    rounds: int = ROUNDS,
) -> tuple[NoisyModels, tuple[VarianceComponent, ...]]:
    """The initialisation with the noise that its own epochs identify; without it where they identify none.

    The density of a disturbance is taken for its mean (`VarianceComponent.expected`), and covariances widen by what is not known of
    the levels (`Identified`).

    Parameters
    ----------
    process, noise : TorqueFreeProcess, SensorNoise
        At the levels of the first initialisation.
    unstated : Unstated
        Levels to be identified.
    rounds : int
        Initialisations at most; 2 where noise is nearly known before the first.
    """
    made, found = _with_levels(initialiser, initialiser.at(process, noise), unstated, rounds)
    longer = initialiser.beyond_share(made)
    if longer is not None:
        made, found = _with_levels(initialiser, longer, unstated, LONGER_ROUNDS)
    if found is None:
        return made, ()
    start = made.start
    if found.sensitivity.shape[1] == len(start.factor):  # else it has got other epochs with the levels
        made = replace(made, start=replace(start, factor=found.widened(start.factor)))
    return made, found.components


def _with_levels(
    initialiser: Initialiser, made: NoisyModels, unstated: Unstated, rounds: int
) -> tuple[NoisyModels, Identified | None]:
    """Repeat an initialisation with the noise levels that its epochs identify; None of the levels without any."""
    found = None
    for _ in range(rounds - 1 if unstated else 0):
        identified = made.identified(unstated, from_residuals=found is None)
        if identified is None:
            break
        before, found = made.levels(unstated), identified
        # process and sensors at the expected levels, and the first epochs smoothed again from the states of the identification
        densities = {each.name: each.expected for each in found.components if each.is_density}
        stds = {each.name: each.expected for each in found.components if not each.is_density}
        process = made.process.with_noise(replace(made.process.noise, **densities))
        made = initialiser.at(
            process, replace(made.noise, **stds), replace(made.start, mean=found.trajectory)
        )
        after = made.levels(unstated)
        are_alike = all(abs(np.log(after[name] / before[name])) < ALIKE for name in after)
        if _agrees_with_levels(made.start, found) or are_alike:
            break
    return made, found


def _agrees_with_levels(start: InitialEstimate, found: Identified) -> bool:
    """Whether an initialisation has kept the states with which its levels are the likeliest."""
    if found.trajectory.shape != start.mean.shape or not np.isfinite(start.factor).all():
        return False
    away = start.layout.local(start.mean, found.trajectory)
    return bool(normalised_square(away, start.factor).max() < SAME_STATES**2)
