"""A covariance among the parameters of a measurement: its lower Cholesky factor, row by row."""

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.attitude.expressions import Expression


def factor_of(parameters: Expression, dim: int) -> ca.SX:
    """The lower factor (dim, dim) from its dim (dim + 1) / 2 entries."""
    factor = ca.SX.zeros(dim, dim)
    for index, (row, col) in enumerate(_lower(dim)):
        factor[row, col] = parameters[index]
    return factor


def parameters_of(covariance: Float[np.ndarray, "count d d"]) -> Float[np.ndarray, "count e"]:
    """The entries from covariances.

    Raises
    ------
    numpy.linalg.LinAlgError: when a covariance is not positive definite.
    """
    factor = np.linalg.cholesky(covariance)
    rows, cols = zip(*_lower(covariance.shape[1]), strict=True)
    return factor[:, rows, cols]


def _lower(dim: int) -> list[tuple[int, int]]:
    return [(row, col) for row in range(dim) for col in range(row + 1)]
