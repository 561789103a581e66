"""Measurements of sensors as time-stamped arrays, independent of any estimator.

Every producer (images, lidar, gyro files, simulation) writes a `MeasurementLog`; every estimator reads one.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.errors import InputError, RowError, ShapeError
from spinfilters.core.linear_algebra import is_definite
from spinfilters.io.sensor_format import SensorFormat, sensor_called, sensor_format

QUATERNION_NORM_TOLERANCE: Final[float] = 1e-3
"""Largest | |q| - 1 | that is taken as rounding: the four decimals that many tools print give up to 1e-4."""
_UNIT_ROUNDING = (
    4.0 * np.finfo(np.float64).eps
)  # a norm this near 1 is left alone, so that reading twice changes nothing

_ROWS = 4096  # covariances that are factored at once
_ASYMMETRY = (
    1e-9  # of a covariance, per product of standard deviations: what the rounding of an inverse leaves
)


@dataclass(frozen=True, eq=False)
class MeasurementStream:
    """Measurements of one sensor in order of time. The arrays are read-only copies.

    Parameters
    ----------
    sensor : str
        Name of a sensor of the registry (`spinfilters.models.sensor_registry`), or that of its kind of data sets, such as
        "stereo-tracks"; the stream has the sensor's own name.
    time : Float[np.ndarray, ' n']
        s, any origin, possibly irregular; strictly increasing, but non-decreasing for sensors with many rows an
        epoch.
    values : Float[np.ndarray, 'n m']
        (n, columns) as the sensor's `SensorFormat` says; unit quaternions are normalised.
    ids : Int[np.ndarray, ' n'] | None
        Landmark of every row (sensors of landmarks only, and there required); no landmark twice at one time.
    covariance : Float[np.ndarray, 'n k k'] | None
        Of every row, positive definite, squared units of the innovation; None where one value holds for all
        (`DatasetOptions`).

    Raises
    ------
    InputError
        Unknown sensor.
    RowError
        A row that is not finite, out of order, without a unit quaternion or a positive definite covariance.
    ShapeError
        Arrays of other shapes.
    """

    sensor: str
    time: Float[np.ndarray, " n"]
    values: Float[np.ndarray, "n m"]
    ids: Int[np.ndarray, " n"] | None = None
    covariance: Float[np.ndarray, "n k k"] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "sensor", sensor_called(self.sensor))
        form = sensor_format(self.sensor)
        freeze_arrays(self, ("time", "values", "covariance"))
        freeze_arrays(self, ("ids",), np.int64)
        _check_shapes(self, form)
        _check_values(self, form)
        if form.quaternion is not None:
            unit, where = self.values.copy(), np.s_[:, form.quaternion : form.quaternion + 4]
            unit[where] = normalised(unit[where])
            unit.setflags(write=False)
            object.__setattr__(self, "values", unit)

    def __len__(self) -> int:
        return len(self.time)

    @property
    def epoch_times(self) -> Float[np.ndarray, " f"]:
        """The distinct time stamps, s."""
        return self.time[self.epoch_offsets[:-1]]

    @property
    def epoch_offsets(self) -> Int[np.ndarray, " offsets"]:
        """Rows at which the time stamp changes: epoch k is rows offsets[k] to offsets[k + 1]."""
        changes = np.flatnonzero(np.diff(self.time)) + 1
        return np.concatenate([[0], changes, [len(self.time)]]).astype(np.int64)

    def slice(self, start: float, end: float) -> "MeasurementStream | None":
        """The rows with start <= time <= end (s), or None when there are none."""
        first, last = np.searchsorted(self.time, start, "left"), np.searchsorted(self.time, end, "right")
        return self.take(np.arange(first, last)) if first < last else None

    def take(
        self,
        rows: Int[np.ndarray, " k"] | Bool[np.ndarray, " n"],
        time: Float[np.ndarray, " k"] | None = None,
    ) -> "MeasurementStream":
        """These rows, under their own stamps (s) or others. InputError: as for any stream."""
        ids = None if self.ids is None else self.ids[rows]
        covariance = None if self.covariance is None else self.covariance[rows]
        time = self.time[rows] if time is None else time
        return MeasurementStream(self.sensor, time, self.values[rows], ids, covariance)


@dataclass(frozen=True, eq=False)
class MeasurementLog:
    """Streams of different sensors on one clock; their time stamps may interleave.

    Raises
    ------
    InputError
        No stream, or two streams of one sensor.
    """

    streams: tuple[MeasurementStream, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "streams", tuple(self.streams))
        if not self.streams:
            raise InputError("a measurement log holds no stream; give it at least one")
        if len(set(self.sensors)) < len(self.streams):
            raise InputError(
                f"a measurement log holds {', '.join(self.sensors)}; join the streams of one sensor"
            )

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors, in the order of the streams."""
        return tuple(stream.sensor for stream in self.streams)

    @property
    def start(self) -> float:
        """Time of the first measurement of any sensor, s."""
        return float(min(stream.time[0] for stream in self.streams))

    @property
    def end(self) -> float:
        """Time of the last measurement of any sensor, s."""
        return float(max(stream.time[-1] for stream in self.streams))

    @property
    def times(self) -> Float[np.ndarray, " f"]:
        """Distinct time stamps of all sensors together, increasing, s."""
        return np.unique(np.concatenate([stream.time for stream in self.streams]))

    def stream(self, name: str) -> MeasurementStream:
        """The stream of a sensor, by any of its names, such as "stereo-tracks". InputError when the log has none."""
        sensor = sensor_called(name)
        for stream in self.streams:
            if stream.sensor == sensor:
                return stream
        raise InputError(
            f"the log has no {name!r} measurements, only {', '.join(self.sensors)}; choose one of these"
        )

    def slice(self, start: float, end: float) -> "MeasurementLog":
        """The measurements with start <= time <= end (s). InputError when there are none."""
        kept = [stream.slice(start, end) for stream in self.streams]
        streams = tuple(stream for stream in kept if stream is not None)
        if not streams:
            raise InputError(
                f"no measurement between {start} s and {end} s; the log runs from {self.start} s to "
                f"{self.end} s"
            )
        return MeasurementLog(streams)


