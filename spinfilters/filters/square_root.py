"""Square-root measurement update, shared by all filters.

Covariances are held as factors, P = F F', so that no update makes one indefinite.
"""

import ctypes
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float

from spinfilters.core.c_library import KERNEL_FLAGS, LANES, Signature, load_text, with_signatures
from spinfilters.core.compiled import address
from spinfilters.core.linear_algebra import dgeqrf, dtrtrs

LOOSE_SUMS: Final = ("-fassociative-math", "-fno-signed-zeros", "-fno-trapping-math")
FLAGS: Final = (*KERNEL_FLAGS, *LOOSE_SUMS, "-fno-strict-aliasing", "-Wno-psabi")
"""Of compiled filters: sums may be taken in any order, so that they are vectorised; what is not finite stays so."""
LARGEST_TRIANGLE: Final = 64
"""Rows and columns of a factor that compiled code makes; larger ones go through LAPACK."""
LOG_2_PI = float(np.log(2 * np.pi))


@dataclass(frozen=True)
class MeasurementPrediction:
    """A whitened predicted measurement.

    Attributes
    ----------
    innovation : ndarray of float, shape (k,)
        Whitened innovation rho.
    measurement_factor : ndarray of float, shape (k, r)
        Factor Y of the predicted measurement.
    state_factor : ndarray of float, shape (n, r)
        Factor X of the state.
    residual : float
        Squared norm of innovation components that no state can explain (left out of ``innovation`` by compression).
    dof : int
        Number of scalar measurements, before compression.
    log_noise : float
        Log determinant of the factor by which the measurement was whitened.
    """

    innovation: Float[np.ndarray, " k"]
    measurement_factor: Float[np.ndarray, "k r"]
    state_factor: Float[np.ndarray, "n r"]
    residual: float
    dof: int
    log_noise: float


@dataclass(frozen=True)
class Correction:
    """Correction of mean and covariance by a measurement.

    Attributes
    ----------
    error : ndarray of float, shape (n,)
        Estimate d of the error.
    factor : ndarray of float, shape (n, n)
        Its covariance.
    nis : float
        Normalised innovation squared.
    log_likelihood : float
        Log likelihood of the measurement.
    dof : int
        Number of its scalars.
    root : ndarray of float, shape (r, r)
        U in the upper triangle; the first r coordinates of the state's factor are what the measurement sees.
    shift : ndarray of float, shape (r,)
        U y, the estimate in standard deviations of what is left, y those coordinates (d = X y).
    """

    error: Float[np.ndarray, " n"]
    factor: Float[np.ndarray, "n n"]
    nis: float
    log_likelihood: float
    dof: int
    root: Float[np.ndarray, "r r"]
    shift: Float[np.ndarray, " r"]

    @property
    def coordinates(self) -> Float[np.ndarray, " n"]:
        """Coordinates y of the correction, for all columns of the state's factor.

        Sigma points may have more columns than the state has numbers.

        Those that the measurement does not see stay at zero.
        """
        y = np.zeros(max(len(self.error), len(self.shift)))
        y[: len(self.shift)] = dtrtrs(self.root, self.shift)[0]
        return y

    def length(self, step: Float[np.ndarray, " n"]) -> float:
        """Length of a step of y in posterior standard deviations."""
        return float(np.linalg.norm(np.triu(self.root) @ step[: len(self.shift)]))


def square_root_update(prediction: MeasurementPrediction) -> Correction:
    """The correction of a predicted measurement (formulas in the module's docstring).

    Trailing columns of X that the measurement does not see keep their place: U is the identity there.
    """
    X, Y = prediction.state_factor, prediction.measurement_factor
    n, k = len(X), len(Y)
    r = last_nonzero(Y)
    # [Y y; I 0] = Q [U Uy; 0 rho]: U'U = I + Y'Y, column r becomes the shift, and R[r, r]^2 what no state explains.
    array = np.zeros((k + r, r + 1))
    array[:k, :r] = Y[:, :r]
    array[:k, r] = prediction.innovation
    array[k:, :r].flat[:: r + 1] = 1.0
    R = covariance_factor(array).T
    # X U^-1 by substitution from the left, (X U^-1)' = U'^-1 X'; rows after r stay, as U is the identity there.
    root = X.T.copy()
    root[:r] = dtrtrs(R[:r, :r], root[:r], trans=1)[0]
    error = R[:r, r] @ root[:r]
    nis = float(R[r, r] ** 2) + prediction.residual if k else prediction.residual
    log_root = float(np.log(np.abs(R.diagonal()[:r])).sum())
    log_likelihood = -0.5 * (nis + prediction.dof * LOG_2_PI) - log_root - prediction.log_noise
    factor = root.T if len(root) == n else covariance_factor(root)
    return Correction(error, factor, nis, log_likelihood, prediction.dof, R[:r, :r], R[:r, r])


