"""Time stamps of a file: in order, in seconds, and at least two of them."""

from pathlib import Path
from typing import Final, Protocol

import numpy as np
from jaxtyping import Float

from spinfilters.data.input_file import path_text
from spinfilters.data.measurement_log import first_disorder
from spinfilters.errors import InputError

LATEST_SECONDS: Final[float] = 1e11
"""Beyond the year 5000 counted from 1970: such a stamp is in milli- or nanoseconds, not in seconds."""

SHORTEST_STEP: Final[float] = 1e-9
"""Between two stamps, s: no sensor is faster, and rates over shorter times are beyond all numbers."""


MOST_TURNS: Final[float] = 100.0
"""Revolutions between samples in the median, at most: a clock at which a body turns more is not in seconds."""


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
        raise table.error(
            row, f"time {after!r} s follows {before!r} s: it runs backwards; sort the lines by time"
        )
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
        raise InputError(
            f"{path_text(path)}: has {epochs} epoch, at least 2 are needed; record a longer stretch"
        )
