"""A data set and settings made ready for any estimator: process, timeline, start."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from spinfilters.errors import NUMERICAL_ERRORS, InputError
from spinfilters.estimators.first_frames import FirstStatePrior, SmoothedFrames
from spinfilters.estimators.landmark_start.start import LandmarkStartReport, start_with_landmarks
from spinfilters.estimators.landmarks.belief import LandmarkBelief
from spinfilters.estimators.motion_evidence import MotionEvidence, evidence_from_gyro, evidence_from_poses
from spinfilters.estimators.start import StartOptions, StartReport, start_from_data
from spinfilters.estimators.timeline import SensorNoise, StereoView, Timeline, build_timeline, noise_level
from spinfilters.logs.dataset import Dataset
from spinfilters.logs.input_file import reason
from spinfilters.logs.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.models.process import THESIS_NOISE, ProcessNoise, TorqueFreeProcess
from spinfilters.perception.map_building import poses_without_map
from spinfilters.perception.track_poses import poses_with_map
from spinfilters.state.blocks.drag import DRAG
from spinfilters.state.blocks.gyro_bias import GYRO_BIAS
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.layout import FULL_BLOCKS, ROTATION_BLOCKS, StateLayout
from spinfilters.workflow.gyro_noise import FIRST_SCALE, GyroNoise, disturbance_psd, identify_gyro_noise
from spinfilters.workflow.settings import AUTO, Settings
from spinfilters.workflow.start_length import CheckedStart, long_enough_start

STATED_NOISE = {
    "gyro": {"gyro_noise_std"},
    "pose": {"pose_position_std", "pose_rotation_std"},
    "stereo": {"pixel_std"},
}
"""Settings that take the place of a sensor's covariances row by row."""
WHOLE_RECORDING = 400
"""Gyro samples, at most, from which the gyro's error is identified."""


@dataclass(frozen=True)
class Prepared:
    """What every estimator of a run shares.

    Attributes
    ----------
    timeline: all frames.   start: of which the first have been smoothed.
    belief: what every filter begins from at the end of the start, with landmarks where the map is not known.
    map_points: (k, 3) m in g: the known map or that of the start, or None.
    gyro_noise: identified, or None when it was stated.
    start_failure: why the first frames could not be smoothed, so that nothing of the start is finite; None where they could.
    departure: of a filter that goes on from the start, in standard deviations (`start_length.departure_of`).
    """

    dataset: Dataset
    process: TorqueFreeProcess
    timeline: Timeline
    noise: SensorNoise
    start: StartReport
    belief: Gaussian | LandmarkBelief
    map_points: Float[np.ndarray, "k 3"] | None
    gyro_noise: GyroNoise | None
    start_failure: str | None = None
    departure: float = 0.0

    @property
    def start_end(self) -> float:
        """Time of the last frame that the start looked at, s."""
        return self.timeline[len(self.start.frames.mean) - 1].time

    @property
    def observations(self) -> Int[np.ndarray, " n"]:
        """How many rows of the log each epoch has, those of landmarks that a known map lacks among them."""
        stamps, counts = np.unique(
            np.concatenate([stream.time for stream in self.dataset.log.streams]), return_counts=True
        )
        return counts[np.searchsorted(stamps, [frame.time for frame in self.timeline])]

    @property
    def known_frames(self) -> bool:
        """Whether the estimate's frames are the truth's."""
        return knows_frames(self.dataset)


def knows_frames(dataset: Dataset) -> bool:
    """Whether a data set tells frames i and g: by a known map or by poses."""
    return dataset.known_map is not None or dataset.kind == "pose"


def prepare(dataset: Dataset, settings: Settings) -> Prepared:
    """Join a data set with models and smooth its first frames.

    Raises
    ------
    InputError: too few frames, no rotation, tracks that no pose can be found from. The text names the data set.
    """
    with dataset.naming():
        return _prepared(dataset, settings)


