"""Elimination of landmarks by Schur complement, and of velocities or whole states along the chain of time."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import solve_triangular

from spinfilters.core.compiled import addresses
from spinfilters.core.large_arrays import pooled_array, pooled_zeros
from spinfilters.smoother.kernels import kernels, take_products
from spinfilters.smoother.landmark_factors import (
    OBSERVATIONS_NEEDED,
    LandmarkObservations,
    LinearObservations,
)

POSE = 6
"""Errors of a pose."""
FLATTEST = 1e-12
"""Determinant of a landmark's scaled information below which its depth is not determined."""


@dataclass(frozen=True)
class Eliminated:
    """Eliminated well-constrained landmarks, and their Schur complement on the poses.

    Attributes
    ----------
    weight : ndarray of float, shape (N,)
        Weight of each observation.
    is_constrained : ndarray of bool, shape (L,)
        Whether each landmark is well constrained.
    used : ndarray of bool, shape (N,)
        Whether each observation counts: it has a weight and its landmark is well constrained.
    information_sqrt : ndarray of float, shape (L, 3, 3)
        Lower triangular Cholesky factor L of each landmark's information; I where it is not well constrained (NumPy).
    gradient : ndarray of float, shape (L, 3)
        Gradient of each landmark, L y = J_p' r.
    coupling : ndarray of float, shape (N, 3, 6)
        Y = L^-1 J_p' J_x; the first used observation of a landmark in an epoch holds the sum, further ones hold 0.
    information : ndarray of float, shape (w, r)
        Schur complement on the poses in the lower triangle, and an empty row.
    pose_gradient : ndarray of float, shape (r,)
        Right-hand side that is left to the poses.
    predicted_reduction : float
        By how much the linear problem's cost falls by the landmarks alone.
    """

    observations: LandmarkObservations
    weight: Float[np.ndarray, " N"]
    is_constrained: Bool[np.ndarray, " L"]
    used: Bool[np.ndarray, " N"]
    information_sqrt: Float[np.ndarray, "L 3 3"]
    gradient: Float[np.ndarray, "L 3"]
    coupling: Float[np.ndarray, "N 3 6"]
    information: Float[np.ndarray, "w r"]
    pose_gradient: Float[np.ndarray, " r"]
    predicted_reduction: float

    def points_step(self, poses: Float[np.ndarray, "k 6"]) -> Float[np.ndarray, "L 3"]:
        """Landmark steps by back-substitution of a pose step; zero where not well constrained."""
        s, library = self.observations, kernels()
        if library is None:
            return self._points_step(poses)
        step, poses = np.empty((s.landmarks, 3)), np.ascontiguousarray(poses)
        given = (self.is_constrained, self.information_sqrt, self.gradient, self.coupling, poses)
        library.follow_poses(s.landmarks, *addresses(s.start, s.epoch, *given, step))
        return step

    def _points_step(self, poses: Float[np.ndarray, "k 6"]) -> Float[np.ndarray, "L 3"]:
        # Right-hand side of each landmark less what the poses take: gradient_l - sum of Y_n dx over its observations n.
        rest = self.gradient.copy()
        np.subtract.at(
            rest,
            self.observations.landmark,
            np.einsum("nab,nb->na", self.coupling, poses[self.observations.epoch]),
        )
        # Back-substitution of the 3 x 3 blocks: L_l' dp_l = rest_l.
        step = np.zeros_like(rest)
        step[self.is_constrained] = _solve_by_root(
            np.swapaxes(self.information_sqrt[self.is_constrained], 1, 2), rest[self.is_constrained]
        )
        return step


def eliminate(
    observations: LandmarkObservations,
    linear: LinearObservations,
    weight: Float[np.ndarray, " N"],
    kept: int,
    epochs: int,
) -> Eliminated:
    """Eliminate the landmarks from weighted observations; those of landmarks not well constrained do not count.

    Parameters
    ----------
    kept : int
        Number of unknowns that remain, poses first.
    """
    library = kernels()
    if library is None:
        return eliminate_in_numpy(observations, linear, weight, kept, epochs)
    L, N = observations.landmarks, len(observations)
    is_constrained, gradient = np.empty(L, dtype=bool), np.empty((L, 3))
    information_sqrt = np.empty((L, 3, 3))
    coupling, slope = pooled_array(N, 3, POSE), np.zeros(kept)
    information = pooled_zeros(kept + 1, kept)
    weight, rows = np.ascontiguousarray(weight), np.ascontiguousarray(linear.rows)
    used, fall = np.empty(N, dtype=bool), np.empty(1)
    failed = library.eliminate_landmarks(
        *(L, epochs, kept),
        *addresses(observations.start, observations.epoch, rows, weight),
        FLATTEST,
        *addresses(is_constrained, information_sqrt, gradient, coupling, information, slope, used, fall),
    )
    if failed:
        raise MemoryError("no memory to eliminate the landmarks")
    return Eliminated(
        *(observations, weight, is_constrained, used, information_sqrt, gradient, coupling),
        *(information, slope, float(fall[0])),
    )


