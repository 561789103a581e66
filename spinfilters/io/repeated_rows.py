"""Rows that a logger wrote again, left out of a stream.

A gyro of 50 Hz that is logged at 100 Hz fills every other row with the rates
of the row before, and a display of 120 Hz holds each pose of a tracker of 60 Hz. Taken for measurements these rows are late by a
sample and count the noise twice. A sensor whose noise is finer than its resolution repeats itself, too. There each component by
itself keeps its value more often than all together, and the rows are left as they are. So are those of a sensor that hung once, or
of a body that came to rest: a logger repeats most of its rows, not one of them for long.
"""

from typing import Final

import numpy as np
from jaxtyping import Bool

from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.sensor_format import sensor_format

FEWEST_REPEATED: Final[float] = 1 / 2
"""Of rows that are new, followed by one that repeats them, where a logger is faster than its sensor; fewer are a fault's."""
MOST_KEPT: Final[float] = 0.05
"""Of rows that are new, in which the component that changes most often has kept its value: beyond it the resolution is coarse."""
FEWEST_NEW: Final[int] = 5
"""Rows that show how often a component keeps its value."""


def without_repeated_rows(stream: MeasurementStream) -> tuple[MeasurementStream, str]:
    """The stream without rows that only repeat the row before, and how many they are; no words where it is as it was."""
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
    is_new = np.concatenate([[True], ~repeats])
    followed = np.concatenate([repeats, [False]])[is_new]
    if np.mean(followed) <= FEWEST_REPEATED or _least_kept(kept[~repeats]) > MOST_KEPT:
        return repeated
    repeated[1:] = repeats
    return repeated


def _least_kept(kept: Bool[np.ndarray, "m c"]) -> float:
    """Share of new rows in which that component has kept its value which does so least often; 1 where too few rows show it.

    All components keep their values by chance no more often than this one. It is counted where another component has changed,
    because a row in which none has is not new.
    """
    shares = [1.0]
    for component, rest in ((kept[:, c], np.delete(kept, c, axis=1)) for c in range(kept.shape[1])):
        other_changed = ~rest.all(axis=1)
        if np.count_nonzero(other_changed) >= FEWEST_NEW:
            shares.append(float(np.mean(component[other_changed])))
    return min(shares)


def _rows(stream: MeasurementStream, chosen: Bool[np.ndarray, " n"]) -> MeasurementStream:
    covariance = None if stream.covariance is None else stream.covariance[chosen]
    return MeasurementStream(stream.sensor, stream.time[chosen], stream.values[chosen], None, covariance)


def _remark(stream: MeasurementStream, every: int) -> str:
    rate = 1.0 / float(np.median(np.diff(stream.time)))
    return (
        f"{every - len(stream)} of {every} rows of the {stream.sensor} repeat the row before and are left out: it measures at "
        f"about {rate:.3g} Hz"
    )
