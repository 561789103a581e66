"""Belief and evidence under a narrower prior of one constant block.

The prior N(m, a^2 I) of the block c times exp(-d |c - m|^2 / 2) is N(m, b^2 I) times (b / a)^dim, with d = 1 / b^2 - 1 / a^2. About
a solution that is as good as linear in c the posterior is N(x, P = F F'), and the change is an update by a measurement of m with
covariance I / d: P' = F (I + F_c' d F_c)^-1 F', and its likelihood is that of the evidence.
"""

import numpy as np

from spinfilters.errors import InputError
from spinfilters.estimators.smoothing.state_prior import FirstStatePrior
from spinfilters.state.gaussian import Gaussian


def with_narrower_prior(
    belief: Gaussian, prior: FirstStatePrior, block: str, std: float
) -> tuple[Gaussian, float]:
    """Belief given the same measurements, and what -2 ln evidence grows by.

    Parameters
    ----------
    prior: under which the belief was found.   block: constant block whose errors add.
    std: of its new prior about the same mean, at most what it was.

    Raises
    ------
    InputError: a wider prior.
    """
    layout = belief.layout
    part, wide = layout.slice(block), prior.std[layout.slice(block)]
    if not (0 < std <= wide.min() * (1 + 1e-12)):
        raise InputError(
            f"the prior of {block} is to have a deviation of {std:g}; give at most {wide.min():g}"
        )
    more = 1 / std**2 - 1 / wide**2
    if not more.any():
        return belief, 0.0
    away = belief.mean[layout.mean_slice(block)] - prior.mean[layout.mean_slice(block)]
    own = belief.factor[part]
    root = np.linalg.cholesky(np.eye(layout.error_dim) + own.T @ (more[:, np.newaxis] * own))
    factor = np.linalg.solve(root, belief.factor.T).T
    moved = factor @ (factor[part].T @ (more * away))
    grows = (more * away) @ (away - moved[part]) + 2 * float(np.log(np.diag(root)).sum())
    grows += 2 * float(np.log(std / wide).sum())
    return Gaussian(layout, layout.retract(belief.mean, -moved), factor), float(grows)