def eliminate_in_numpy(
    observations: LandmarkObservations,
    linear: LinearObservations,
    weight: Float[np.ndarray, " N"],
    kept: int,
    epochs: int,
) -> Eliminated:
    """`eliminate` for machines without a compiler."""
    landmark, epoch, L = observations.landmark, observations.epoch, observations.landmarks
    is_constrained, used, information_sqrt = _constrained(observations, linear, weight)
    # Rows of used observations times sqrt(weight): J_x (3 x 6), J_p (3 x 3), innovation y.
    root, each_used = np.sqrt(np.where(used, weight, 0.0))[:, None, None], used[:, None, None]
    scaled = root * np.where(each_used, linear.rows, 0.0)
    by_pose, by_point, y = scaled[:, :, :POSE], scaled[:, :, POSE:-1], scaled[:, :, -1:]
    gradient, whole = np.zeros((L, 3)), np.zeros((L, 3, epochs, POSE))
    # Per landmark: gradient L^-1 sum J_p' y, and coupling Y = L^-1 J_p' J_x [3][epochs][6], summed per epoch.
    turned = by_point.swapaxes(1, 2)
    np.add.at(gradient, landmark, (turned @ y)[..., 0])
    gradient = _solve_by_root(information_sqrt, gradient)
    each = np.linalg.solve(information_sqrt[landmark], turned @ by_pose)
    np.add.at(whole, (landmark, slice(None), epoch), each)  # pyright: ignore[reportArgumentType]
    # Per pose: information J_x' J_x and right-hand side J_x' y.
    blocks, jacobian = np.zeros((epochs, POSE, POSE)), np.zeros((epochs, POSE))
    np.add.at(blocks, epoch, by_pose.swapaxes(1, 2) @ by_pose)
    np.add.at(jacobian, epoch, (by_pose.swapaxes(1, 2) @ y)[..., 0])
    # Schur complement of the landmarks: blocks - Y'Y (lower triangle), right-hand side less Y' gradient.
    Y, size = whole.reshape(3 * L, epochs * POSE), epochs * POSE
    information, slope = np.zeros((kept + 1, kept)), np.zeros(kept)
    information[:size, :size] = _added_on_diagonal(-np.tril(Y.T @ Y), blocks)
    slope[:size] = jacobian.reshape(-1) - Y.T @ gradient.reshape(-1)
    # An epoch's coupling is kept at the first used observation of the landmark there, as in C.
    coupling = whole.swapaxes(1, 2)[landmark, epoch] * _firsts(observations, used)[:, None, None]
    lower = np.tril(information)
    return Eliminated(
        *(observations, weight, is_constrained, used, information_sqrt, gradient, coupling),
        *(lower, slope, float((gradient[is_constrained] ** 2).sum())),
    )


def _added_on_diagonal(
    information: Float[np.ndarray, "s s"], blocks: Float[np.ndarray, "k p p"]
) -> Float[np.ndarray, "s s"]:
    """A matrix with a block added for every pose on its diagonal; in place."""
    for k, block in enumerate(blocks):
        at = slice(k * POSE, (k + 1) * POSE)
        information[at, at] += block
    return information


