"""The covariance of the newest frame alone, in the time that the corner of a factor takes."""

import numpy as np
from jaxtyping import Float
from scipy.linalg.lapack import dtrtri

from spinfilters.estimators.gain import triangular_factor
from spinfilters.estimators.smoothing.reduced import Reduced


def newest_factor(solution: Reduced) -> Float[np.ndarray, "n n"]:
    """Lower triangular covariance factor of the last frame's state, components in the order of the layout.

    Poses ascend in the reduced system and constants come last, so the covariance of the last poses and the constants is in the
    corner of its root, as far back as the last velocity feels.
    """
    unknowns, chain = solution.unknowns, solution.chain
    p, v = len(unknowns.pose), len(unknowns.chain)
    first = int(chain.begin[-1]) * p
    corner = (
        np.triu(dtrtri(solution.root[first:, first:].T, lower=0)[0]) if len(solution.root) else solution.root
    )
    out = np.linalg.inv(chain.roots[-1]).T
    rows = np.zeros((unknowns.layout.error_dim, len(corner) + v))
    last = (unknowns.frames - 1) * p - first
    rows[unknowns.pose, : len(corner)] = corner[last : last + p]
    rows[unknowns.constant, : len(corner)] = corner[last + p :]
    rows[unknowns.chain, : len(corner)] = -out @ chain.coupling[-1, :, first:-1] @ corner
    rows[unknowns.chain, len(corner) :] = out
    return triangular_factor(rows.T)
