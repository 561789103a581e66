"""Rows that a logger made, left out of a stream: repetitions of the row before, and rows between two measured ones.

A gyro of 50 Hz that is logged at 100 Hz fills every other row with the rates
of the row before, and a display of 120 Hz holds each pose of a tracker of 60 Hz. Taken for measurements these rows are late by a
sample and count the noise twice. A sensor whose noise is finer than its resolution repeats itself, too. There each component by
itself keeps its value more often than all together, and the rows are left as they are. So are those of a sensor that hung once, or
of a body that came to rest: a logger repeats most of its rows, not one of them for long.

A table that is resampled at a multiple of the sensor's rate has rows on the straight line between two measured ones. Their errors
are means of those beside them. Noise leaves a value off that line by about its deviation, in two directions at least.
"""

from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.sensor_format import sensor_format

FEWEST_REPEATED: Final[float] = 1 / 2
"""Of rows that are new, followed by one that repeats them, where a logger is faster than its sensor; fewer are a fault's."""
MOST_KEPT: Final[float] = 0.05
"""Of rows that are new, in which the component that changes most often has kept its value: beyond it the resolution is coarse."""
FEWEST_BETWEEN: Final[float] = 0.9
"""Of rows off the line, followed by one on it, where these are the measured ones; else the rate is no multiple of the sensor's."""
ON_THE_LINE: Final[float] = 0.02
"""Of the distance of measured rows from the line between their neighbours: rows that are nearer lie on it."""
MEASURED: Final[float] = 0.95
"""Quantile of all distances that is one of a measured row: up to twenty rows for each that is measured."""
ROUNDING: Final[float] = 1e-9
"""Of the values: rows are off the line by no more where only a file's rounding moves them, as on a straight path without noise."""
FEWEST_NEW: Final[int] = 5
"""Rows that show how often a component keeps its value."""


def without_repeated_rows(stream: MeasurementStream) -> tuple[MeasurementStream, str]:
    """The stream without rows that a logger made, and how many they are; no words where it is as it was."""
    repeated = _find_repeated(stream)
    if repeated.any():
        kept = stream.take(~repeated)
        return kept, _remark(kept, len(stream), "repeat the row before")
    between = _find_interpolated(stream)
    if between.any():
        kept = stream.take(~between)
        return kept, _remark(kept, len(stream), "lie on the line between their neighbours")
    return stream, ""


def _find_repeated(stream: MeasurementStream) -> Bool[np.ndarray, " n"]:
    """Rows that a logger wrote again; none where the resolution explains them."""
    kept, repeated = stream.values[1:] == stream.values[:-1], np.zeros(len(stream), dtype=bool)
    if not sensor_format(stream.sensor).logged_again:
        return repeated
    repeats = kept.all(axis=1)
    made = np.concatenate([[False], repeats])
    if _share_followed(made) <= FEWEST_REPEATED or _least_kept(kept[~repeats]) > MOST_KEPT:
        return repeated
    return made


def _share_followed(made: Bool[np.ndarray, " n"]) -> float:
    """Share of measured rows that one which a logger made follows."""
    return float(np.mean(np.append(made[1:], False)[~made]))


def _find_interpolated(stream: MeasurementStream) -> Bool[np.ndarray, " n"]:
    """Rows that were interpolated at a whole number of steps between measured rows; none where the resolution explains them."""
    form, made = sensor_format(stream.sensor), np.zeros(len(stream), dtype=bool)
    if not form.logged_again or len(stream) < 2 * FEWEST_NEW:
        return made
    values = stream.values[:, : form.quaternion] if form.quaternion else stream.values
    if _least_kept(values[1:] == values[:-1]) > MOST_KEPT:
        return made
    if form.quaternion == 0:
        values = values * _continuous_signs(values)[:, np.newaxis]
    before, here, after = values[:-2], values[1:-1], values[2:]
    if form.quaternion == 0:
        # an interpolated quaternion lies in the plane of both; how long it is along their sum is a matter of its norm
        norm = np.linalg.norm(before + after, axis=1, keepdims=True)
        middle = (before + after) / np.where(norm > 0, norm, np.inf)
        before, here, after = (
            each - (each * middle).sum(axis=1, keepdims=True) * middle for each in (before, here, after)
        )
    across, step = after - before, here - before
    length = (across**2).sum(axis=1)
    along = (step * across).sum(axis=1) / np.where(length > 0, length, np.inf)
    distance = np.linalg.norm(step - along[:, np.newaxis] * across, axis=1)
    scale = float(np.quantile(distance, MEASURED))
    made[1:-1] = (distance <= ON_THE_LINE * scale) & (along > 0) & (along < 1)
    if scale <= ROUNDING * float(np.abs(values).max()) or _share_followed(made) <= FEWEST_BETWEEN:
        return np.zeros_like(made)
    return made


def _continuous_signs(quaternions: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, " n"]:
    """Signs by which each quaternion becomes the one nearer to the one before."""
    agree = (quaternions[1:] * quaternions[:-1]).sum(axis=1) >= 0
    return np.cumprod(np.concatenate([[1.0], np.where(agree, 1.0, -1.0)]))


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


def _remark(stream: MeasurementStream, every: int, how: str) -> str:
    rate = 1.0 / float(np.median(np.diff(stream.time)))
    return (
        f"{every - len(stream)} of {every} rows of the {stream.sensor} {how} and are left out: it measures at "
        f"about {rate:.3g} Hz"
    )