def _prepared(dataset: Dataset, settings: Settings) -> Prepared:
    log, view = _log_with_noise(dataset.log, settings), _view(dataset)
    layout = _layout(log, settings)
    unknown_gyro = "gyro" in log.sensors and _gyro_is_unknown(log, dataset, settings)
    automatic = _disturbances(dataset, unknown_gyro)
    process = TorqueFreeProcess(layout, settings.process.noise(automatic), settings.process.tolerance)
    noise, gyro_noise = _noise(dataset, settings), None
    if "gyro" in log.sensors:
        process.require_steps(log.stream("gyro").time, log.stream("gyro").values)
    if unknown_gyro:
        gyro_noise = _identify(log, process, noise, settings.start)
        noise = replace(noise, gyro_scale_std=gyro_noise.scale_std)
    timeline = build_timeline(log, layout, noise, view)
    if len(timeline) < 5:
        raise InputError(f"{len(timeline)} frame(s) are too few for a motion; give at least 5")
    checked, failure = _start(replace(dataset, log=log), process, timeline, noise, settings.start)
    start = checked.report
    belief, points = start.belief, None if dataset.known_map is None else dataset.known_map.points
    if isinstance(start, LandmarkStartReport):
        belief, points = start.landmarks.belief(settings.landmarks), start.landmarks.points
    return Prepared(
        dataset, process, timeline, noise, start, belief, points, gyro_noise, failure, checked.departure
    )


def _layout(log: MeasurementLog, settings: Settings) -> StateLayout:
    """What the sensors can see of a state, with the constants that the settings ask for."""
    layout = StateLayout(ROTATION_BLOCKS if log.sensors == ("gyro",) else FULL_BLOCKS)
    if settings.process.drag:
        layout = layout.joined(DRAG)
    if "gyro" in log.sensors and settings.start.gyro_bias_std:
        layout = layout.joined(GYRO_BIAS)
    return layout


def _start(
    dataset: Dataset,
    process: TorqueFreeProcess,
    timeline: Timeline,
    noise: SensorNoise,
    options: StartOptions,
) -> tuple[CheckedStart, str | None]:
    """The smoothed first frames; where their numbers lead nowhere none of them is finite, and why."""
    try:
        with np.errstate(all="ignore"):  # what is not finite becomes a status
            make = _start_maker(dataset, process, timeline, noise)
            return long_enough_start(process, timeline, make, options), None
    except NUMERICAL_ERRORS as error:
        layout, count = process.layout, options.count(timeline)
        mean = np.full((count, layout.mean_dim), np.nan)
        factor = np.full((count, layout.error_dim, layout.error_dim), np.nan)
        frames = SmoothedFrames(mean, factor, np.nan, 0, 0, converged=False)
        prior = FirstStatePrior(mean[0], np.full(layout.error_dim, np.nan))
        return CheckedStart(StartReport(layout, frames, np.nan, np.nan, prior)), reason(error)


def _view(dataset: Dataset) -> StereoView | None:
    """What stereo rows are measured against, None without any."""
    if "stereo" not in dataset.log.sensors:
        return None
    assert dataset.rig is not None
    return StereoView(dataset.known_map, dataset.rig.calibration)


def _start_maker(
    dataset: Dataset, process: TorqueFreeProcess, timeline: Timeline, noise: SensorNoise
) -> Callable[[StartOptions], StartReport]:
    """What makes a start of this data set: from a gyro, from poses, from sightings of a known map or of an unknown one."""
    log = dataset.log
    if "stereo" not in log.sensors:
        return lambda options: start_from_data(
            process, timeline, _checked(process, _sensor_evidence(log, timeline, options)), options
        )
    assert dataset.rig is not None
    tracks, calibration = log.stream("stereo"), dataset.rig.calibration
    if dataset.known_map is None:
        return lambda options: _start_of_tracks(
            process, timeline, tracks, (calibration, noise.pixel_std), options
        )
    known = dataset.known_map

    def make(options: StartOptions) -> StartReport:
        first = _first_tracks(tracks, timeline, options)
        poses = poses_with_map(first, known, calibration, noise_level(first, noise.pixel_std))
        evidence = _checked(process, evidence_from_poses(poses, options.count(timeline)))
        return start_from_data(process, timeline, evidence, options)

    return make