_LARGEST_KEY = 1 << 62  # of whole numbers that are sorted


def require_order(name: str, time: Float[np.ndarray, " n"], repeats: bool = False) -> None:
    """Require times (s) that increase, or that do not decrease where they may repeat. RowError: the first that does not."""
    step = np.diff(time)
    rows = np.flatnonzero(step < 0.0 if repeats else step <= 0.0)
    if not rows.size:
        return
    row = int(rows[0]) + 1
    before, after = float(time[row - 1]), float(time[row])
    if before == after:
        raise RowError(name, row, f"time {after!r} s occurs twice; keep one line of each time")
    cure = "correct the wrong one of the two, or sort the lines by time"
    raise RowError(name, row, f"time {after!r} s follows {before!r} s: it runs backwards; {cure}")


def require_distinct_landmarks(
    name: str, time: Float[np.ndarray, " n"] | None, ids: Int[np.ndarray, " n"]
) -> None:
    """Require no landmark twice at one time, or none twice at all where there are no times. RowError: the first repetition."""
    times = np.zeros(len(ids)) if time is None else time
    if not _may_repeat(times, ids):
        return
    order = np.lexsort((ids, times))
    same = (np.diff(times[order]) == 0.0) & (np.diff(ids[order]) == 0)
    if same.any():
        row = int(order[1:][same].min())
        when = "" if time is None else f" at {float(time[row])!r} s"
        raise RowError(name, row, f"landmark {ids[row]} occurs twice{when}; keep one line")


def _may_repeat(time: Float[np.ndarray, " n"], ids: Int[np.ndarray, " n"]) -> bool:
    """Whether a pair of time and id may stand twice."""
    if not len(ids):
        return False
    # one whole number for each pair: epochs and ids, counted from 0, as two digits
    first, last = int(ids.min()), int(ids.max())
    epoch = np.cumsum(np.diff(time, prepend=time[0]) != 0.0)
    span = last - first + 1
    if span * (int(epoch[-1]) + 1) >= _LARGEST_KEY:
        return True
    keys = epoch * span + (ids - first)
    if (keys[1:] > keys[:-1]).all():  # in order already, as most producers write them: nothing need be sorted
        return False
    keys.sort()
    return bool((keys[1:] == keys[:-1]).any())


def require_unit_quaternions(name: str, quaternion: Float[np.ndarray, "n 4"]) -> None:
    """Require norms of 1 within `QUATERNION_NORM_TOLERANCE`. RowError: the first quaternion of another."""
    with np.errstate(over="ignore"):  # a number of 300 digits is not unit either
        norm = np.linalg.norm(quaternion, axis=1)
    rows = np.flatnonzero(np.abs(norm - 1.0) > QUATERNION_NORM_TOLERANCE)
    if rows.size:
        row = int(rows[0])
        raise RowError(
            name,
            row,
            f"quaternion {quaternion[row].tolist()} has norm {norm[row]:.6g}, not 1 as a unit quaternion; "
            "correct or delete the line",
        )


