"""Velocities, or whole states, eliminated along the chain of time.

D_k is the information of an epoch's chained errors, E_k their coupling to the next epoch's, and G_k that to
all that remains (poses, constants, right-hand side); elimination forward in time is

    T_k = D_k - F_k-1' F_k-1 = L_k L_k',   F_k = L_k^-1 E_k,   X_k = L_k^-1 (G_k - F_k-1' X_k-1),

and what remains loses X'X. How a pose far back is felt fades by 2 - sqrt 3 per step (a double integrator whose places are held),
so that some thirty blocks of X are all that a double-precision number can tell.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import solve_triangular

from spinfilters.estimators.smoothing.kernels.compiled_kernels import kernels, take_products
from spinfilters.symbolic.compiled import address

FADED = 1e-17
"""Of the largest element that a pose had in X: products with less are below the rounding of what they would be taken from."""
GROUP = 16
"""Epochs whose X are multiplied at once."""


@dataclass(frozen=True)
class VelocityElimination:
    """An eliminated chain.

    Attributes
    ----------
    information_sqrts: (k, v, v) L_k.   next: (k - 1, v, v) F_k.   coupling: (k, v, w) X_k, columns: poses, constants,
        right-hand side.
    begin: (k,) first pose that X_k still feels.   pose: columns of a pose.   reach: poses that every epoch may feel.
    failed: epoch whose information is not positive definite, or -1.
    """

    information_sqrts: Float[np.ndarray, "k v v"]
    next: Float[np.ndarray, "j v v"]
    coupling: Float[np.ndarray, "k v w"]
    begin: Int[np.ndarray, " k"]
    pose: int
    reach: int
    failed: int

    def reduce(self, M: Float[np.ndarray, "w r"]) -> None:
        """Subtract X'X of the eliminated velocities from the separator, in place.

        From the lower triangle over poses and constants, and from the right-hand side in the last row.
        """
        K, v, width = self.coupling.shape
        p, rest = self.pose, K * self.pose
        X = self.coupling.reshape(K * v, width)
        tail = X[:, rest:]
        M[rest:, rest:] -= tail.T @ tail[:, :-1]
        if not p:
            return
        for first in range(0, K, GROUP):
            rows = slice(first * v, min(first + GROUP, K) * v)
            last = max(first + GROUP + 1, self.reach)
            columns = slice(int(self.begin[first]) * p, min(last, K) * p)
            part = X[rows, columns]
            take_products(part, M[columns, columns])
            M[rest:, columns] -= tail[rows].T @ part

    def back(self, separator_step: Float[np.ndarray, " r"]) -> Float[np.ndarray, "k v"]:
        """Eliminated errors by back-substitution of the separator's solution."""
        width, library = self.coupling.shape[2], kernels()
        right = self.coupling[:, :, -1] - self.coupling[:, :, : width - 1] @ separator_step
        if library is None:
            return self._back(right)
        library.solve_velocities(*right.shape, *map(address, (self.information_sqrts, self.next, right)))
        return right

    def _back(self, right: Float[np.ndarray, "k v"]) -> Float[np.ndarray, "k v"]:
        for k in range(len(right) - 1, -1, -1):
            if k + 1 < len(right):
                right[k] -= self.next[k] @ right[k + 1]
            right[k] = solve_triangular(
                self.information_sqrts[k], right[k], lower=True, trans=1, check_finite=False
            )
        return right


def eliminate_velocities(
    D: Float[np.ndarray, "k v v"],
    E: Float[np.ndarray, "j v v"],
    G: Float[np.ndarray, "k v w"],
    pose: int,
    reach: int,
) -> VelocityElimination:
    """Eliminate; the arrays are overwritten.

    Parameters
    ----------
    pose: number of leading columns of G per epoch.   reach: poses that G_0 may hold; G_k holds those up to k + 1.
    """
    (K, v, width), library = G.shape, kernels()
    begin = np.zeros(K, dtype=np.int64)
    if library is None:
        return VelocityElimination(D, E, G, begin, pose, reach, _eliminated(D, E, G))
    blocks = K if pose else 0
    failed = library.eliminate_velocities(
        *(K, v, pose, blocks, width, reach),
        FADED,
        *map(address, (D, E, G, begin)),
    )
    if failed < 0:
        raise MemoryError("no memory to eliminate the velocities")
    return VelocityElimination(D, E, G, begin, pose, reach, int(failed) - 1)


def _eliminated(D: np.ndarray, E: np.ndarray, G: np.ndarray) -> int:
    """`eliminate_velocities` for machines without a compiler, in place."""
    for k in range(len(D)):
        if k:
            D[k] -= E[k - 1].T @ E[k - 1]
            G[k] -= E[k - 1].T @ G[k - 1]
        try:
            D[k] = np.linalg.cholesky(D[k])
        except np.linalg.LinAlgError:
            return k
        if not np.isfinite(D[k]).all():
            return k
        G[k] = solve_triangular(D[k], G[k], lower=True, check_finite=False)
        if k + 1 < len(D):
            E[k] = solve_triangular(D[k], E[k], lower=True, check_finite=False)
    return -1
