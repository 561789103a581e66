"""Linear algebra of covariances: definiteness, roots, signs, normalised squares, LAPACK; and rows of long arrays."""

from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import get_lapack_funcs

from spinfilters.core.large_arrays import release_pages

SINGULAR: Final = 1e-12
"""Smallest eigenvalue, over the largest or over a diagonal of ones, from which down a matrix counts as singular.

Rounding leaves some 1e-15 of a singular one's 0, and numbers that were measured lie far above.
"""


def correlation_root(covariance: Float[np.ndarray, "*batch n n"]) -> Float[np.ndarray, "*batch n n"]:
    """Lower Cholesky factors of symmetric matrices scaled to unit diagonals, so that units do not matter.

    Raises
    ------
    numpy.linalg.LinAlgError
        When one is singular or indefinite, or a number of its diagonal not positive and finite.
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


EQUAL: Final = 1e-6
"""Relative difference below which components are equally large: rounding must not choose between those of (1, -1, 0)."""


def with_largest_positive(vectors: Float[np.ndarray, "*batch n"]) -> Float[np.ndarray, "*batch n"]:
    """The vectors, negated where the first of their largest components is negative."""
    size = np.abs(vectors)
    first = (size >= (1 - EQUAL) * size.max(axis=-1, keepdims=True)).argmax(axis=-1)
    largest = np.take_along_axis(vectors, first[..., np.newaxis], axis=-1)
    return np.where(largest < 0, -vectors, vectors)


NAMES = ("geqrf", "potrf", "pstrf", "tpqrt", "trtri", "trtrs")
dgeqrf: Any
dpotrf: Any
dpstrf: Any
dtpqrt: Any
dtrtri: Any
dtrtrs: Any
dgeqrf, dpotrf, dpstrf, dtpqrt, dtrtri, dtrtrs = get_lapack_funcs(NAMES, dtype=np.float64)


def normalised_square(
    error: Float[np.ndarray, "n k"], rows: Float[np.ndarray, "n k e"]
) -> Float[np.ndarray, " n"]:
    """e' P^-1 e for P = rows rows', infinite where P is singular (the NEES of an error).

    ``rows`` are those rows of a covariance factor that belong to the error.
    """
    return normalised_trace(error[..., np.newaxis], rows)


def normalised_squares_of(
    error: Float[np.ndarray, "n k"], rows: Float[np.ndarray, "n k e"], parts: Sequence[slice]
) -> Float[np.ndarray, "n parts"]:
    """`normalised_square` of parts of errors, a column for each."""
    return np.stack([normalised_square(error[:, part], rows[:, part]) for part in parts], axis=1)


def normalised_trace(
    columns: Float[np.ndarray, "n k c"], rows: Float[np.ndarray, "n k e"]
) -> Float[np.ndarray, " n"]:
    """tr(P^-1 C C') of columns C for P = rows rows', infinite where P is singular, by a triangular factor of P."""
    transposed, k = np.swapaxes(rows, 1, 2), rows.shape[1]
    # Reflections leave an upper triangle as it is, so that a lower triangular factor needs none.
    is_triangular = k == rows.shape[2] and not any(rows[:, :j, j].any() for j in range(1, k))
    upper = transposed if is_triangular else np.asarray(np.linalg.qr(transposed, mode="r"))
    regular = regular_factors(upper)
    result = np.full(len(columns), np.inf)
    upper, whitened = upper[regular], columns[regular]
    # R' W = C by forward substitution, a row of all epochs at a time: w_j = (c_j - sum over i < j of r_ij w_i) / r_jj
    for j in range(k):
        if j:
            whitened[:, j] -= np.einsum("ni,nic->nc", upper[:, :j, j], whitened[:, :j])
        whitened[:, j] /= upper[:, j, j, np.newaxis]
    result[regular] = np.square(whitened).sum(axis=(1, 2))
    return result


def regular_factors(upper: np.ndarray) -> Bool[np.ndarray, " n"]:
    """Mask of numerically non-singular upper triangular factors (n, k, k).

    A factor is regular if no diagonal element vanishes to rounding relative to the norm of its column.
    """
    scale = np.linalg.norm(upper, axis=1)
    return (np.abs(np.einsum("nii->ni", upper)) > np.finfo(float).eps * scale).all(axis=1)


STRETCH = 1024
"""Epochs whose derivatives are in memory together: they take ten times the room of what follows from them."""


RELEASED: Final = 8
"""Stretches after which an array in a file gives its memory back."""


def by_stretches(
    epochs: int, derive: Callable[[slice], dict[str, np.ndarray]], read: np.ndarray | None = None
) -> dict[str, np.ndarray]:
    """Named arrays over ``epochs`` epochs (at least one), computed in stretches of `STRETCH` to bound memory.

    Parameters
    ----------
    read : ndarray or None
        Array that ``derive`` reads, and that may be in a file (`spinfilters.core.large_arrays`).
    """
    whole: dict[str, np.ndarray] = {}
    for number, start in enumerate(range(0, epochs, STRETCH)):
        if read is not None and number % RELEASED == 0:
            release_pages(read)
        rows = slice(start, min(start + STRETCH, epochs))
        for name, part in derive(rows).items():
            if name not in whole:
                whole[name] = np.empty((epochs, *part.shape[1:]), part.dtype)
            whole[name][rows] = part
    if read is not None:
        release_pages(read)
    return whole


def evenly_spaced(count: int, most: int) -> Int[np.ndarray, " k"]:
    """Rows of ``count``, at most so many, evenly spaced from the first to the last."""
    return np.linspace(0, count - 1, min(most, count)).astype(int)


def at_times(
    time: Float[np.ndarray, " k"], own: Float[np.ndarray, " n"], values: Float[np.ndarray, "n c"]
) -> Float[np.ndarray, "k c"]:
    """Columns at other times, linearly between rows at ascending times; the first and the last row beyond."""
    return np.stack([np.interp(time, own, column) for column in values.T], axis=1)
