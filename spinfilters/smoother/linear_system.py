"""The linear problem of an iteration, factored and solved, and the marginal covariances of its solution."""

from dataclasses import dataclass
from functools import cached_property
from math import hypot
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.compiled import address, addresses
from spinfilters.core.large_arrays import pooled_zeros
from spinfilters.core.linear_algebra import dpotrf, dtrtri, dtrtrs
from spinfilters.filters.estimator import LandmarkBelief
from spinfilters.filters.shared_modes import LandmarkOptions, SharedErrors, shared_modes
from spinfilters.filters.square_root import triangular_factor
from spinfilters.models.gauge import GAUGE_DIM
from spinfilters.models.state_blocks import MASS_DISTRIBUTION
from spinfilters.smoother.elimination import (
    FADED,
    Eliminated,
    VelocityElimination,
    eliminate_velocities,
)
from spinfilters.smoother.kernels import kernels, potrf_address
from spinfilters.smoother.motion_factors import NOTHING, STRETCH, EpochFactors, InformationBlocks
from spinfilters.smoother.priors import LinearizedPrior, VariableOrdering

Blocks = tuple[np.ndarray, np.ndarray, np.ndarray]
"""D, E, G of a chain."""


@dataclass(frozen=True)
class LinearSystem:
    """Normal equations of epochs and constants before elimination.

    Attributes
    ----------
    M : ndarray of float, shape (w, r)
        Lower triangle over poses and constants, then the right-hand side as a row.
    tridiagonal : Blocks
        D, E, G of the velocities.
    """

    M: Float[np.ndarray, "w r"]
    tridiagonal: Blocks

    @classmethod
    def empty(
        cls, G: Float[np.ndarray, "k v w"], M: Float[np.ndarray, "w r"] | None = None
    ) -> "LinearSystem":
        """A system without any information but that in M, where it is given; G is zero."""
        K, v, width = G.shape
        M = np.zeros((width, width - 1)) if M is None else M
        return cls(M, (np.zeros((K, v, v)), np.zeros((max(K - 1, 0), v, v)), G))

    def copy(self) -> "LinearSystem":
        """A copy in arrays of its own: solving overwrites them."""
        D, E, G = self.tridiagonal
        return LinearSystem(self.M.copy(), (D.copy(), E.copy(), G.copy()))


@dataclass(frozen=True)
class SchurSystem:
    """A factored linear problem.

    Attributes
    ----------
    information_sqrt : ndarray of float, shape (r, r)
        Cholesky factor of what remains, in the lower triangle; the rest is not zero.
    tridiagonal : VelocityElimination
        What was eliminated before.
    gradient : ndarray of float, shape (r,)
        Right-hand side of what remains.
    separator_step : ndarray of float, shape (r,)
        Step of poses and constants.
    tridiagonal_step : ndarray of float, shape (k, v)
        The rest.
    predicted_reduction : float
        By how much the linear problem's cost falls.
    """

    ordering: VariableOrdering
    information_sqrt: Float[np.ndarray, "r r"]
    tridiagonal: VelocityElimination
    separator_step: Float[np.ndarray, " r"]
    tridiagonal_step: Float[np.ndarray, "k v"]
    gradient: Float[np.ndarray, " r"]
    predicted_reduction: float

    @property
    def errors(self) -> Float[np.ndarray, "k n"]:
        """Step of every epoch, in the order of the layout."""
        return self.ordering.errors(self.separator_step, self.tridiagonal_step)

    @property
    def poses(self) -> Float[np.ndarray, "k p"]:
        """Step of every pose."""
        size = self.ordering.epochs * len(self.ordering.pose)
        return self.separator_step[:size].reshape(self.ordering.epochs, -1)

    def rise(self, errors: Float[np.ndarray, "k n"]) -> float:
        """Rise of the linear problem's cost by errors of poses and constants, least over the errors of all the rest."""
        poses, constants = errors[:, self.ordering.pose].reshape(-1), errors[0, self.ordering.constant]
        whitened = np.tril(self.information_sqrt).T @ np.concatenate([poses, constants])
        return float(whitened @ whitened)

    @cached_property
    def mass_std(self) -> float:
        """Largest standard deviation of the mass distribution, 0 of a layout without it.

        The constants come last in the square root, so that its last corner gives their covariance.
        """
        layout, constant = self.ordering.layout, self.ordering.constant
        if not layout.has(MASS_DISTRIBUTION):
            return 0.0
        c, mass = len(constant), layout.slice(MASS_DISTRIBUTION.name)
        # rows of the inverse that belong to the mass distribution; below the diagonal is what the factor has above its own
        first = int(np.searchsorted(constant, mass.start))
        corner = dtrtri(self.information_sqrt[-c:, -c:].T, lower=0)[0].tolist()
        rows = range(first, first + mass.stop - mass.start)
        return max(hypot(*corner[row][row:]) for row in rows)


