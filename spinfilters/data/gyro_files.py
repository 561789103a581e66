"""Gyro logs: `gyro.csv` of a data set, and samples that its gyro clipped."""

import re
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.data.input_file import path_text, value_text
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.data.sensor_files import require_times, require_turns
from spinfilters.data.stated_values import RATE
from spinfilters.data.table_files import read_csv, read_header, write_csv
from spinfilters.errors import InputError

GYRO_COLUMNS: Final[tuple[str, ...]] = ("time_s", "wx", "wy", "wz")
"""Header of gyro.csv: s and rad/s, g axes."""
FLAT_TOP: Final[float] = 1e-3
NEAR_TOP: Final[float] = 2e-2
"""Of the largest |rate| of an axis: clipped samples lie within the first of it (offsets are corrected after clipping), and few
others within the second. Of the samples within the second, a smooth peak has the square root of their ratio within the first."""
FEWEST_CLIPPED: Final[int] = 3
"""Samples that can make a flat top."""
CHANCE: Final[float] = 1e-4
"""Probability of a smooth peak below which a flat top is clipped, whatever the full scale."""
FULL_SCALES: Final = np.deg2rad(125.0 * 2.0 ** np.arange(6))
"""Of usual gyros, rad/s: at them a flat top of few samples is clipped."""
FULL_SCALE_TOLERANCE: Final[float] = 5e-3
"""Of a full scale."""

_DEGREES = re.compile(r"(?<![a-z])(deg(ree)?s?|dps|degps)(?![a-z])|°(?!\s*[CF])", re.IGNORECASE)
"""Degrees as a whole word: deg/s, deg_s, dps, but neither radps nor degC."""


def read_gyro_csv(path: Path) -> MeasurementStream:
    """Gyro stream of the table of a data set folder.

    Its header is `time_s,wx,wy,wz` (s, rad/s, g axes).

    Raises
    ------
    InputError: as `read_csv`, `require_times` and `require_turns`, or a column in degrees.
    """
    names = read_header(path)
    for name in names if names != GYRO_COLUMNS else ():
        if _DEGREES.search(name):
            raise InputError(
                f"{path_text(path)}: line 1: column {value_text(name)} is in degrees; multiply it by pi/180 and name it rad/s"
            )
    table = read_csv(path, GYRO_COLUMNS)
    require_times(table, repeats=False)
    table.require(slice(1, 4), RATE)
    require_turns(table, np.linalg.norm(table.values[:, 1:], axis=1))
    return MeasurementStream("gyro", table.values[:, 0], table.values[:, 1:])


def write_gyro_csv(path: Path, stream: MeasurementStream) -> None:
    """Write a gyro stream so that reading gives the same bits.

    Atomic; covariance is not part of the file.
    """
    write_csv(path, GYRO_COLUMNS, [stream.time, *stream.values.T])


def saturated(rate: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    """Whether a component of the rate is clipped at its largest magnitude.

    An axis that is there most of the time spins steadily and is not taken for clipped; nor is a peak whose top is as flat by
    chance, or by the resolution.
    """
    clipped = np.zeros(len(rate), dtype=bool)
    for axis in np.asarray(rate).T:
        clipped |= _flat_top(np.abs(axis), np.sign(axis))
    return clipped


def _flat_top(size: Float[np.ndarray, " n"], sign: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Clipped samples of an axis."""
    from scipy.special import bdtrc  # here alone: every command lists the sensors, few ask for this

    largest, nothing = size.max(initial=0.0), np.zeros(len(size), dtype=bool)
    if not 0 < largest < np.inf:
        return nothing
    resolution = np.diff(np.unique(size)).min(initial=largest) / largest
    flat = max(FLAT_TOP, 1.5 * resolution)
    top, near = size >= (1 - flat) * largest, size >= (1 - flat * NEAR_TOP / FLAT_TOP) * largest
    together = bool(np.any(top[1:] & top[:-1] & (sign[1:] == sign[:-1])))
    count, others = np.count_nonzero(top), np.count_nonzero(near)
    if not together or not FEWEST_CLIPPED <= count <= len(size) / 2 or 2 * count <= others:
        return nothing
    usual = bool(np.any(np.abs(largest / FULL_SCALES - 1) < FULL_SCALE_TOLERANCE))
    by_chance = float(bdtrc(count - 1, others, np.sqrt(FLAT_TOP / NEAR_TOP)))
    return top if usual or by_chance < CHANCE else nothing
