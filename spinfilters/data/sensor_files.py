"""Tables of sensors in files: rows checked, read and written as a sensor's format says.

Time stamps are in order, in seconds, and at least two.
"""

from pathlib import Path
from typing import Final, Protocol

import numpy as np
from jaxtyping import Float

from spinfilters.data.input_file import path_text
from spinfilters.data.measurement_log import (
    MeasurementStream,
    first_disorder,
    first_not_unit,
    first_repeated_landmark,
)
from spinfilters.data.sensor_format import SensorFormat
from spinfilters.data.table_files import read_csv, write_csv
from spinfilters.errors import InputError

LATEST_SECONDS: Final[float] = 1e11
"""Beyond the year 5000 counted from 1970: such a stamp is in milli- or nanoseconds, not in seconds."""

SHORTEST_STEP: Final[float] = 1e-9
"""Between two stamps, s: no sensor is faster, and rates over shorter times are beyond all numbers."""

MOST_TURNS: Final[float] = 100.0
"""Revolutions between samples in the median, at most: a clock at which a body turns more is not in seconds."""

EPOCHS_OF_MOTION: Final[int] = 5
"""Fewest that a motion is estimated from."""


class RowsOfFile(Protocol):
    """Rows of numbers with their lines in a file."""

    @property
    def path(self) -> Path:
        """The file."""
        ...

    @property
    def values(self) -> Float[np.ndarray, "n m"]:
        """(n, m) numbers of the rows."""
        ...

    def error(self, row: int, text: str) -> InputError:
        """An InputError that names the file and the line of a row."""
        ...


def read_sensor_file(form: SensorFormat, path: Path) -> MeasurementStream:
    """Stream of a sensor's table, without covariances.

    Raises
    ------
    InputError: as `read_csv` and `require_times`; a value out of its range, a quaternion that is not a unit one, a
    landmark twice at one time; what a check or reader of the sensor's own raises.
    """
    if form.read is not None:
        return form.read(path)
    table = read_csv(path, form.header)
    require_times(table, repeats=form.many_rows_an_epoch)
    first = len(form.header) - len(form.columns)
    table.require(slice(first, None), form.allowed)
    time, ids = table.values[:, 0], table.landmark_ids(1) if form.has_landmarks else None
    if form.quaternion is not None:
        require_unit_quaternions(table, first + form.quaternion)
    row = None if ids is None else first_repeated_landmark(time, ids)
    if ids is not None and row is not None:
        raise table.error(row, f"landmark {ids[row]} occurs twice at {float(time[row])!r} s; keep one line")
    if form.check is not None:
        form.check(table)
    return MeasurementStream(form.name, time, table.values[:, first:], ids)


def write_sensor_file(form: SensorFormat, path: Path, stream: MeasurementStream) -> None:
    """Write a stream so that reading gives the same bits, without its covariances. Atomic."""
    if form.write is not None:
        form.write(path, stream)
        return
    ids = [] if stream.ids is None else [stream.ids]
    write_csv(path, form.header, [stream.time, *ids, *stream.values.T])


def require_times(table: RowsOfFile, repeats: bool) -> None:
    """Check the first column of a table as time in s.

    Parameters
    ----------
    repeats: whether a stamp may occur on several lines (stereo tracks).

    Raises
    ------
    InputError: not seconds, stamps closer than `SHORTEST_STEP`, going backwards or repeated (with line and both values), or less
    than two distinct stamps.
    """
    time = table.values[:, 0]
    unit = np.flatnonzero(np.abs(time) > LATEST_SECONDS)
    if unit.size:
        raise table.error(int(unit[0]), f"time {time[unit[0]]:.17g} is not in seconds; convert it to seconds")
    row = first_disorder(time, repeats)
    if row is not None:
        before, after = float(time[row - 1]), float(time[row])
        if before == after:
            raise table.error(row, f"time {after!r} s occurs twice; keep one line of each time")
        cure = "correct the wrong one of the two, or sort the lines by time"
        raise table.error(row, f"time {after!r} s follows {before!r} s: it runs backwards; {cure}")
    step = np.diff(time)
    short = np.flatnonzero((step > 0) & (step < SHORTEST_STEP))
    if short.size:
        row = int(short[0]) + 1
        raise table.error(
            row,
            f"time {float(time[row])!r} s is {step[row - 1]:.3g} s after the one before; convert it to seconds",
        )
    require_two_epochs(table.path, np.unique(time).size)


def require_turns(table: RowsOfFile, speed: Float[np.ndarray, " n"]) -> None:
    """Raise InputError for clocks that imply excessive rotation between samples.

    Parameters
    ----------
    table: with the time in s in its first column.   speed: |body rate| of its rows, rad/s.
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


def require_unit_quaternions(table: RowsOfFile, column: int) -> None:
    """Raise InputError unless the four columns from `column` on are unit quaternions (scalar last)."""
    quaternion: Float[np.ndarray, "n 4"] = table.values[:, column : column + 4]
    row = first_not_unit(quaternion)
    if row is not None:
        with np.errstate(over="ignore"):
            norm = float(np.linalg.norm(quaternion[row]))
        raise table.error(
            row,
            f"quaternion {quaternion[row].tolist()} has norm {norm:.6g}, not 1; correct or delete the line",
        )