class SchurSolution(NamedTuple):
    """A solved system, or the number of its first unobservable variable."""

    solution: SchurSystem | None
    unobservable: int = -1


def solve_normal_equations(
    ordering: VariableOrdering,
    sensors: InformationBlocks,
    dynamics: InformationBlocks,
    eliminated: Eliminated | None,
    marginal_prior: LinearizedPrior | None,
    damping: float = 0.0,
) -> SchurSolution:
    """Assemble and solve the linear problem of motion factors, of epochs alone and of steps, and of eliminated landmarks.

    It is `solve_schur_system` of what is `assembled`, in one call where there is compiled code.
    """
    library = kernels()
    if library is None:
        system = assembled(ordering, (sensors, dynamics), eliminated)
        return solve_schur_system(ordering, system, marginal_prior, damping)
    K, (p, v, c) = ordering.epochs, _sizes(ordering)
    system = _empty_system(ordering, eliminated)
    M, (D, E, G) = system.M, system.tridiagonal
    begin, kept = np.zeros(K, dtype=np.int64), ordering.separator_dim
    gradient, step, back, predicted = np.empty(kept), np.empty(kept), np.empty((K, v)), np.empty(1)
    alone, steps = (np.ascontiguousarray(part) for part in (sensors.epochs, dynamics.steps))
    prior = (0, None, None)
    if marginal_prior is not None:
        prior = (marginal_prior.epochs, *addresses(marginal_prior.gram, marginal_prior.gradient))
    failed = library.solve_window(
        *(K, p, v, c, None if eliminated is None else address(eliminated.pose_gradient)),
        *(len(alone), address(alone), address(steps) if len(steps) else None, *prior),
        *(damping, FADED, potrf_address()),
        *addresses(M, D, E, G, begin, gradient, step, back, predicted),
    )
    if failed > K:
        raise MemoryError("no memory to solve the linear problem")
    if failed:
        return SchurSolution(None, (failed - 1) * v if failed > 0 else K * v - failed - 1)
    tridiagonal = VelocityElimination(D, E, G, begin, p, prior[0], -1)
    return SchurSolution(
        SchurSystem(ordering, M[:-1], tridiagonal, step, back, gradient, float(predicted[0]))
    )


def solve_schur_system(
    ordering: VariableOrdering,
    system: LinearSystem,
    marginal_prior: LinearizedPrior | None,
    damping: float = 0.0,
) -> SchurSolution:
    """Solve the Schur system in place.

    Unknowns are numbered as in the elimination: chained errors epoch after epoch, then poses, then constants.
    """
    M, (D, E, G) = system.M, system.tridiagonal
    if marginal_prior is not None:
        marginal_prior.add_to(M, D, G)
    # M [r + 1, r]: poses, constants, right-hand side as last row; D, E, G: velocities and their coupling to these.
    v, separator_dim = len(ordering.tridiagonal), ordering.separator_dim
    if damping:
        D[:, np.arange(v), np.arange(v)] *= 1 + damping
        M.flat[: separator_dim * separator_dim : separator_dim + 1] *= 1 + damping
    # Block Cholesky along time, then the Schur complement of the velocities: M -= X'X.
    tridiagonal = eliminate_velocities(
        D, E, G, len(ordering.pose), 0 if marginal_prior is None else marginal_prior.epochs
    )
    if tridiagonal.failed >= 0:
        return SchurSolution(None, tridiagonal.failed * v)
    tridiagonal.reduce(M)
    # Cholesky of poses and constants, and forward substitution of the right-hand side.
    gradient = M[-1].copy()
    upper, half, failed = _root(M)
    # |half|^2 and the velocities' |X[:, :, -1]|^2 are the predicted fall of the cost.
    if failed or not np.isfinite(half).all():
        return SchurSolution(None, ordering.epochs * v + max(failed - 1, 0))
    step = dtrtrs(upper, half, lower=0)[0] if separator_dim else half
    predicted_reduction = float(half @ half) + float((tridiagonal.coupling[:, :, -1] ** 2).sum())
    back = tridiagonal.back(step)
    return SchurSolution(
        SchurSystem(ordering, upper.T, tridiagonal, step, back, gradient, predicted_reduction)
    )


