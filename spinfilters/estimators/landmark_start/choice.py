"""Which landmarks of a start go on into a filter that has no room for all."""

import numpy as np
from jaxtyping import Float, Int

from spinfilters.estimators.landmark_start.result import LandmarkSmoothing
from spinfilters.estimators.timeline import Timeline

SCORE_DIGITS = 9
"""Decimals of a sum over frames that are compared, so that of landmarks which are worth the same the first is taken on any
processor."""


def most_useful(frames: Timeline, smoothing: LandmarkSmoothing, capacity: int) -> Int[np.ndarray, " c"]:
    """Ids, ascending, of at most ``capacity`` landmarks that show as much as possible from every side."""
    return smoothing.ids[covering(_seen(frames, smoothing), capacity)]


def covering(seen: Float[np.ndarray, "L k"], capacity: int) -> Int[np.ndarray, " c"]:
    """Rows, ascending, of landmarks that together are seen as evenly over the k frames as possible.

    One after the other, that landmark is taken whose sum over its frames of 1 / (1 + landmarks seen there so far) is largest: often
    seen counts, and seen when few others are counts more. The most often seen ones alone may all lie on one side of the body.

    Parameters
    ----------
    seen: 1 where a landmark is seen in a frame, else 0.
    """
    crowd, left = np.zeros(seen.shape[1]), np.ones(len(seen))
    chosen = []
    for _ in range(min(capacity, len(seen))):
        best = int(np.argmax(np.round(left * (seen @ (1 / (1 + crowd))), SCORE_DIGITS)))
        crowd += seen[best]
        left[best] = -1.0
        chosen.append(best)
    return np.sort(np.array(chosen, dtype=np.int64))


def _seen(frames: Timeline, smoothing: LandmarkSmoothing) -> Float[np.ndarray, "L k"]:
    """1 where a landmark has a sighting that counts in a frame."""
    result = np.zeros((len(smoothing.ids), len(smoothing.used)))
    for k, (frame, used) in enumerate(zip(frames, smoothing.used, strict=False)):
        named = [measurement.ids for measurement in frame.measurements if measurement.ids is not None]
        if named:
            ids = np.concatenate(named)[used]
            rows = np.searchsorted(smoothing.ids, ids)
            result[rows, k] = 1.0
    return result