def _constrained(
    observations: LandmarkObservations, linear: LinearObservations, weight: Float[np.ndarray, " N"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Well-constrained landmarks, observations that count, and square-root information (I of all other landmarks)."""
    L, landmark = observations.landmarks, observations.landmark
    by_point = np.where((weight > 0)[:, None, None], linear.rows[:, :, POSE:-1], 0.0)
    # Information of each landmark alone: sum of w J_p' J_p over its observations.
    information = np.zeros((L, 3, 3))
    np.add.at(information, landmark, weight[:, None, None] * by_point.swapaxes(1, 2) @ by_point)
    hits = np.bincount(landmark[weight > 0], minlength=L)
    # Determinant over the product of the diagonal, in [0, 1]: 0 where one direction, the depth, is open.
    diagonal = np.einsum("kii->ki", information)
    with np.errstate(invalid="ignore", divide="ignore"):
        shape = np.linalg.det(information) / diagonal.prod(axis=1)
    is_constrained = (hits >= OBSERVATIONS_NEEDED) & (shape > FLATTEST)
    information_sqrt = np.tile(np.eye(3), (L, 1, 1))
    information_sqrt[is_constrained] = np.linalg.cholesky(information[is_constrained])
    return is_constrained, (weight > 0) & is_constrained[landmark], information_sqrt


def _firsts(observations: LandmarkObservations, used: Bool[np.ndarray, " N"]) -> Bool[np.ndarray, " N"]:
    """The first used observation of each landmark in each epoch."""
    rows = np.flatnonzero(used)
    place = (
        observations.landmark[rows] * (int(observations.epoch.max(initial=0)) + 1) + observations.epoch[rows]
    )
    result = np.zeros(len(used), dtype=bool)
    result[rows[np.flatnonzero(np.diff(place, prepend=-1))]] = True
    return result


def _solve_by_root(
    information_sqrt: Float[np.ndarray, "k 3 3"], right: Float[np.ndarray, "k 3"]
) -> Float[np.ndarray, "k 3"]:
    return np.linalg.solve(information_sqrt, right[..., None])[..., 0]


FADED = 1e-17
"""Of the largest element that a pose had in X: products with less are below the rounding of what they would be taken from."""
GROUP = 16
"""Epochs whose X are multiplied at once."""


@dataclass(frozen=True)
class VelocityElimination:
    """An eliminated chain.

    Attributes
    ----------
    information_sqrts : ndarray of float, shape (k, v, v)
        Cholesky factors L_k.
    next : ndarray of float, shape (j, v, v)
        Couplings F_k = L_k^-1 E_k to the next epoch.
    coupling : ndarray of float, shape (k, v, w)
        X_k, coupling to what remains; columns: poses, constants, right-hand side.
    begin : ndarray of int, shape (k,)
        First pose whose columns of X_k are not negligible.
    pose : int
        Columns of a pose.
    reach : int
        Number of leading poses that every epoch may be coupled to.
    failed : int
        Epoch whose information is not positive definite, or -1.
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
        (K, v, width), p, library = self.coupling.shape, self.pose, kernels()
        if library is not None:
            sizes = (K, v, p, K if p else 0, width - 1, self.reach)
            library.reduce_velocities(*sizes, *addresses(self.begin, self.coupling, M))
            return
        rest, X = K * p, self.coupling.reshape(K * v, width)
        # Constants and right-hand side: every epoch's X takes part in full.
        tail = X[:, rest:]
        M[rest:, rest:] -= tail.T @ tail[:, :-1]
        if not p:
            return
        # Poses, GROUP epochs at a time: X is zero right of the group's last pose and negligible left of `begin`.
        for first in range(0, K, GROUP):
            rows = slice(first * v, min(first + GROUP, K) * v)
            last = max(first + GROUP + 1, self.reach)
            columns = slice(int(self.begin[first]) * p, min(last, K) * p)
            part = X[rows, columns]
            take_products(part, M[columns, columns])
            M[rest:, columns] -= tail[rows].T @ part

    def back(self, separator_step: Float[np.ndarray, " r"]) -> Float[np.ndarray, "k v"]:
        """Eliminated errors by back-substitution of the separator's solution."""
        (K, v, width), library, p = self.coupling.shape, kernels(), self.pose
        if library is None:
            # What the separator leaves to each epoch: y_k - X_k dx.
            right = self.coupling[:, :, -1] - self.coupling[:, :, : width - 1] @ separator_step
            return self._solve_backwards(right)
        step, result = np.ascontiguousarray(separator_step), np.empty((K, v))
        arrays = (self.begin, self.coupling, self.information_sqrts, self.next, step, result)
        library.solve_velocities(K, v, p, K if p else 0, width - 1, self.reach, *addresses(*arrays))
        return result

    def _solve_backwards(self, right: Float[np.ndarray, "k v"]) -> Float[np.ndarray, "k v"]:
        # From the last epoch on, L_k' dv_k = right_k - F_k dv_k+1.
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
    pose : int
        Number of leading columns of G per epoch.
    reach : int
        Poses that G_0 may hold; G_k holds those up to k + 1.
    """
    (K, v, width), library = G.shape, kernels()
    begin = np.zeros(K, dtype=np.int64)
    if library is None:
        return VelocityElimination(D, E, G, begin, pose, reach, _eliminate_in_place(D, E, G))
    blocks = K if pose else 0
    failed = library.eliminate_velocities(
        *(K, v, pose, blocks, width, reach),
        FADED,
        *addresses(D, E, G, begin),
    )
    if failed < 0:
        raise MemoryError("no memory to eliminate the velocities")
    return VelocityElimination(D, E, G, begin, pose, reach, int(failed) - 1)


def _eliminate_in_place(D: np.ndarray, E: np.ndarray, G: np.ndarray) -> int:
    """`eliminate_velocities` for machines without a compiler, in place."""
    for k in range(len(D)):
        # Schur complement of the epoch before: D_k - F_k-1' F_k-1, and its coupling to what remains G_k - F_k-1' X_k-1.
        if k:
            D[k] -= E[k - 1].T @ E[k - 1]
            G[k] -= E[k - 1].T @ G[k - 1]
        # L_k L_k' = D_k, then X_k = L_k^-1 G_k and F_k = L_k^-1 E_k in the places of G_k and E_k.
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