def _sensor_evidence(log: MeasurementLog, timeline: Timeline, options: StartOptions) -> MotionEvidence:
    frames = options.count(timeline)
    if "pose" in log.sensors:
        return evidence_from_poses(log.stream("pose"), frames)
    return evidence_from_gyro(log.stream("gyro"), frames)


def _checked(process: TorqueFreeProcess, evidence: MotionEvidence) -> MotionEvidence:
    """The evidence of a motion that can be integrated."""
    process.require_steps(evidence.time, evidence.rates)
    return evidence


def _start_of_tracks(
    process: TorqueFreeProcess,
    timeline: Timeline,
    tracks: MeasurementStream,
    camera: tuple[np.ndarray, float],
    options: StartOptions,
) -> StartReport:
    """A start whose landmarks nobody knew: nothing after its last frame is looked at."""
    (calibration, pixel_std), first = camera, _first_tracks(tracks, timeline, options)
    poses, found = poses_without_map(first, calibration, noise_level(first, pixel_std))
    evidence = _checked(process, evidence_from_poses(poses, options.count(timeline)))
    return start_with_landmarks(process, timeline, evidence, found, options)


def _first_tracks(tracks: MeasurementStream, timeline: Timeline, options: StartOptions) -> MeasurementStream:
    """Tracks of the epochs that an initialisation looks at."""
    first = tracks.slice(timeline[0].time, timeline[options.count(timeline) - 1].time)
    assert first is not None
    return first


def _noise(dataset: Dataset, settings: Settings) -> SensorNoise:
    """Settings first, then the data set's own, then the defaults."""
    chosen: dict[str, float] = {}
    for name in vars(settings.sensors):
        stated = getattr(settings.sensors, name)
        own = getattr(dataset.options, name, None)
        value = own if stated == AUTO else stated
        if value is not None:
            chosen[name] = float(value)
    return SensorNoise(**chosen)


def _disturbances(dataset: Dataset, unknown_gyro: bool) -> ProcessNoise:
    """The data set's own, then what is known of gyros of unknown error, then the thesis'."""
    force_psd, torque_psd = dataset.options.force_psd, dataset.options.torque_psd
    if torque_psd is None and unknown_gyro:
        torque_psd = disturbance_psd(dataset.log.stream("gyro"))
    return ProcessNoise(force_psd or THESIS_NOISE.force_psd, torque_psd or THESIS_NOISE.torque_psd)


def _log_with_noise(log: MeasurementLog, settings: Settings) -> MeasurementLog:
    """The log without those covariances of its rows in whose place the settings state a number."""
    stated = {name for name in vars(settings.sensors) if getattr(settings.sensors, name) != AUTO}
    streams = (replace(s, covariance=None) if stated & STATED_NOISE[s.sensor] else s for s in log.streams)
    return MeasurementLog(tuple(streams))


def _gyro_is_unknown(log: MeasurementLog, dataset: Dataset, settings: Settings) -> bool:
    told = dataset.options.gyro_noise_std is not None or log.stream("gyro").covariance is not None
    return settings.sensors.gyro_scale_std == AUTO and not told


def _identify(
    log: MeasurementLog, process: TorqueFreeProcess, noise: SensorNoise, options: StartOptions
) -> GyroNoise:
    gyro = log.stream("gyro")
    layout = process.layout.without_translation
    rotation = process if layout == process.layout else TorqueFreeProcess(layout, process.noise)
    whole = replace(options, frames=WHOLE_RECORDING, share=1.0)
    timeline = build_timeline(MeasurementLog((gyro,)), layout, replace(noise, gyro_scale_std=FIRST_SCALE))
    evidence: MotionEvidence = evidence_from_gyro(gyro, whole.count(timeline))
    try:
        found = identify_gyro_noise(gyro, start_from_data(rotation, timeline, evidence, whole))
    except NUMERICAL_ERRORS as error:
        raise _unidentified(reason(error)) from None
    if not np.isfinite(found.scale_std):
        raise _unidentified("what is left of its rates is not finite")
    return found


def _unidentified(why: str) -> InputError:
    return InputError(
        f"the gyro's noise cannot be identified from the recording ({why}); state sensors.gyro_noise_std and "
        "sensors.gyro_scale_std in a config file"
    )
