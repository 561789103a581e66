"""State of a smoother's latest epoch and its landmarks, as a filter holds them."""

import numpy as np
from jaxtyping import Float, Int

from spinfilters.estimators.landmarks.belief import LandmarkBelief
from spinfilters.estimators.landmarks.landmark_options import LandmarkOptions
from spinfilters.estimators.landmarks.shared_modes import SharedErrors, shared_modes
from spinfilters.estimators.smoothing.linear.marginals import Marginals
from spinfilters.models.gauge import GAUGE_DIM


def joint_belief(
    marginals: Marginals,
    mean: Float[np.ndarray, " m"],
    ids: Int[np.ndarray, " L"],
    points: Float[np.ndarray, "L 3"],
    options: LandmarkOptions,
) -> LandmarkBelief:
    """Latest state and landmarks with their joint covariance, by a few modes that all landmarks share.

    Parameters
    ----------
    mean: of the latest epoch.   ids, points (m, frame g): of the well-constrained landmarks, in their order.
    """
    assert marginals.eliminated is not None
    constrained = np.flatnonzero(marginals.eliminated.is_constrained)
    layout = marginals.solution.ordering.layout
    rows = marginals.latest_rows()
    held = shared_modes(
        SharedErrors(layout, mean, points, rows, *marginals.landmark_rows(constrained)), options
    )
    return LandmarkBelief(layout, mean, ids, points, held.modes, held.roots, held.factor, np.zeros(GAUGE_DIM))
