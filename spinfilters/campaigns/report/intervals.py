"""95 % confidence intervals of a campaign's statistics."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.special import ndtri

QUANTILE: Final = float(ndtri(0.975))


@dataclass(frozen=True)
class Interval:
    """Estimate with its 95 % interval; NaN of too few values."""

    value: float
    low: float
    high: float
    count: int


NOTHING: Final = Interval(np.nan, np.nan, np.nan, 0)


def share(hits: int, count: int) -> Interval:
    """Interval of a probability by Wilson's score (Wilson 1927), within 0 and 1."""
    if not count:
        return NOTHING
    p, z2 = hits / count, QUANTILE**2
    centre, width = p + z2 / (2 * count), QUANTILE * np.sqrt(p * (1 - p) / count + z2 / (4 * count**2))
    low, high = (centre - width) / (1 + z2 / count), (centre + width) / (1 + z2 / count)
    return Interval(p, float(max(low, 0.0)), float(min(high, 1.0)), count)


def mean(values: Float[np.ndarray, " n"]) -> Interval:
    """Interval of a mean of independent values, by the central limit theorem."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return NOTHING
    value = float(finite.mean())
    if len(finite) < 2:
        return Interval(value, np.nan, np.nan, len(finite))
    width = QUANTILE * float(finite.std(ddof=1)) / np.sqrt(len(finite))
    return Interval(value, value - width, value + width, len(finite))


def root_mean_square(values: Float[np.ndarray, " n"]) -> Interval:
    """Interval of a root mean square, from that of the mean square."""
    return _root(mean(np.square(values)))


def ratio_of_squares(values: Float[np.ndarray, " n"], bounds: Float[np.ndarray, " n"]) -> Interval:
    """Ratio rms(values) / rms(bounds) of paired runs, with its interval.

    The mean of v^2 - r^2 b^2 is zero, its deviation that of r^2.
    """
    paired = np.isfinite(values) & np.isfinite(bounds)
    v, b = np.square(values[paired]), np.square(bounds[paired])
    if not len(v) or not b.mean() > 0:
        return NOTHING
    ratio = float(v.mean() / b.mean())
    if len(v) < 2:
        return Interval(float(np.sqrt(ratio)), np.nan, np.nan, len(v))
    width = QUANTILE * float((v - ratio * b).std(ddof=1)) / np.sqrt(len(v)) / float(b.mean())
    return _root(Interval(ratio, ratio - width, ratio + width, len(v)))


def _root(square: Interval) -> Interval:
    low, high = np.sqrt(max(square.low, 0.0)), np.sqrt(square.high)
    return Interval(float(np.sqrt(square.value)), float(low), float(high), square.count)