def _root(M: Float[np.ndarray, "w r"]) -> tuple[np.ndarray, np.ndarray, int]:
    """Upper root U of U'U, column by column in memory, U'^-1 of the last row, and 0 or the number of a row that has none, from 1.

    M is overwritten; row by row, its lower triangle is LAPACK's upper one of M'.
    """
    if not M.shape[1]:
        return M[:-1].T, M[-1], 0
    library = kernels()
    if library is not None:
        failed = int(library.root_of_rows(*M.shape, address(M)))
        if failed < 0:
            raise MemoryError("no memory to factor what remains")
        return M[:-1].T, M[-1], failed
    upper, failed = dpotrf(M[:-1].T, lower=0, overwrite_a=1, clean=0)
    return upper, M[-1] if failed else dtrtrs(upper, M[-1], lower=0, trans=1)[0], failed


def assembled(
    ordering: VariableOrdering, blocks: tuple[InformationBlocks, ...], eliminated: Eliminated | None
) -> LinearSystem:
    """Linear system of motion factors and eliminated landmarks."""
    system = _empty_system(ordering, eliminated)
    if eliminated is not None:
        size = ordering.epochs * len(ordering.pose)
        system.M[-1, :size] += eliminated.pose_gradient[:size]
    for part in blocks:
        _add(ordering, system, part)
    return system


def _empty_system(ordering: VariableOrdering, eliminated: Eliminated | None) -> LinearSystem:
    """Linear system without motion factors, in the place of the information that eliminated landmarks left."""
    G = pooled_zeros(ordering.epochs, len(ordering.tridiagonal), ordering.separator_dim + 1)
    return LinearSystem.empty(G, None if eliminated is None else eliminated.information)


class AssembledMotion(NamedTuple):
    """Linear system of a motion's factors without stored rows, with their costs."""

    sensors: InformationBlocks
    dynamics: InformationBlocks
    system: LinearSystem


def assembled_by_stretches(motion: EpochFactors, trajectory: Float[np.ndarray, "k m"]) -> AssembledMotion:
    """Linear system of a long chain of epochs, assembled part by part.

    Never are the rows of more than `STRETCH` epochs in memory.
    """
    ordering, costs = motion.ordering, np.zeros(2)
    K, v = ordering.epochs, len(ordering.tridiagonal)
    system = LinearSystem.empty(np.zeros((K, v, ordering.separator_dim + 1)))
    D, E, G = system.tridiagonal
    for begin in range(0, K, STRETCH):
        end = min(begin + STRETCH, K)
        part = motion.stretch(begin, end)
        here, ahead = slice(begin, end), slice(begin, end + 1)
        parts = ((here, part.measurements(trajectory[here])), (ahead, part.dynamics(trajectory[ahead])))
        for rows, blocks in parts:
            _add(ordering, LinearSystem(system.M, (D[rows], E[here], G[rows])), blocks)
        costs += [blocks.cost for _, blocks in parts]
    sensors, dynamics = (InformationBlocks(NOTHING, NOTHING, float(cost), NOTHING) for cost in costs)
    return AssembledMotion(sensors, dynamics, system)


class BlockSizes(NamedTuple):
    """Errors of an epoch's pose and tridiagonal part, and of the constants."""

    pose: int
    tridiagonal: int
    constant: int


def _sizes(ordering: VariableOrdering) -> BlockSizes:
    return BlockSizes(len(ordering.pose), len(ordering.tridiagonal), len(ordering.constant))


def _add(ordering: VariableOrdering, system: LinearSystem, blocks: InformationBlocks) -> None:
    sizes = _sizes(ordering)
    if len(blocks.epochs):
        _add_epochs(system.M, system.tridiagonal, blocks.epochs, sizes)
    if len(blocks.steps):
        _add_steps(system.M, system.tridiagonal, blocks.steps, sizes)


def _in_c(M: np.ndarray, tridiagonal: Blocks, blocks: np.ndarray, sizes: BlockSizes, both: int) -> bool:
    """Add information blocks of epochs, or of steps (``both``), by the compiled kernel."""
    library = kernels()
    if library is None:
        return False
    blocks = np.ascontiguousarray(blocks)
    counts = (len(blocks), both, len(tridiagonal[0]), *sizes)
    library.add_information_blocks(*counts, address(blocks), *addresses(M, *tridiagonal))
    return True


