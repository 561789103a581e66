"""Tables of sensors in files: rows, covariances, poses in the TUM format and known landmarks, checked, read and written.

Time stamps are in order, in seconds, and at least two.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.errors import InputError, ShapeError
from spinfilters.io.input_file import path_text
from spinfilters.io.measurement_log import (
    MeasurementStream,
    freeze_arrays,
    require_distinct_landmarks,
    require_order,
)
from spinfilters.io.output_files import atomic_file
from spinfilters.io.sensor_format import SensorFormat, sensor_format
from spinfilters.io.stated_values import LENGTH, NumberRange
from spinfilters.io.text_table import WRITE_ROWS, Table, read_blank_separated, read_csv, write_csv

LATEST_SECONDS: Final[float] = 1e11
"""Beyond the year 5000 counted from 1970: such a stamp is in milli- or nanoseconds, not in seconds."""

SHORTEST_STEP: Final[float] = 1e-9
"""Between two stamps, s: no sensor is faster, and rates over shorter times are beyond all numbers."""

MOST_TURNS: Final[float] = 100.0
"""Revolutions between samples in the median, at most: a clock at which a body turns more is not in seconds."""

EPOCHS_OF_MOTION: Final[int] = 5
"""Fewest that a motion is estimated from."""


def read_sensor_file(form: SensorFormat, path: Path) -> MeasurementStream:
    """Stream of a sensor's table, without covariances.

    Raises
    ------
    InputError
        As `read_csv` and `require_clock`; a value out of its range, a quaternion that is not a unit one, a
        landmark twice at one time; what a check or reader of the sensor's own raises.
    """
    if form.read is not None:
        return form.read(path)
    return stream_of_table(form, read_csv(path, form.header))


def stream_of_table(form: SensorFormat, table: Table) -> MeasurementStream:
    """Stream of a table with the columns of a sensor's format, its rows checked. InputError: as `read_sensor_file`."""
    require_clock(table, form.many_rows_an_epoch)
    first = len(form.header) - len(form.columns)
    table.require(slice(first, None), form.allowed)
    ids = table.landmark_ids(1) if form.has_landmarks else None
    if form.check is not None:
        form.check(table)
    with table.naming_lines():
        return MeasurementStream(form.name, table.values[:, 0], table.values[:, first:], ids)


def write_sensor_file(form: SensorFormat, path: Path, stream: MeasurementStream) -> None:
    """Write a stream so that reading gives the same bits, without its covariances. Atomic."""
    if form.write is not None:
        form.write(path, stream)
        return
    ids = [] if stream.ids is None else [stream.ids]
    write_csv(path, form.header, [stream.time, *ids, *stream.values.T])


def require_clock(table: Table, repeats: bool = False) -> None:
    """Require the first column of a table to be the time in s.

    Parameters
    ----------
    table : Table
        Of one sensor, or of the truth.
    repeats : bool
        Whether a stamp may occur on several lines (stereo tracks).

    Raises
    ------
    InputError
        Stamps that are not in seconds, out of order or closer than `SHORTEST_STEP` (with line and value), or fewer
        than two epochs.
    """
    time = table.values[:, 0]
    unit = np.flatnonzero(np.abs(time) > LATEST_SECONDS)
    if unit.size:
        raise table.error(int(unit[0]), f"time {time[unit[0]]:.17g} is not in seconds; convert it to seconds")
    with table.naming_lines():
        require_order(table.path.name, time, repeats)
    step = np.diff(time)
    short = np.flatnonzero((step > 0) & (step < SHORTEST_STEP))
    if short.size:
        row = int(short[0]) + 1
        raise table.error(
            row,
            f"time {float(time[row])!r} s is {step[row - 1]:.3g} s after the one before; convert it to seconds",
        )
    require_two_epochs(table.path, np.unique(time).size)


