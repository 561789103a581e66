"""Positive definiteness beyond rounding.

A singular matrix passes a Cholesky factorisation or not by the last bit of a sum, which differs from processor to processor.
"""

from typing import Final

import numpy as np
from jaxtyping import Bool, Float

SINGULAR: Final = 1e-12
"""Smallest eigenvalue, over the largest or over a diagonal of ones, from which down a matrix counts as singular.

Rounding leaves some 1e-15 of a singular one's 0, and numbers that were measured lie far above.
"""


def correlation_root(covariance: Float[np.ndarray, "*batch n n"]) -> Float[np.ndarray, "*batch n n"]:
    """Lower Cholesky factors of matrices scaled to unit diagonals.

    Symmetric; units have no say.

    Raises
    ------
    numpy.linalg.LinAlgError: when one is singular or indefinite, or a number of its diagonal not positive and finite.
    """
    diagonal = np.diagonal(covariance, axis1=-2, axis2=-1)
    if not np.all(np.isfinite(diagonal) & (diagonal > 0)):
        raise np.linalg.LinAlgError("a variance is not positive and finite")
    scale = np.sqrt(diagonal)
    scaled = covariance / scale[..., :, np.newaxis] / scale[..., np.newaxis, :]
    np.linalg.cholesky(scaled - SINGULAR * np.eye(scale.shape[-1]))
    return np.linalg.cholesky(scaled)


def is_definite(covariance: Float[np.ndarray, "*batch n n"]) -> bool:
    """Whether all symmetric matrices have a `correlation_root`."""
    try:
        correlation_root(covariance)
    except np.linalg.LinAlgError:
        return False
    return True


def which_definite(covariances: Float[np.ndarray, "k n n"]) -> Bool[np.ndarray, " k"]:
    """Mask of symmetric matrices that have a `correlation_root`."""
    if is_definite(covariances):
        return np.ones(len(covariances), dtype=bool)
    return np.array([is_definite(covariance) for covariance in covariances])
