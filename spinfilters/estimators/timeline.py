"""The one place where a measurement log meets models: frames of measurements in the order of time."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import overload

import numpy as np
from jaxtyping import Float, Int

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import Measurement
from spinfilters.logs.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.logs.track_files import KnownMap
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.sensor_noise import NoiseLevel, SensorNoiseModel, noise_model, noise_of_rows
from spinfilters.models.sensors.gyro import Gyro, gyro_parameters
from spinfilters.models.sensors.pose import Pose, pose_parameters
from spinfilters.models.sensors.stereo_landmark import StereoLandmark, stereo_parameters
from spinfilters.state.layout import StateLayout


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviations of the sensors whose stream has no covariances of its rows; see each sensor for its model.

    Attributes
    ----------
    gyro_noise_std: rad/s.   gyro_scale_std: relative to |w|.
    pixel_std: px.
    pose_position_std: m.   pose_rotation_std: rad.
    """

    gyro_noise_std: float = 0.005
    gyro_scale_std: float = 0.0
    pixel_std: float = 1.0
    pose_position_std: float = 0.01
    pose_rotation_std: float = 0.01

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            smallest = 0.0 if name == "gyro_scale_std" else np.finfo(float).tiny
            if not (np.isfinite(value) and value >= smallest):
                raise InputError(f"{name} is {value}; give a positive, finite standard deviation")


@dataclass(frozen=True)
class StereoView:
    """What stereo rows are measured against: landmarks in frame g and the calibration (fx, fy, cx, cy px, baseline m).

    Without a known map the landmarks are left to the estimators: measurements then carry their ids.
    """

    known_map: KnownMap | None
    calibration: Float[np.ndarray, " 5"]


@dataclass(frozen=True, slots=True)
class Frame:
    """Everything measured at one instant (s)."""

    time: float
    measurements: tuple[Measurement, ...]


Timeline = Sequence[Frame]
"""Frames in the order of time."""


@dataclass(frozen=True, eq=False)
class SensorTimeline:
    """All measurements of one sensor, and which of them belong to each frame.

    Attributes
    ----------
    every: all values as if they were measured at once.   first, end: (k,) frame k holds the values from first to before end.
    """

    every: Measurement
    first: Int[np.ndarray, " k"]
    end: Int[np.ndarray, " k"]

    def measured(self, frame: int) -> list[Measurement]:
        """The measurement of a frame, none where the sensor measured nothing then."""
        every, rows = self.every, slice(int(self.first[frame]), int(self.end[frame]))
        if rows.start == rows.stop:
            return []
        ids = None if every.ids is None else every.ids[rows]
        return [Measurement(every.model, every.values[rows], every.parameters[rows], ids)]


@dataclass(frozen=True, eq=False)
class LogTimeline(Sequence[Frame]):
    """Frames of a log, made when they are asked for: a long recording stays a few arrays.

    Attributes
    ----------
    time: (k,) s.   sensors: in the order in which each frame takes them in.
    """

    time: Float[np.ndarray, " k"]
    sensors: tuple[SensorTimeline, ...]

    def __len__(self) -> int:
        return len(self.time)

    @overload
    def __getitem__(self, index: int) -> Frame: ...

    @overload
    def __getitem__(self, index: slice) -> "LogTimeline": ...

    def __getitem__(self, index: int | slice) -> "Frame | LogTimeline":
        if isinstance(index, slice):
            parts = (replace(part, first=part.first[index], end=part.end[index]) for part in self.sensors)
            return LogTimeline(self.time[index], tuple(parts))
        return Frame(float(self.time[index]), tuple(m for part in self.sensors for m in part.measured(index)))


def times_of(frames: Timeline) -> Float[np.ndarray, " k"]:
    """Times of frames, s."""
    return np.fromiter((frame.time for frame in frames), float, len(frames))


def build_timeline(
    log: MeasurementLog, layout: StateLayout, noise: SensorNoise, view: StereoView | None = None
) -> Timeline:
    """Frames of a log over a state layout; sensors that measure at the same stamp share a frame.

    Stereo rows whose landmark is not in a known map are left out.

    Raises
    ------
    InputError: stereo rows without a view, or a log without any usable measurement.
    """
    joined = [_joined(stream, layout, noise, view) for stream in log.streams]
    time = np.unique(np.concatenate([own for _, own in joined]))
    if not len(time):
        raise InputError(
            "the log holds no usable measurement; check that landmark ids of the tracks and of the map agree"
        )
    ends = [np.searchsorted(own, time, "right") for _, own in joined]
    parts = [
        SensorTimeline(every, np.concatenate([[0], end[:-1]]), end)
        for (every, _), end in zip(joined, ends, strict=True)
    ]
    return LogTimeline(time, tuple(parts))


def _joined(
    stream: MeasurementStream, layout: StateLayout, noise: SensorNoise, view: StereoView | None
) -> tuple[Measurement, np.ndarray]:
    """All rows of a stream as if they were measured at once, and their times."""
    count = len(stream.time)
    if stream.sensor == "gyro":
        level = noise_level(stream, noise.gyro_noise_std)
        parameters = gyro_parameters(count, level, noise.gyro_scale_std)
        return Measurement(
            _model(Gyro, layout, noise_model(level, 3)), stream.values, parameters
        ), stream.time
    if stream.sensor == "pose":
        parameters = pose_parameters(_pose_covariance(stream, noise))
        return Measurement(_model(Pose, layout), stream.values, parameters), stream.time
    if view is None or stream.ids is None:
        raise InputError("stereo tracks need a calibration here; give the view they were taken with")
    level = noise_level(stream, noise.pixel_std)
    model = _model(StereoLandmark, layout, noise_model(level, 3))
    if view.known_map is None:
        parameters = stereo_parameters(np.zeros((count, 3)), view.calibration, level)
        return Measurement(model, stream.values, parameters, stream.ids), stream.time
    landmarks = view.known_map
    row = np.clip(np.searchsorted(landmarks.ids, stream.ids), 0, len(landmarks.ids) - 1)
    known = landmarks.ids[row] == stream.ids
    points = landmarks.points[row[known]]
    parameters = stereo_parameters(points, view.calibration, noise_of_rows(level, known))
    return Measurement(model, stream.values[known], parameters), stream.time[known]


@cache
def _model(kind: type[MeasurementModel], layout: StateLayout, *noise: SensorNoiseModel) -> MeasurementModel:
    """The sensor's model over a layout, made once in a process: its expressions take longer to build than many smoothers."""
    return kind(layout, *noise)


def noise_level(stream: MeasurementStream, std: float) -> NoiseLevel:
    """The rows' own covariances, or without any this standard deviation."""
    return std if stream.covariance is None else stream.covariance


def _pose_covariance(stream: MeasurementStream, noise: SensorNoise) -> Float[np.ndarray, "n 6 6"]:
    if stream.covariance is not None:
        return stream.covariance
    std = np.repeat([noise.pose_position_std, noise.pose_rotation_std], 3)
    return np.tile(np.diag(std**2), (len(stream.time), 1, 1))