def require_turns(table: Table, speed: Float[np.ndarray, " n"]) -> None:
    """Raise InputError for clocks that imply excessive rotation between samples.

    Parameters
    ----------
    table : Table
        With the time in s in its first column.
    speed : Float[np.ndarray, ' n']
        |body rate| of its rows, rad/s.
    """
    turns = float(np.median(speed[1:] * np.diff(table.values[:, 0]))) / (2 * np.pi)
    if turns > MOST_TURNS:
        raise InputError(
            f"{path_text(table.path)}: the body would turn {turns:.3g} times between samples, so the clock is hardly in seconds; "
            "convert it to seconds"
        )


def require_two_epochs(path: Path, epochs: int) -> None:
    """Raise InputError for a file of fewer than two epochs: a rate needs two."""
    if epochs < 2:
        raise InputError(f"{path_text(path)}: {too_few_epochs(epochs)}")


def require_motion(epochs: int) -> None:
    """Raise InputError for fewer epochs than a motion needs."""
    if epochs < EPOCHS_OF_MOTION:
        raise InputError(too_few_epochs(epochs))


def too_few_epochs(epochs: int) -> str:
    """Refusal of a recording of fewer epochs than a motion needs, with the cure."""
    return f"has {epochs} epoch{'s' * (epochs != 1)}, a motion needs at least {EPOCHS_OF_MOTION}; record a longer stretch"


ENTRY: Final = NumberRange(-1e18, 1e18)
"""Of a covariance, squared units of the measurement."""
SMALLEST_VARIANCE: Final[float] = 1e-24


def covariance_columns(sensor: str) -> tuple[str, ...]:
    """Header of a sensor's covariance table.

    The time, then the lower triangle c00, c10, c11, c20 ...
    """
    rows, columns = np.tril_indices(sensor_format(sensor).dimension)
    return ("time_s", *(f"c{i}{j}" for i, j in zip(rows.tolist(), columns.tolist(), strict=True)))


def with_covariance(stream: MeasurementStream, path: Path) -> MeasurementStream:
    """The stream with the covariances of the file (units as `MeasurementStream`), one line for each row.

    Raises
    ------
    InputError
        As `read_csv`; entries beyond `ENTRY`, variances below `SMALLEST_VARIANCE`; other times than the stream
        has; matrices that are not positive definite.
    """
    table = read_csv(path, covariance_columns(stream.sensor))
    if len(table.values) != len(stream):
        raise InputError(
            f"{path_text(path)}: has {len(table.values)} rows for {len(stream)} {stream.sensor} measurements; "
            "give one for each"
        )
    other = np.flatnonzero(table.values[:, 0] != stream.time)
    if other.size:
        row = int(other[0])
        raise table.error(
            row,
            f"time {float(table.values[row, 0])!r} s is that of no measurement, expected "
            f"{float(stream.time[row])!r} s",
        )
    covariance = _matrices(table, sensor_format(stream.sensor).dimension)
    with table.naming_lines():
        return MeasurementStream(stream.sensor, stream.time, stream.values, stream.ids, covariance)


def _matrices(table: Table, dimension: int) -> Float[np.ndarray, "n d d"]:
    """Covariances of a checked table's rows. InputError: as `with_covariance`."""
    table.require(slice(1, None), ENTRY)
    rows, columns = np.tril_indices(dimension)
    covariance = np.empty((len(table.values), dimension, dimension))
    covariance[:, rows, columns] = covariance[:, columns, rows] = table.values[:, 1:]
    small = np.flatnonzero(np.diagonal(covariance, axis1=1, axis2=2).min(axis=1) < SMALLEST_VARIANCE)
    if small.size:
        raise table.error(
            int(small[0]), f"a variance is not positive or below {SMALLEST_VARIANCE:g}; correct it"
        )
    return covariance


def write_covariance(path: Path, stream: MeasurementStream) -> None:
    """Write the covariances of a stream that has them (the lower triangle). Atomic."""
    if stream.covariance is None:
        raise InputError(
            f"the {stream.sensor} stream has no covariance to write to {path_text(path)}; give it one"
        )
    rows, columns = np.tril_indices(sensor_format(stream.sensor).dimension)
    write_csv(path, covariance_columns(stream.sensor), [stream.time, *stream.covariance[:, rows, columns].T])


