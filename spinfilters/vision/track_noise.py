"""Noise of stereo observations, from feature size and patch alignment."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.optimize import nnls

SMALLEST_STD: Final = 0.02
"""Of a coordinate, px: an interpolated image tells no less."""
FEWEST: Final = 60
"""Observations from which noise is identified."""


@dataclass(frozen=True)
class TrackNoise:
    """Variances of an observation's place and disparity, px^2.

    The place has ``place[0] + place[1] size^2``: a detector finds the same point of a body again only so well, the worse the larger
    it is. The disparity has ``disparity[0] + disparity[1] residual^2`` beside it, for the right image is aligned with the left one.

    Attributes
    ----------
    place, disparity: the two coefficients of each.
    """

    place: tuple[float, float] = (0.01, 0.008)
    disparity: tuple[float, float] = (0.002, 0.3)

    def variances(
        self, size: Float[np.ndarray, " n"], residual: Float[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Variances of the place (each coordinate) and of the disparity, px^2."""
        place = self.place[0] + self.place[1] * size**2
        disparity = self.disparity[0] + self.disparity[1] * residual**2
        return np.maximum(place, SMALLEST_STD**2), np.maximum(disparity, SMALLEST_STD**2)

    def covariance(
        self, size: Float[np.ndarray, " n"], residual: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, "n 3 3"]:
        """Covariance of (u_left, v_left, u_right): errors of place move both columns alike."""
        place, disparity = self.variances(size, residual)
        covariance = np.zeros((len(size), 3, 3))
        covariance[:, [0, 1, 2, 0, 2], [0, 1, 2, 2, 0]] = place[:, None]
        covariance[:, 2, 2] += disparity
        return covariance


def identified(
    residuals: Float[np.ndarray, "n 3"],
    freedom: Float[np.ndarray, "n 3"],
    size: Float[np.ndarray, " n"],
    residual: Float[np.ndarray, " n"],
) -> TrackNoise:
    """Noise of observations from what a fit leaves of them.

    Parameters
    ----------
    residuals: of u_left, v_left and disparity, px.
    freedom: share of each one's variance that the fit has left: one minus its leverage.
    size, residual: of the features, see `TrackNoise.variances`.
    """
    place = _coefficients(residuals[:, :2], freedom[:, :2], size)
    return TrackNoise(place, _coefficients(residuals[:, 2:], freedom[:, 2:], residual))


def _coefficients(
    residuals: Float[np.ndarray, "n k"], freedom: Float[np.ndarray, "n k"], size: Float[np.ndarray, " n"]
) -> tuple[float, float]:
    """Coefficients of a variance a + b size^2, from groups of like size."""
    groups = np.array_split(np.argsort(size), max(1, min(8, len(size) // FEWEST)))
    variance = np.array([np.sum(residuals[g] ** 2) / np.maximum(np.sum(freedom[g]), 1e-9) for g in groups])
    square = np.array([np.mean(size[g] ** 2) for g in groups])
    weights = 1 / np.maximum(variance, SMALLEST_STD**2)
    (a, b), _ = nnls(np.column_stack([weights, square * weights]), variance * weights)
    return float(a), float(b)
