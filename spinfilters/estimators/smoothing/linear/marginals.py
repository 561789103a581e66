"""Marginal covariances of a smoother's estimates, from its last linear problem.

C is the inverse of the reduced root, transposed: the errors of poses and constants are C n. Chained errors
follow by the recursion of the elimination backwards in time,

    e_k = L_k^-T (n_k - X_k e - F_k e_k+1) = A_k e + own noise,   A_k = -L_k^-T (X_k + F_k A_k+1),

which gives their blocks of the covariance one after the other (Takahashi et al. 1973); nothing of the order of all unknowns is
formed.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from spinfilters.estimators.filters.square_root_update import triangular_factor
from spinfilters.estimators.smoothing.factors.sensor_rows import STRETCH
from spinfilters.estimators.smoothing.kernels.compiled_kernels import kernels
from spinfilters.estimators.smoothing.linear.landmark_elimination import Eliminated
from spinfilters.estimators.smoothing.linear.schur_system import SchurSystem
from spinfilters.linear_algebra.lapack import dtrtri
from spinfilters.symbolic.compiled import address


@dataclass(frozen=True)
class Marginals:
    """Covariance factors on demand.

    Attributes
    ----------
    solution: of the linear problem at the estimate.   eliminated: its landmarks, or None.
    """

    solution: SchurSystem
    eliminated: Eliminated | None

    @cached_property
    def information_sqrt(self) -> Float[np.ndarray, "r r"]:
        """C with covariance C C' of poses and constants."""
        lower = self.solution.information_sqrt
        return np.triu(dtrtri(lower.T, lower=0)[0]) if lower.size else lower

    @cached_property
    def factors(self) -> Float[np.ndarray, "k n n"]:
        """Lower triangular factor of every epoch's covariance, components in the order of the layout."""
        return self.first_factors(self.solution.ordering.epochs)

    def first_factors(self, count: int) -> Float[np.ndarray, "k n n"]:
        """Covariance factors of the first epochs."""
        n = self.solution.ordering.layout.error_dim
        factors = np.empty((count, n, n))
        for first in range(0, count, STRETCH):
            last = min(first + STRETCH, count)
            factors[first:last] = _triangles(self._rows_of(slice(first, last)))
        return factors

    def epoch_rows(self, epoch: int) -> Float[np.ndarray, "n w"]:
        """Errors of an epoch as rows over independent unit noise.

        Columns: noise of the separator, then v numbers of its own; products of rows are covariances.
        """
        return self._rows_of(slice(epoch, epoch + 1))[0]

    def _rows_of(self, epochs: slice) -> Float[np.ndarray, "k n w"]:
        """`epoch_rows` of some epochs."""
        ordering, own = self.solution.ordering, self._information_sqrts[epochs]
        p, r, v = len(ordering.pose), len(self.information_sqrt), len(ordering.tridiagonal)
        size = ordering.epochs * p
        rows = np.zeros((len(own), ordering.layout.error_dim, r + v))
        rows[:, ordering.pose, :r] = self.information_sqrt[:size].reshape(ordering.epochs, p, r)[epochs]
        rows[:, ordering.tridiagonal, :r] = self._tridiagonal_rows[epochs]
        rows[:, ordering.tridiagonal, r:] = own
        rows[:, ordering.constant, :r] = self.information_sqrt[size:]
        return rows

    def latest_rows(self) -> Float[np.ndarray, "n w"]:
        """`epoch_rows` of the last epoch, in the time that this one alone takes."""
        ordering, tridiagonal = self.solution.ordering, self.solution.tridiagonal
        p, r, v = len(ordering.pose), len(self.information_sqrt), len(ordering.tridiagonal)
        size = ordering.epochs * p
        out = np.linalg.inv(tridiagonal.information_sqrts[-1]).T
        rows = np.zeros((ordering.layout.error_dim, r + v))
        rows[ordering.pose, :r] = self.information_sqrt[size - p : size]
        rows[ordering.tridiagonal, :r] = -out @ tridiagonal.coupling[-1, :, :-1] @ self.information_sqrt
        rows[ordering.tridiagonal, r:] = out
        rows[ordering.constant, :r] = self.information_sqrt[size:]
        return rows

    def step_rows(self) -> Float[np.ndarray, "j s w"]:
        """Errors of every step's ends, as `epoch_rows`: moving components here, moving components there, constants.

        The chained errors here follow those there: e_k = A_k e + L_k^-T (n_k - F_k own_k+1).
        """
        ordering, tridiagonal, r = (
            self.solution.ordering,
            self.solution.tridiagonal,
            len(self.information_sqrt),
        )
        K, p, v = ordering.epochs, len(ordering.pose), len(ordering.tridiagonal)
        d, size = p + v, ordering.epochs * len(ordering.pose)
        poses = self.information_sqrt[:size].reshape(K, p, r)
        out = np.swapaxes(np.linalg.inv(tridiagonal.information_sqrts[:-1]), 1, 2)
        rows = np.zeros((K - 1, 2 * d + len(ordering.constant), r + 2 * v))
        rows[:, :p, :r], rows[:, p:d, :r] = poses[:-1], self._tridiagonal_rows[:-1]
        rows[:, d : d + p, :r], rows[:, d + p : 2 * d, :r] = poses[1:], self._tridiagonal_rows[1:]
        rows[:, 2 * d :, :r] = self.information_sqrt[size:]
        rows[:, p:d, r : r + v] = out
        rows[:, p:d, r + v :] = -out @ tridiagonal.next @ self._information_sqrts[1:]
        rows[:, d + p : 2 * d, r + v :] = self._information_sqrts[1:]
        return rows

    def landmark_rows(self, landmarks: Int[np.ndarray, " q"]) -> tuple[np.ndarray, np.ndarray]:
        """Errors of landmarks as rows (q, 3, r) over the separator's noise.

        Square roots (q, 3, 3) of their own covariance come with them.

        Landmarks must be told.
        """
        from scipy.sparse import bsr_array  # here alone: a solution without covariances needs none

        assert self.eliminated is not None
        if not len(landmarks):
            return np.zeros((0, 3, len(self.information_sqrt))), np.zeros((0, 3, 3))
        ordering, e = self.solution.ordering, self.eliminated
        out = np.swapaxes(e.information_sqrt[landmarks], 1, 2)
        size = ordering.epochs * len(ordering.pose)
        start = e.observations.start
        every = [np.arange(int(start[k]), int(start[k + 1])) for k in landmarks]
        pick = np.concatenate([np.arange(0), *every])
        count = (start[1:] - start[:-1])[landmarks]
        index = np.concatenate([[0], np.cumsum(count)])
        blocks = bsr_array(
            (e.coupling[pick], e.observations.epoch[pick], index), shape=(3 * len(landmarks), size)
        )
        pull = (blocks @ self.information_sqrt[:size]).reshape(len(landmarks), 3, -1)
        return -np.linalg.solve(out, pull), np.linalg.inv(out)

    def landmark_covariance(self, landmarks: Int[np.ndarray, " q"]) -> Float[np.ndarray, "q 3 3"]:
        """Covariance of well-constrained landmarks, m^2."""
        rows, own = self.landmark_rows(landmarks)
        return rows @ rows.swapaxes(1, 2) + own @ own.swapaxes(1, 2)

    @cached_property
    def _tridiagonal_rows(self) -> Float[np.ndarray, "k v r"]:
        return self._chained[0]

    @cached_property
    def _information_sqrts(self) -> Float[np.ndarray, "k v v"]:
        return self._chained[1]

    @cached_property
    def _chained(self) -> tuple[np.ndarray, np.ndarray]:
        """A_k C, and roots of the covariances of what is the chained errors' own."""
        tridiagonal = self.solution.tridiagonal
        K, v, width = tridiagonal.coupling.shape
        follow, own = np.empty((K, v, width - 1)), np.empty((K, v, v))
        chain = (tridiagonal.information_sqrts, tridiagonal.next, tridiagonal.coupling)
        library = kernels()
        if library is None:
            _follow_chain(*chain, follow, own)
        elif library.chained_covariances(K, v, width - 1, *map(address, (*chain, follow, own))):
            raise MemoryError("no memory for the covariances of velocities")
        return (follow.reshape(K * v, -1) @ self.information_sqrt).reshape(K, v, -1), own


def _follow_chain(L: np.ndarray, F: np.ndarray, X: np.ndarray, follow: np.ndarray, own: np.ndarray) -> None:
    """Covariances along an eliminated chain, backwards, for machines without a compiler."""
    K, v, _ = X.shape
    after, after_own, unit = np.zeros_like(follow[0]), np.zeros((v, v)), np.eye(v)
    inverses = np.linalg.inv(L).swapaxes(1, 2)
    for k in range(K - 1, -1, -1):
        out, pull, noise = inverses[k], X[k, :, :-1], unit
        if k + 1 < K:
            pull = pull + F[k] @ after
            noise = np.concatenate([unit, (F[k] @ after_own).T])
        after = follow[k] = -out @ pull
        after_own = own[k] = out @ triangular_factor(noise)


def _triangles(rows: Float[np.ndarray, "k n w"]) -> Float[np.ndarray, "k n n"]:
    """Lower triangular factors of rows rows'."""
    try:
        return np.linalg.cholesky(rows @ rows.swapaxes(1, 2))
    except np.linalg.LinAlgError:
        return np.array([triangular_factor(each.T) for each in rows])


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
