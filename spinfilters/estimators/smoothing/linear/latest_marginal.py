"""Marginal covariance of the latest epoch, from the corner of the factor."""

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.filters.square_root_update import triangular_factor
from spinfilters.estimators.smoothing.linear.schur_system import SchurSystem
from spinfilters.linear_algebra.lapack import dtrtri


def latest_factor(solution: SchurSystem) -> Float[np.ndarray, "n n"]:
    """Lower triangular covariance factor of the last epoch's state, components in the order of the layout.

    Poses ascend in the reduced system and constants come last, so the covariance of the last poses and the constants is in the
    corner of its root, as far back as the last velocity feels.
    """
    ordering, tridiagonal = solution.ordering, solution.tridiagonal
    p, v = len(ordering.pose), len(ordering.tridiagonal)
    first = int(tridiagonal.begin[-1]) * p
    corner = (
        np.triu(dtrtri(solution.information_sqrt[first:, first:].T, lower=0)[0])
        if len(solution.information_sqrt)
        else solution.information_sqrt
    )
    out = np.linalg.inv(tridiagonal.information_sqrts[-1]).T
    rows = np.zeros((ordering.layout.error_dim, len(corner) + v))
    last = (ordering.epochs - 1) * p - first
    rows[ordering.pose, : len(corner)] = corner[last : last + p]
    rows[ordering.constant, : len(corner)] = corner[last + p :]
    rows[ordering.tridiagonal, : len(corner)] = -out @ tridiagonal.coupling[-1, :, first:-1] @ corner
    rows[ordering.tridiagonal, len(corner) :] = out
    return triangular_factor(rows.T)
