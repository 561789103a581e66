"""Pixel noise of stereo tracks from pairs of views.

From the residuals of the rigid motion between two of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from spinfilters.models.sensor_noise import NoiseLevel, noise_of_rows
from spinfilters.tracks.matches import Matches
from spinfilters.tracks.pose_fit import FittedPose, fit_poses

CHI_SQUARE_MEDIAN = 2.366
"""Of three degrees of freedom: those that a landmark seen twice leaves."""
POSE_MATCHES = 2
"""Matches that have as many components as a pose."""


@dataclass(frozen=True)
class StereoView:
    """Landmarks that one epoch shows, triangulated.

    Attributes
    ----------
    ids: (k,).   camera: (k, 3) m, camera frame.   information: (k, 3, 3) 1/m^2 of them.   pixels: (k, 3) rectified.
    """

    ids: Int[np.ndarray, " k"]
    camera: Float[np.ndarray, "k 3"]
    information: Float[np.ndarray, "k 3 3"]
    pixels: Float[np.ndarray, "k 3"]
    noise: NoiseLevel

    def only(self, ids: Int[np.ndarray, " a"]) -> "StereoView":
        """The view of some landmarks alone."""
        chosen = np.isin(self.ids, ids)
        noise = noise_of_rows(self.noise, chosen)
        return StereoView(
            self.ids[chosen], self.camera[chosen], self.information[chosen], self.pixels[chosen], noise
        )

    def matches(self, later: "StereoView") -> Matches:
        """Matches of a later view with these landmarks; g is this epoch's camera frame."""
        _, here, there = np.intersect1d(self.ids, later.ids, return_indices=True)
        here, there = here[np.argsort(there)], np.sort(there)
        covariance = np.linalg.inv(self.information[here])
        noise = noise_of_rows(later.noise, np.isin(np.arange(len(later.ids)), there))
        return Matches(self.camera[here], later.pixels[there], noise, covariance)


def noise_ratio(views: Sequence[StereoView], calibration: Float[np.ndarray, " c"]) -> float | None:
    """Standard deviation of the pixels over the stated; None where no two views tell it.

    It is the median's, which wrong matches that agree by chance hardly move.
    """
    found = fit_poses([one.matches(other) for one, other in pairwise(views)], calibration)
    fits = [fit for fit in found if fit is not None and np.count_nonzero(fit.inliers) > POSE_MATCHES]
    squares = np.concatenate([np.zeros(0), *map(_inlier_squares, fits)])
    return float(np.sqrt(np.median(squares) / CHI_SQUARE_MEDIAN)) if len(squares) else None


def _inlier_squares(fit: FittedPose) -> Float[np.ndarray, " i"]:
    """Squares of the matches that agree, raised by what the fit has taken."""
    count = np.count_nonzero(fit.inliers)
    return fit.squares[fit.inliers] * count / (count - POSE_MATCHES)
