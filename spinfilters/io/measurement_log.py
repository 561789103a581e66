"""Measurements of sensors as time-stamped arrays, independent of any estimator.

Every producer (images, lidar, gyro files, simulation) writes a `MeasurementLog`; every estimator reads one.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.errors import InputError, ShapeError
from spinfilters.core.linear_algebra import is_definite
from spinfilters.io.sensor_format import SensorFormat, sensor_format

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
        Name of a sensor of the registry (`spinfilters.models.sensor_registry`).
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
        Unknown sensor, not finite, out of order, not a unit quaternion, not positive definite.
    ShapeError
        Arrays of other shapes.
    """

    sensor: str
    time: Float[np.ndarray, " n"]
    values: Float[np.ndarray, "n m"]
    ids: Int[np.ndarray, " n"] | None = None
    covariance: Float[np.ndarray, "n k k"] | None = None

    def __post_init__(self) -> None:
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
        rows = np.s_[first:last]
        if last <= first:
            return None
        ids = None if self.ids is None else self.ids[rows]
        covariance = None if self.covariance is None else self.covariance[rows]
        return MeasurementStream(self.sensor, self.time[rows], self.values[rows], ids, covariance)


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
        """The stream of that sensor. InputError when the log has none."""
        for stream in self.streams:
            if stream.sensor == name:
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


def first_disorder(time: Float[np.ndarray, " n"], repeats: bool) -> int | None:
    """First row whose time (s) is before its predecessor's, or equal to it unless `repeats`; None if in order."""
    step = np.diff(time)
    rows = np.flatnonzero(step < 0.0 if repeats else step <= 0.0)
    return int(rows[0]) + 1 if rows.size else None


def first_repeated_landmark(time: Float[np.ndarray, " n"], ids: Int[np.ndarray, " n"]) -> int | None:
    """First row that repeats a landmark at the same time, or None."""
    if not _repeats(time, ids):
        return None
    order = np.lexsort((ids, time))
    same = (np.diff(time[order]) == 0.0) & (np.diff(ids[order]) == 0)
    return int(order[1:][same].min()) if same.any() else None


def _repeats(time: Float[np.ndarray, " n"], ids: Int[np.ndarray, " n"]) -> bool:
    """Whether a pair of time and id may stand twice."""
    if not len(ids):
        return False
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


def first_not_unit(quaternion: Float[np.ndarray, "n 4"]) -> int | None:
    """First row whose norm is not 1 within `QUATERNION_NORM_TOLERANCE`, None when there is none."""
    with np.errstate(over="ignore"):  # a number of 300 digits is not unit either
        rows = np.flatnonzero(np.abs(np.linalg.norm(quaternion, axis=1) - 1.0) > QUATERNION_NORM_TOLERANCE)
    return int(rows[0]) if rows.size else None


def first_not_definite(covariance: Float[np.ndarray, "n k k"]) -> int | None:
    """First row whose matrix is not positive definite beyond rounding, None when there is none."""
    for start in range(0, len(covariance), _ROWS):  # a good table needs a call for thousands of rows
        if not is_definite(covariance[start : start + _ROWS]):
            rows = range(start, min(start + _ROWS, len(covariance)))
            return next(row for row in rows if not is_definite(covariance[row]))
    return None


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
    finite = np.isfinite(stream.time) & np.isfinite(stream.values).all(axis=1)
    if not finite.all():
        row = int(np.argmin(finite))
        raise InputError(f"{stream.sensor} row {row} is {_row(stream, row)}, not finite; leave out that row")
    row = first_disorder(stream.time, form.many_rows_an_epoch)
    if row is not None:
        before, after = stream.time[row - 1], stream.time[row]
        raise InputError(
            f"{stream.sensor} row {row} at {after} s follows {before} s; sort rows, drop repeated times"
        )
    row = first_repeated_landmark(stream.time, stream.ids) if stream.ids is not None else None
    if row is not None and stream.ids is not None:
        raise InputError(
            f"{stream.sensor} row {row}: landmark {stream.ids[row]} occurs twice at {stream.time[row]} s; keep one"
        )
    first = form.quaternion
    row = None if first is None else first_not_unit(stream.values[:, first : first + 4])
    if row is not None:
        raise InputError(
            f"{stream.sensor} row {row} is {_row(stream, row)}: not a unit quaternion; normalise it or drop the row"
        )
    if stream.covariance is not None:
        _check_covariance(stream, stream.covariance)


def _check_covariance(stream: MeasurementStream, covariance: Float[np.ndarray, "n k k"]) -> None:
    finite = np.isfinite(covariance).all(axis=(1, 2))
    if not finite.all():
        row = int(np.argmin(finite))
        raise InputError(f"{stream.sensor} covariance of row {row}: not finite; leave out that row")
    std = np.sqrt(np.abs(np.diagonal(covariance, axis1=1, axis2=2)))
    asymmetry = np.abs(covariance - covariance.transpose(0, 2, 1))
    symmetric = (asymmetry <= _ASYMMETRY * std[:, :, None] * std[:, None, :]).all(axis=(1, 2))
    if not symmetric.all():
        row = int(np.argmin(symmetric))
        raise InputError(f"{stream.sensor} covariance of row {row}: not symmetric; give (P + P') / 2")
    row = first_not_definite(covariance)
    if row is not None:
        raise InputError(
            f"{stream.sensor} covariance of row {row}: not positive definite; give every component a variance"
        )


def _row(stream: MeasurementStream, row: int) -> str:
    return f"{stream.time[row]} s, {stream.values[row].tolist()}"


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
