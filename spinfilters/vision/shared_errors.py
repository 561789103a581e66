"""Errors that observations of one landmark from like directions share: they do not average out as white noise does.

A detector that is deceived by shading or foreshortening is deceived again when the body shows the same face after a revolution. Of
m such observations, whose errors have the correlation rho, the mean has the variance (1 + (m - 1) rho) / m; so every one of them is
given the variance of white noise that would weigh as much in the mean.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.vision.track_noise import TrackNoise

LIKE: Final = float(np.cos(np.deg2rad(15)))
"""Cosine of the angle between directions within which errors may be shared."""
FEWEST_PAIRS: Final = 100
"""Pairs of observations from which a correlation is told."""


@dataclass(frozen=True)
class SharedErrors:
    """Correlation of errors.

    Attributes
    ----------
    place, disparity: correlation of the errors of two observations of a landmark from like directions, 0 to 1.
    group: mean number of observations of a landmark from like directions, over observations.
    """

    place: float
    disparity: float
    group: float

    def inflated(self, noise: TrackNoise) -> TrackNoise:
        """White noise that weighs as much in the mean of a group."""
        place, disparity = (1 + (self.group - 1) * each for each in (self.place, self.disparity))
        return TrackNoise(
            (noise.place[0] * place, noise.place[1] * place),
            (noise.disparity[0] * disparity, noise.disparity[1] * disparity),
        )


def shared_errors(
    residuals: Float[np.ndarray, "n 3"],
    landmark: Int[np.ndarray, " n"],
    epoch: Int[np.ndarray, " n"],
    directions: Float[np.ndarray, "n 3"],
) -> SharedErrors:
    """Correlation of residuals (u_left, v_left, disparity) of observations of a landmark, of unit directions in g."""
    first, second = _pairs(landmark)
    like = np.einsum("ki,ki->k", directions[first], directions[second]) >= LIKE
    first, second = first[like], second[like]
    group = 1 + 2 * len(first) / max(len(landmark), 1)
    if len(first) < FEWEST_PAIRS:
        return SharedErrors(0.0, 0.0, group)
    product = np.mean(residuals[first] * residuals[second], axis=0)
    variance = np.mean((residuals[first] ** 2 + residuals[second] ** 2) / 2, axis=0)
    place = product[:2].sum() / variance[:2].sum()
    disparity = product[2] / variance[2]
    return SharedErrors(float(np.clip(place, 0, 1)), float(np.clip(disparity, 0, 1)), float(group))


def _pairs(landmark: Int[np.ndarray, " n"]) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Rows of all pairs of observations of one landmark."""
    order = np.argsort(landmark, kind="stable")
    counts = np.bincount(landmark)
    position = np.arange(len(landmark)) - np.repeat(np.cumsum(counts) - counts, counts)
    first = np.repeat(np.arange(len(landmark)), position)
    begin = np.repeat(np.cumsum(position) - position, position)
    second = first - 1 - (np.arange(len(first)) - begin)
    return order[first], order[second]