def _add_epochs(M: np.ndarray, tridiagonal: Blocks, blocks: np.ndarray, sizes: BlockSizes) -> None:
    """Grams of single epochs: pose, chain, constants, right-hand side."""
    if _in_c(M, tridiagonal, blocks, sizes, 0):
        return
    (D, _, G), (p, v, _) = tridiagonal, sizes
    K, count = len(D), len(blocks)  # the first epochs, of all
    rest = slice(K * p, None)
    # Gram of epoch k, order pose (p), chain (v), constants, right-hand side: chain to D_k, its couplings to G_k.
    D[:count] += blocks[:, p : p + v, p : p + v]
    G[:count, :, rest] += blocks[:, p : p + v, p + v :]
    M[rest, rest] += blocks[:, p + v :, p + v : -1].sum(axis=0)
    if p:
        # Pose of epoch k: columns k p .. (k + 1) p of G_k, diagonal block k of M, and the last rows of M.
        at = np.arange(count)
        G[:, :, : K * p].reshape(K, v, K, p)[at, :, at] += blocks[:, p : p + v, :p]
        _diagonal(M, count, p)[...] += blocks[:, :p, :p]
        M[rest, : count * p] += blocks[:, p + v :, :p].transpose(1, 0, 2).reshape(-1, count * p)


def _add_steps(M: np.ndarray, tridiagonal: Blocks, blocks: np.ndarray, sizes: BlockSizes) -> None:
    """Grams of steps: pose and chain here, pose and chain there, constants, right-hand side."""
    if _in_c(M, tridiagonal, blocks, sizes, 1):
        return
    (D, E, G), (p, v, _) = tridiagonal, sizes
    K, d = len(D), p + v
    rest, after = slice(K * p, None), slice(2 * d, None)
    here, there = slice(p, d), slice(d + p, 2 * d)
    # Chain of step k: D_k, D_k+1 and E_k between them; constants and right-hand side into G_k, G_k+1 and M.
    D[:-1] += blocks[:, here, here]
    D[1:] += blocks[:, there, there]
    E += blocks[:, here, there]
    G[:-1, :, rest] += blocks[:, here, after]
    G[1:, :, rest] += blocks[:, there, after]
    M[rest, rest] += blocks[:, after, 2 * d : -1].sum(axis=0)
    if not p:
        return
    # Poses of step k in both epochs' G, and in M: diagonal blocks k, k + 1, block (k + 1, k) below, last rows.
    pose, next_pose, at = slice(0, p), slice(d, d + p), np.arange(K - 1)
    by_pose = G[:, :, : K * p].reshape(K, v, K, p)
    by_pose[at, :, at] += blocks[:, here, pose]
    by_pose[at, :, at + 1] += blocks[:, here, next_pose]
    by_pose[at + 1, :, at] += blocks[:, there, pose]
    by_pose[at + 1, :, at + 1] += blocks[:, there, next_pose]
    diagonal = _diagonal(M, K, p)
    diagonal[:-1] += blocks[:, pose, pose]
    diagonal[1:] += blocks[:, next_pose, next_pose]
    _diagonal(M[p:], K - 1, p)[...] += blocks[:, next_pose, pose]
    M[rest, : (K - 1) * p] += blocks[:, after, pose].transpose(1, 0, 2).reshape(-1, (K - 1) * p)
    M[rest, p : K * p] += blocks[:, after, next_pose].transpose(1, 0, 2).reshape(-1, (K - 1) * p)


def _diagonal(M: Float[np.ndarray, "a b"], count: int, p: int) -> Float[np.ndarray, "k p p"]:
    """The first ``count`` blocks of p x p on a matrix' diagonal, as a view."""
    # from one block to the next: p rows down and p columns on
    row, column = M.strides
    return np.lib.stride_tricks.as_strided(M, (count, p, p), (p * (row + column), row, column))


