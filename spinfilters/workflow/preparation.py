"""A data set and settings made ready for any estimator: process, timeline, start."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.estimators.landmark_start.start import LandmarkStartReport, start_with_landmarks
from spinfilters.estimators.landmarks.belief import LandmarkBelief
from spinfilters.estimators.motion_evidence import MotionEvidence, evidence_from_gyro, evidence_from_poses
from spinfilters.estimators.start import StartOptions, StartReport, start_from_data
from spinfilters.estimators.timeline import SensorNoise, StereoView, Timeline, build_timeline
from spinfilters.evaluation.body import body_estimate
from spinfilters.logs.dataset import Dataset
from spinfilters.logs.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.perception.map_building import poses_without_map
from spinfilters.perception.track_poses import poses_with_map
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.layout import FULL_BLOCKS, ROTATION_BLOCKS, StateLayout
from spinfilters.workflow.gyro_noise import FIRST_SCALE, GyroNoise, disturbance_psd, identify_gyro_noise
from spinfilters.workflow.settings import AUTO, Settings

DETERMINED_STD = 0.12
"""Of a principal moment relative to the largest: what the first frames must reach for filters to go on from them. On simulated
motions all starts below it were consistent, and half of those above it led to NEES of twice the degrees of freedom and more."""
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
    """

    dataset: Dataset
    process: TorqueFreeProcess
    timeline: Timeline
    noise: SensorNoise
    start: StartReport
    belief: Gaussian | LandmarkBelief
    map_points: Float[np.ndarray, "k 3"] | None
    gyro_noise: GyroNoise | None

    @property
    def start_end(self) -> float:
        """Time of the last frame that the start looked at, s."""
        return self.timeline[len(self.start.frames.mean) - 1].time

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
    InputError: too few frames, no rotation, tracks that no pose can be found from.
    """
    log, view = dataset.log, _view(dataset)
    blocks = ROTATION_BLOCKS if log.sensors == ("gyro",) else FULL_BLOCKS
    layout = StateLayout((*blocks, "d") if settings.process.drag else blocks)
    unknown_gyro = "gyro" in log.sensors and _gyro_is_unknown(dataset, settings)
    torque_psd = disturbance_psd(log.stream("gyro")) if unknown_gyro else ProcessNoise.torque_psd
    process = TorqueFreeProcess(layout, settings.process.noise(torque_psd), settings.process.tolerance)
    noise, gyro_noise = _noise(dataset, settings), None
    if unknown_gyro:
        gyro_noise = _identify(log, process, noise, settings.start)
        noise = replace(noise, gyro_scale_std=gyro_noise.scale_std)
    timeline = build_timeline(log, layout, noise, view)
    if len(timeline) < 5:
        raise InputError(
            f"{dataset.description or dataset.path} has {len(timeline)} frame(s); give at least 5"
        )
    make = _start_maker(dataset, process, timeline, noise)
    start = _long_enough_start(timeline, make, settings.start)
    belief, points = start.belief, None if dataset.known_map is None else dataset.known_map.points
    if isinstance(start, LandmarkStartReport):
        belief, points = start.landmarks.belief(settings.landmarks), start.landmarks.points
    return Prepared(dataset, process, timeline, noise, start, belief, points, gyro_noise)


def moments_std_of(start: StartReport) -> float:
    """Largest standard deviation of a principal moment at the end of a start, relative to the largest moment."""
    return float(np.max(body_estimate(start.belief).principal_moments_std))


def _long_enough_start(
    timeline: Timeline, make: Callable[[StartOptions], StartReport], options: StartOptions
) -> StartReport:
    """A start that looks at twice the frames until it knows the moments, or has looked at its share of the recording.

    A filter that linearises while the inertia is hardly known is over-confident ever after; the smoother of the start is not.
    """
    while True:
        frames = options.count(timeline)
        start = make(options)
        longer = replace(options, frames=2 * options.frames)
        if moments_std_of(start) <= DETERMINED_STD or longer.count(timeline) == frames:
            return start
        options = longer


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
            process, timeline, _sensor_evidence(log, timeline, options), options
        )
    assert dataset.rig is not None
    tracks, calibration = log.stream("stereo"), dataset.rig.calibration
    if dataset.known_map is None:
        return lambda options: _start_of_tracks(
            process, timeline, tracks, (calibration, noise.pixel_std), options
        )
    poses = poses_with_map(tracks, dataset.known_map, calibration, noise.pixel_std)
    return lambda options: start_from_data(
        process, timeline, evidence_from_poses(poses, options.count(timeline)), options
    )


def _sensor_evidence(log: MeasurementLog, timeline: Timeline, options: StartOptions) -> MotionEvidence:
    frames = options.count(timeline)
    if "pose" in log.sensors:
        return evidence_from_poses(log.stream("pose"), frames)
    return evidence_from_gyro(log.stream("gyro"), frames)


def _start_of_tracks(
    process: TorqueFreeProcess,
    timeline: Timeline,
    tracks: MeasurementStream,
    camera: tuple[np.ndarray, float],
    options: StartOptions,
) -> StartReport:
    """A start whose landmarks nobody knew: nothing after its last frame is looked at."""
    frames = options.count(timeline)
    first = tracks.slice(timeline[0].time, timeline[frames - 1].time)
    assert first is not None
    poses, found = poses_without_map(first, *camera)
    return start_with_landmarks(process, timeline, evidence_from_poses(poses, frames), found, options)


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


def _gyro_is_unknown(dataset: Dataset, settings: Settings) -> bool:
    return settings.sensors.gyro_scale_std == AUTO and dataset.options.gyro_noise_std is None


def _identify(
    log: MeasurementLog, process: TorqueFreeProcess, noise: SensorNoise, options: StartOptions
) -> GyroNoise:
    gyro = log.stream("gyro")
    layout = StateLayout(tuple(b for b in process.layout.blocks if b in (*ROTATION_BLOCKS, "d")))
    rotation = process if layout == process.layout else TorqueFreeProcess(layout, process.noise)
    whole = replace(options, frames=WHOLE_RECORDING, share=1.0)
    timeline = build_timeline(MeasurementLog((gyro,)), layout, replace(noise, gyro_scale_std=FIRST_SCALE))
    evidence: MotionEvidence = evidence_from_gyro(gyro, whole.count(timeline))
    return identify_gyro_noise(gyro, start_from_data(rotation, timeline, evidence, whole))
