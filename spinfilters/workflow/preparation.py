"""A data set and settings made ready for any estimator: process, timeline, start."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.estimators.motion_evidence import MotionEvidence, evidence_from_gyro, evidence_from_poses
from spinfilters.estimators.start import StartOptions, StartReport, start_from_data
from spinfilters.estimators.timeline import SensorNoise, StereoView, Timeline, build_timeline
from spinfilters.evaluation.body import body_estimate
from spinfilters.logs.dataset import Dataset
from spinfilters.logs.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.perception.map_building import poses_without_map
from spinfilters.perception.track_poses import poses_with_map
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
    known_frames: whether the estimate's frames are the truth's (a known map, poses, or a simulated gyro).
    map_points: (k, 3) m in g, or None.   gyro_noise: identified, or None when it was stated.
    """

    dataset: Dataset
    process: TorqueFreeProcess
    timeline: Timeline
    noise: SensorNoise
    start: StartReport
    known_frames: bool
    map_points: Float[np.ndarray, "k 3"] | None
    gyro_noise: GyroNoise | None

    @property
    def start_end(self) -> float:
        """Time of the last frame that the start looked at, s."""
        return self.timeline[len(self.start.frames.mean) - 1].time


def prepare(dataset: Dataset, settings: Settings) -> Prepared:
    """Join a data set with models and smooth its first frames.

    Raises
    ------
    InputError: too few frames, no rotation, tracks that no pose can be found from.
    """
    log, poses, view, map_points = _measurements(dataset, settings)
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
    start = _long_enough_start(process, timeline, poses or log.stream("gyro"), settings.start)
    known = dataset.known_map is not None or dataset.kind == "pose"
    return Prepared(dataset, process, timeline, noise, start, known, map_points, gyro_noise)


def moments_std_of(start: StartReport) -> float:
    """Largest standard deviation of a principal moment at the end of a start, relative to the largest moment."""
    return float(np.max(body_estimate(start.belief).principal_moments_std))


def _long_enough_start(
    process: TorqueFreeProcess, timeline: Timeline, seen: MeasurementStream, options: StartOptions
) -> StartReport:
    """A start that looks at twice the frames until it knows the moments, or has looked at its share of the recording.

    A filter that linearises while the inertia is hardly known is over-confident ever after; the smoother of the start is not.
    """
    evidence_of = evidence_from_poses if seen.sensor == "pose" else evidence_from_gyro
    while True:
        frames = options.count(timeline)
        start = start_from_data(process, timeline, evidence_of(seen, frames), options)
        longer = replace(options, frames=2 * options.frames)
        if moments_std_of(start) <= DETERMINED_STD or longer.count(timeline) == frames:
            return start
        options = longer


def _measurements(
    dataset: Dataset, settings: Settings
) -> tuple[MeasurementLog, MeasurementStream | None, StereoView | None, np.ndarray | None]:
    """The log that the filters see, poses for the start, the stereo view, and the map."""
    log = dataset.log
    if "stereo" not in log.sensors:
        return log, log.stream("pose") if "pose" in log.sensors else None, None, None
    assert dataset.rig is not None
    calibration, pixel_std = dataset.rig.calibration, _noise(dataset, settings).pixel_std
    tracks = log.stream("stereo")
    if dataset.known_map is not None:
        poses = poses_with_map(tracks, dataset.known_map, calibration, pixel_std)
        return log, poses, StereoView(dataset.known_map, calibration), dataset.known_map.points
    poses, found = poses_without_map(tracks, calibration, pixel_std)
    others = tuple(stream for stream in log.streams if stream.sensor not in ("stereo", "pose"))
    return MeasurementLog((poses, *others)), poses, None, found.points


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