def _require_covariances(name: str, covariance: Float[np.ndarray, "n k k"]) -> None:
    """Require finite, symmetric and positive definite matrices. RowError: the first that is not."""
    if (covariance == covariance[:1]).all():  # of one and the same the first speaks for all
        covariance = covariance[:1]
    finite = np.isfinite(covariance).all(axis=(1, 2))
    if not finite.all():
        raise RowError(name, int(np.argmin(finite)), "the covariance is not finite; leave out that line")
    std = np.sqrt(np.abs(np.diagonal(covariance, axis1=1, axis2=2)))
    asymmetry = np.abs(covariance - covariance.transpose(0, 2, 1))
    symmetric = (asymmetry <= _ASYMMETRY * std[:, :, None] * std[:, None, :]).all(axis=(1, 2))
    if not symmetric.all():
        raise RowError(name, int(np.argmin(symmetric)), "the covariance is not symmetric; give (P + P') / 2")
    for start in range(0, len(covariance), _ROWS):  # a good table needs a call for thousands of rows
        if not is_definite(covariance[start : start + _ROWS]):
            rows = range(start, min(start + _ROWS, len(covariance)))
            row = next(row for row in rows if not is_definite(covariance[row]))
            raise RowError(
                name, row, "the covariance is not positive definite; give every component a variance"
            )


def normalised(quaternion: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
    """Unit quaternions; rows that are unit to rounding keep their bits."""
    norm = np.linalg.norm(quaternion, axis=1, keepdims=True)
    return np.where(np.abs(norm - 1.0) <= _UNIT_ROUNDING, quaternion, quaternion / norm)


def freeze_arrays(instance: object, names: tuple[str, ...], dtype: type[np.generic] = np.float64) -> None:
    """Replace fields of a frozen dataclass by read-only copies of that type; None stays None."""
    for name in names:
        if getattr(instance, name) is not None:
            array = np.array(getattr(instance, name), dtype=dtype)
            array.setflags(write=False)
            object.__setattr__(instance, name, array)


def _check_shapes(stream: MeasurementStream, form: SensorFormat) -> None:
    columns, dimension = len(form.columns), form.dimension
    rows = len(stream.time) if stream.time.ndim == 1 else -1
    if rows < 1:
        raise ShapeError(
            f"{stream.sensor} time has shape {stream.time.shape}; it is (n,) with at least one row"
        )
    if stream.values.shape != (rows, columns):
        raise ShapeError(
            f"{stream.sensor} values have shape {stream.values.shape}, expected {(rows, columns)}"
        )
    if (stream.ids is None) == form.has_landmarks:
        raise InputError(
            f"{stream.sensor} ids: landmark ids belong to streams of landmarks, and to these always"
        )
    if stream.ids is not None and stream.ids.shape != (rows,):
        raise ShapeError(f"{stream.sensor} ids have shape {stream.ids.shape}, expected {(rows,)}")
    expected = (rows, dimension, dimension)
    if stream.covariance is not None and stream.covariance.shape != expected:
        raise ShapeError(
            f"{stream.sensor} covariance has shape {stream.covariance.shape}, expected {expected}"
        )


def _check_values(stream: MeasurementStream, form: SensorFormat) -> None:
    """Require rows that are finite, in order and of the sensor's format. RowError: the first that is not."""
    if not (np.isfinite(stream.time).all() and np.isfinite(stream.values).all()):
        finite = np.isfinite(stream.time) & np.isfinite(stream.values).all(axis=1)
        row = int(np.argmin(finite))
        text = f"{stream.time[row]} s, {stream.values[row].tolist()} is not finite; leave out that line"
        raise RowError(stream.sensor, row, text)
    require_order(stream.sensor, stream.time, form.many_rows_an_epoch)
    if stream.ids is not None:
        require_distinct_landmarks(stream.sensor, stream.time, stream.ids)
    if form.quaternion is not None:
        require_unit_quaternions(stream.sensor, stream.values[:, form.quaternion : form.quaternion + 4])
    if stream.covariance is not None:
        _require_covariances(stream.sensor, stream.covariance)


@dataclass(frozen=True, eq=False)
class Acceleration:
    """Specific force (acceleration without gravity) at the sensor's position, axes of the gyro; read-only copies.

    Attributes
    ----------
    time : Float[np.ndarray, ' n']
        s, increasing, on the clock of the log.
    values : Float[np.ndarray, 'n 3']
        (n, 3) m/s^2.
    """

    time: Float[np.ndarray, " n"]
    values: Float[np.ndarray, "n 3"]

    def __post_init__(self) -> None:
        freeze_arrays(self, ("time", "values"))

    def slice(self, start: float, end: float) -> "Acceleration | None":
        """The samples with start <= time <= end (s), None where there are none."""
        rows = np.s_[np.searchsorted(self.time, start, "left") : np.searchsorted(self.time, end, "right")]
        return Acceleration(self.time[rows], self.values[rows]) if len(self.time[rows]) else None