TUM_COLUMNS: Final[tuple[str, ...]] = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
"""s, m (origin of g in i), unit quaternion q_ig, scalar last."""
_DECIMALS = 9


def read_tum(path: Path) -> MeasurementStream:
    """Pose stream of a TUM file: origin of g in i (m) and q_ig.

    Raises
    ------
    InputError
        As `read_blank_separated` and `require_clock`, a position beyond `LENGTH`, or a quaternion that is not a
        unit one.
    """
    table = read_blank_separated(path, TUM_COLUMNS)
    require_clock(table)
    table.require(slice(1, 4), LENGTH)
    with table.naming_lines():
        return MeasurementStream("pose", table.values[:, 0], table.values[:, 1:])


def write_tum(path: Path, stream: MeasurementStream) -> None:
    """Write a pose stream atomically, with at least 9 decimals and as many as give the same bits when read."""
    write_poses(path, stream.time, stream.values[:, :3], stream.values[:, 3:])


def write_poses(
    path: Path,
    time: Float[np.ndarray, " n"],
    position: Float[np.ndarray, "n 3"],
    quaternion: Float[np.ndarray, "n 4"],
) -> None:
    """Write times (s), positions (m) and unit quaternions as `write_tum` does."""
    rows = np.column_stack([time, position, quaternion])
    with atomic_file(path) as file:
        file.write(f"# {' '.join(TUM_COLUMNS)}\n".encode())
        for start in range(0, len(rows), WRITE_ROWS):
            for row in rows[start : start + WRITE_ROWS].tolist():
                file.write((" ".join(map(_decimal, row)) + "\n").encode())


def _decimal(number: float) -> str:
    """Without an exponent, with at least `_DECIMALS` decimals, and as many as give the same bits."""
    text = repr(number)
    if "e" in text or "." not in text:  # very small or large, or no number
        return np.format_float_positional(number, unique=True, trim="k", min_digits=_DECIMALS)
    return text.ljust(text.index(".") + 1 + _DECIMALS, "0")


LANDMARK_COLUMNS: Final[tuple[str, ...]] = ("landmark_id", "x", "y", "z")
"""Whole number, m in frame g."""


@dataclass(frozen=True, eq=False)
class KnownMap:
    """Landmarks whose places are known: ids, sorted to ascend, and points (m, frame g).

    Raises
    ------
    InputError
        An id twice, a point not finite.
    ShapeError
        Shapes other than (k,) and (k, 3), k > 0.
    """

    ids: Int[np.ndarray, " k"]
    points: Float[np.ndarray, "k 3"]

    def __post_init__(self) -> None:
        ids, points = np.asarray(self.ids), np.asarray(self.points)
        if ids.ndim != 1 or ids.size == 0 or points.shape != (ids.size, 3):
            raise ShapeError(
                f"known map: ids {ids.shape} and points {points.shape}, expected (k,) and (k, 3)"
            )
        if not np.isfinite(points).all():
            raise InputError("known map: a point is not finite; leave out that landmark")
        require_distinct_landmarks("known map", None, ids)
        order = np.argsort(ids)
        object.__setattr__(self, "ids", ids[order])
        object.__setattr__(self, "points", points[order])
        freeze_arrays(self, ("ids",), np.int64)
        freeze_arrays(self, ("points",))


def read_landmarks(path: Path) -> KnownMap:
    """Known map of a file with the header `landmark_id,x,y,z` (m, g). InputError: `read_csv`, an id twice."""
    table = read_csv(path, LANDMARK_COLUMNS)
    table.require(slice(1, 4), LENGTH)
    ids = table.landmark_ids(0)
    with table.naming_lines():
        return KnownMap(ids, table.values[:, 1:])


def write_landmarks(path: Path, known_map: KnownMap) -> None:
    """Write a known map so that reading gives the same bits. Atomic."""
    write_csv(path, LANDMARK_COLUMNS, [known_map.ids, *known_map.points.T])
