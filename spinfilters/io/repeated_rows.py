"""Rows that a logger wrote again, left out of a stream.

A gyro of 50 Hz that is logged at 100 Hz fills every other row with the rates
of the row before. Taken for measurements these are late by a sample and count the noise twice. A gyro whose noise is finer than
its resolution repeats itself, too; there each axis by itself keeps its value more often than all three together, and the rows
are left as they are.
"""

from typing import Final

import numpy as np
from jaxtyping import Bool

from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.sensor_format import sensor_format

MOST_REPEATED: Final[float] = 1 / 3
"""Of a gyro's rows, that repeat the row before by some fault of the sensor; more of them are a logger's."""
MOST_KEPT: Final[float] = 0.05
"""Of rows that are new, in which any axis has kept its value: where there are more the resolution is coarse."""
FEWEST_NEW: Final[int] = 5
"""Rows that show how often an axis keeps its value."""


def without_repeated_rows(stream: MeasurementStream) -> tuple[MeasurementStream, str]:
    """The stream without rows that only repeat the rates before, and how many they are; no words where it is as it was."""
    repeated = _find_repeated(stream)
    if not repeated.any():
        return stream, ""
    kept = _rows(stream, ~repeated)
    return kept, _remark(kept, len(stream))


def _find_repeated(stream: MeasurementStream) -> Bool[np.ndarray, " n"]:
    """Rows that a logger wrote again; none where the resolution explains them."""
    kept, repeated = stream.values[1:] == stream.values[:-1], np.zeros(len(stream), dtype=bool)
    if not sensor_format(stream.sensor).logged_again:
        return repeated
    repeats = kept.all(axis=1)
    new = kept[~repeats].any(axis=1)
    if len(new) < FEWEST_NEW or np.mean(repeats) <= MOST_REPEATED or np.mean(new) > MOST_KEPT:
        return repeated
    repeated[1:] = repeats
    return repeated


def _rows(stream: MeasurementStream, chosen: Bool[np.ndarray, " n"]) -> MeasurementStream:
    covariance = None if stream.covariance is None else stream.covariance[chosen]
    return MeasurementStream(stream.sensor, stream.time[chosen], stream.values[chosen], None, covariance)


def _remark(stream: MeasurementStream, every: int) -> str:
    rate = 1.0 / float(np.median(np.diff(stream.time)))
    return (
        f"{every - len(stream)} of {every} rows of the {stream.sensor} repeat the row before and are left out: it measures at "
        f"about {rate:.3g} Hz"
    )
