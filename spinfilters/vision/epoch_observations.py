"""Landmark observations of one epoch."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from spinfilters.vision.stereo_matching import StereoFeatures


@dataclass(frozen=True)
class EpochObservations:
    """Landmark observations of one epoch.

    Attributes
    ----------
    epoch: number.   time: s.   pose: (t, q_ig) of g.   ids: (n,) landmarks.   points: the features that they are.
    covariance: (n, 3, 3) px^2.
    """

    epoch: int
    time: float
    pose: Float[np.ndarray, " 7"]
    ids: Int[np.ndarray, " n"]
    points: StereoFeatures
    covariance: Float[np.ndarray, "n 3 3"]