def last_nonzero(columns: Float[np.ndarray, "k r"]) -> int:
    """Number of leading columns that hold all non-zeros, at least 1."""
    filled = columns.T.nonzero()[0]
    return int(filled[-1]) + 1 if filled.size else 1


def is_lower(rows: Float[np.ndarray, "k n"]) -> bool:
    """Whether the first rows of a factor are those of a lower triangle."""
    return not np.count_nonzero(rows * (1 - _lower_ones(rows.shape[1])[: len(rows)]))


def triangular_factor(rows: Float[np.ndarray, "k n"]) -> Float[np.ndarray, "n n"]:
    """Lower triangular L with L L' = rows' rows, by QR; there may be fewer rows than columns."""
    k, n = rows.shape
    if k < n:
        rows = np.concatenate([rows, np.zeros((n - k, n))])
    R = dgeqrf(np.array(rows, order="F"), overwrite_a=1)[0]
    return R[:n].T * _lower_ones(n)


def covariance_factor(rows: Float[np.ndarray, "k n"]) -> Float[np.ndarray, "n n"]:
    """`triangular_factor` whose diagonal is not negative, by compiled code where there is any."""
    k, n = rows.shape
    library = _triangle_library() if n <= LARGEST_TRIANGLE else None
    if library is None:
        L = triangular_factor(rows)
        return np.where(L.diagonal() < 0, -L, L)
    given, L = np.asarray(rows, dtype=float), np.empty((n, n))
    down, along = (stride // given.itemsize for stride in given.strides)
    library.triangle(given.__array_interface__["data"][0], k, n, down, along, address(L))
    return L


def covariance_factor_address() -> int | None:
    """Address of the compiled `covariance_factor`, for other compiled code to call; None without any."""
    library = _triangle_library()
    return library and ctypes.cast(library.triangle, ctypes.c_void_p).value


@cache
def _triangle_library() -> ctypes.PyDLL | None:
    text = correction_text({"C": 1, "M": 0, "N": 1})
    text += files("spinfilters.filters").joinpath("triangle.c").read_text()
    return with_signatures(
        load_text("covariance_factor", text, FLAGS), {"triangle": Signature("piiiip", None)}
    )


def correction_text(sizes: dict[str, int]) -> str:
    """C text of the measurement update for these sizes, to be continued."""
    numbers = ", ".join(f"{name} = {size}" for name, size in sizes.items())
    body = files("spinfilters.filters").joinpath("correction.c").read_text()
    return f"enum {{ {numbers}, LANES = {LANES} }};\n{body}"


def lower_roots(rows: Float[np.ndarray, "k r c"]) -> Float[np.ndarray, "k r r"]:
    """Lower triangular L with L L' = rows rows' of every item, by QR.

    Squaring would lose components much smaller than the others to rounding.
    """
    return np.swapaxes(np.linalg.qr(np.swapaxes(rows, 1, 2), mode="r"), 1, 2)


def unique_roots(rows: Float[np.ndarray, "k r c"]) -> Float[np.ndarray, "k r r"]:
    """`lower_roots` without negative diagonals: a covariance has but one, so that what a matrix behind it does is defined."""
    L = lower_roots(rows)
    return L * np.where(np.einsum("kii->ki", L) < 0, -1.0, 1.0)[:, np.newaxis]


class CompressedMeasurement(NamedTuple):
    """Informative rows of a whitened measurement.

    The squared length of the rest does not depend on the state.
    """

    innovation: Float[np.ndarray, " q"]
    jacobian: Float[np.ndarray, "q c"]
    residual: float


def compressed(
    innovation: Float[np.ndarray, " k"], jacobian: Float[np.ndarray, "k c"]
) -> CompressedMeasurement:
    """Rotate a tall whitened measurement into c informative rows."""
    k, c = jacobian.shape
    if k <= c:
        return CompressedMeasurement(innovation, jacobian, 0.0)
    # QR of [H | y]: the first c rows hold all that depends on the state, R[c, c]^2 is the rest.
    array = np.empty((k, c + 1))
    array[:, :c] = jacobian
    array[:, c] = innovation
    R = covariance_factor(array).T
    return CompressedMeasurement(R[:c, c].copy(), R[:c, :c].copy(), float(R[c, c] ** 2))


@cache
def _lower_ones(n: int) -> Float[np.ndarray, "n n"]:
    """Ones on and below the diagonal, a mask.

    Clears what LAPACK leaves beside a triangle, in a tenth of the time of `numpy.tril`.
    """
    return np.tri(n)
