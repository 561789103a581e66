"""Squares of errors normalised by a covariance that is given by its factor."""

import numpy as np
from jaxtyping import Bool, Float


def normalised_square(
    error: Float[np.ndarray, "n k"], rows: Float[np.ndarray, "n k e"]
) -> Float[np.ndarray, " n"]:
    """e' P^-1 e for P = rows rows', infinite where P is singular.

    ``rows`` are those rows of a covariance factor that belong to the error.
    """
    return normalised_trace(error[..., np.newaxis], rows)


def normalised_trace(
    columns: Float[np.ndarray, "n k c"], rows: Float[np.ndarray, "n k e"]
) -> Float[np.ndarray, " n"]:
    """tr(P^-1 C C') of columns C for P = rows rows', infinite where P is singular.

    By a triangular factor of P and a solve.
    """
    upper = np.asarray(np.linalg.qr(np.swapaxes(rows, 1, 2), mode="r"))
    regular = regular_factors(upper)
    result = np.full(len(columns), np.inf)
    whitened = np.linalg.solve(np.swapaxes(upper[regular], 1, 2), columns[regular])
    result[regular] = np.square(whitened).sum(axis=(1, 2))
    return result


def regular_factors(upper: np.ndarray) -> Bool[np.ndarray, " n"]:
    """Mask of numerically non-singular triangular factors.

    No diagonal element is zero, not even next to its own row of P.
    """
    scale = np.linalg.norm(upper, axis=1)
    return (np.abs(np.einsum("nii->ni", upper)) > np.finfo(float).eps * scale).all(axis=1)