@dataclass(frozen=True)
class Marginals:
    """Covariance factors on demand.

    Attributes
    ----------
    solution : SchurSystem
        Solution of the linear problem at the estimate.
    eliminated : Eliminated or None
        Its eliminated landmarks, or None.
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
        # Rows of the epoch's pose, chained errors and the constants over r separator numbers; the chain has v of its own.
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
        # The last epoch has no successor: its chain follows the separator by -L^-T X and has own noise L^-T.
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
        # Over the separator's noise: pose and chain here, pose and chain there, constants.
        rows[:, :p, :r], rows[:, p:d, :r] = poses[:-1], self._tridiagonal_rows[:-1]
        rows[:, d : d + p, :r], rows[:, d + p : 2 * d, :r] = poses[1:], self._tridiagonal_rows[1:]
        rows[:, 2 * d :, :r] = self.information_sqrt[size:]
        # Own noise: n_k enters here by L_k^-T; n_k+1 there, and here by -L_k^-T F_k own_k+1.
        rows[:, p:d, r : r + v] = out
        rows[:, p:d, r + v :] = -out @ tridiagonal.next @ self._information_sqrts[1:]
        rows[:, d + p : 2 * d, r + v :] = self._information_sqrts[1:]
        return rows

    def landmark_rows(self, landmarks: Int[np.ndarray, " q"]) -> tuple[np.ndarray, np.ndarray]:
        """Errors of landmarks as rows (q, 3, r) over the separator's noise, and roots (q, 3, 3) of their own covariance.

        The landmarks must be well constrained ones of the solution, by their numbers in it.
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
        # dp = L^-T (own - Y dx): Y over the poses of each landmark's observations, dx over the separator's noise.
        pull = (blocks @ self.information_sqrt[:size]).reshape(len(landmarks), 3, -1)
        return -np.linalg.solve(out, pull), np.linalg.inv(out)

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
        elif library.chained_covariances(K, v, width - 1, *addresses(*chain, follow, own)):
            raise MemoryError("no memory for the covariances of velocities")
        return (follow.reshape(K * v, -1) @ self.information_sqrt).reshape(K, v, -1), own


def _follow_chain(L: np.ndarray, F: np.ndarray, X: np.ndarray, follow: np.ndarray, own: np.ndarray) -> None:
    """Covariances along an eliminated chain, backwards, for machines without a compiler."""
    K, v, _ = X.shape
    after, after_own, unit = np.zeros_like(follow[0]), np.zeros((v, v)), np.eye(v)
    inverses = np.linalg.inv(L).swapaxes(1, 2)
    # dv_k = L_k^-T (n_k - X_k dx - F_k dv_k+1): A_k = -L_k^-T (X_k + F_k A_k+1) over the separator, own noise n_k and F_k own_k+1.
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
    # Corner of the inverse root from the first pose on that the last velocity feels, and L^-T of that velocity.
    first = int(tridiagonal.begin[-1]) * p
    corner = (
        np.triu(dtrtri(solution.information_sqrt[first:, first:].T, lower=0)[0])
        if len(solution.information_sqrt)
        else solution.information_sqrt
    )
    out = np.linalg.inv(tridiagonal.information_sqrts[-1]).T
    # Rows of the last pose, the constants and the chain over the corner's noise; the chain has v numbers of its own.
    rows = np.zeros((ordering.layout.error_dim, len(corner) + v))
    last = (ordering.epochs - 1) * p - first
    rows[ordering.pose, : len(corner)] = corner[last : last + p]
    rows[ordering.constant, : len(corner)] = corner[last + p :]
    rows[ordering.tridiagonal, : len(corner)] = -out @ tridiagonal.coupling[-1, :, first:-1] @ corner
    rows[ordering.tridiagonal, len(corner) :] = out
    return triangular_factor(rows.T)


def joint_belief(
    marginals: Marginals,
    mean: Float[np.ndarray, " m"],
    ids: Int[np.ndarray, " L"],
    points: Float[np.ndarray, "L 3"],
    options: LandmarkOptions,
) -> LandmarkBelief:
    """Latest state and landmarks with their joint covariance, by a few modes that all landmarks share.

    Parameters
    ----------
    mean : ndarray of float, shape (m,)
        Mean of the latest epoch.
    """
    assert marginals.eliminated is not None
    constrained = np.flatnonzero(marginals.eliminated.is_constrained)
    layout = marginals.solution.ordering.layout
    rows = marginals.latest_rows()
    held = shared_modes(
        SharedErrors(layout, mean, points, rows, *marginals.landmark_rows(constrained)), options
    )
    return LandmarkBelief(layout, mean, ids, points, held.modes, held.roots, held.factor, np.zeros(GAUGE_DIM))
