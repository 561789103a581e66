"""The linear problem of an iteration: landmarks and velocities eliminated, what remains factored and solved.

What remains is a symmetric matrix over poses and constants, its lower triangle, with the right-hand side as one more row. Constants
come last, so their covariance is in the corner of the Cholesky factor.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.smoothing.factors.marginalization_prior import LinearizedPrior
from spinfilters.estimators.smoothing.factors.motion_factors import NOTHING, EpochFactors, InformationBlocks
from spinfilters.estimators.smoothing.factors.sensor_rows import STRETCH
from spinfilters.estimators.smoothing.factors.variable_ordering import VariableOrdering
from spinfilters.estimators.smoothing.kernels.compiled_kernels import kernels
from spinfilters.estimators.smoothing.linear.buffer_pool import pooled_zeros
from spinfilters.estimators.smoothing.linear.landmark_elimination import Eliminated
from spinfilters.estimators.smoothing.linear.velocity_elimination import (
    VelocityElimination,
    eliminate_velocities,
)
from spinfilters.linear_algebra.lapack import dpotrf, dtrtri, dtrtrs
from spinfilters.state.blocks.rigid_body import MASS_DISTRIBUTION
from spinfilters.symbolic.compiled import address

Blocks = tuple[np.ndarray, np.ndarray, np.ndarray]
"""D, E, G of a chain."""


@dataclass(frozen=True)
class LinearSystem:
    """Normal equations of epochs and constants before elimination.

    Attributes
    ----------
    M: (r + 1, r) lower triangle over poses and constants, then the right-hand side as a row.   tridiagonal: D, E, G.
    """

    M: Float[np.ndarray, "w r"]
    tridiagonal: Blocks

    @classmethod
    def empty(cls, ordering: VariableOrdering, G: Float[np.ndarray, "k v w"]) -> "LinearSystem":
        """A system without any information; G is zero."""
        K, v, width = G.shape
        return cls(np.zeros((width, width - 1)), (np.zeros((K, v, v)), np.zeros((max(K - 1, 0), v, v)), G))

    def copy(self) -> "LinearSystem":
        """A copy in arrays of its own: solving overwrites them."""
        D, E, G = self.tridiagonal
        return LinearSystem(self.M.copy(), (D.copy(), E.copy(), G.copy()))


@dataclass(frozen=True)
class SchurSystem:
    """A factored linear problem.

    Attributes
    ----------
    information_sqrt: (r, r) Cholesky factor of what remains, in the lower triangle; the rest is not zero.   tridiagonal: what
        was eliminated before.
    gradient: (r,) right-hand side of what remains.
    separator_step: (r,) step of poses and constants.   tridiagonal_step: (k, v) of the rest.
    predicted_reduction: by how much the linear problem's cost falls.
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
        """Rise of the linear problem's cost by errors of poses and constants about its optimum.

        The least for any errors of the rest.
        """
        poses, constants = errors[:, self.ordering.pose].reshape(-1), errors[0, self.ordering.constant]
        whitened = np.tril(self.information_sqrt).T @ np.concatenate([poses, constants])
        return float(whitened @ whitened)

    @cached_property
    def mass_std(self) -> float:
        """Largest standard deviation of the mass distribution.

        0 of a layout without it; the constants come last in the square root.
        """
        layout, constant = self.ordering.layout, self.ordering.constant
        if not layout.has(MASS_DISTRIBUTION):
            return 0.0
        c, mass = len(constant), layout.slice(MASS_DISTRIBUTION.name)
        corner = np.triu(dtrtri(self.information_sqrt[-c:, -c:].T, lower=0)[0])
        variance = np.einsum("ij,ij->i", corner, corner)
        return float(variance[(constant >= mass.start) & (constant < mass.stop)].max() ** 0.5)


class SchurSolution(NamedTuple):
    """A solved system, or the number of its first unobservable variable."""

    solution: SchurSystem | None
    unobservable: int = -1


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
    v, separator_dim = len(ordering.tridiagonal), ordering.separator_dim
    if damping:
        D[:, np.arange(v), np.arange(v)] *= 1 + damping
        M.flat[: separator_dim * separator_dim : separator_dim + 1] *= 1 + damping
    tridiagonal = eliminate_velocities(
        D, E, G, len(ordering.pose), 0 if marginal_prior is None else marginal_prior.epochs
    )
    if tridiagonal.failed >= 0:
        return SchurSolution(None, tridiagonal.failed * v)
    tridiagonal.reduce(M)
    gradient = M[-1].copy()
    upper, failed = dpotrf(M[:-1].T, lower=0, overwrite_a=1, clean=0) if separator_dim else (M[:-1].T, 0)
    half = dtrtrs(upper, gradient, lower=0, trans=1)[0] if separator_dim and not failed else gradient
    if failed or not np.isfinite(half).all():
        return SchurSolution(None, ordering.epochs * v + max(failed - 1, 0))
    step = dtrtrs(upper, half, lower=0)[0] if separator_dim else half
    predicted_reduction = float(half @ half) + float((tridiagonal.coupling[:, :, -1] ** 2).sum())
    back = tridiagonal.back(step)
    return SchurSolution(
        SchurSystem(ordering, upper.T, tridiagonal, step, back, gradient, predicted_reduction)
    )


def assembled(
    ordering: VariableOrdering, blocks: tuple[InformationBlocks, ...], eliminated: Eliminated | None
) -> LinearSystem:
    """Linear system of motion factors and eliminated landmarks."""
    G = pooled_zeros(ordering.epochs, len(ordering.tridiagonal), ordering.separator_dim + 1)
    system = LinearSystem.empty(ordering, G)
    if eliminated is not None:
        size = ordering.epochs * len(ordering.pose)
        system = LinearSystem(eliminated.information, system.tridiagonal)
        system.M[-1, :size] += eliminated.pose_gradient[:size]
    for part in blocks:
        _add(ordering, system, part)
    return system


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
    system = LinearSystem.empty(ordering, np.zeros((K, v, ordering.separator_dim + 1)))
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


def _add(ordering: VariableOrdering, system: LinearSystem, blocks: InformationBlocks) -> None:
    sizes = BlockSizes(len(ordering.pose), len(ordering.tridiagonal), len(ordering.constant))
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
    if library.add_information_blocks(*counts, address(blocks), *map(address, (M, *tridiagonal))):
        raise MemoryError("no memory to add what was measured")
    return True


def _add_epochs(M: np.ndarray, tridiagonal: Blocks, blocks: np.ndarray, sizes: BlockSizes) -> None:
    """Grams of single epochs: pose, chain, constants, right-hand side."""
    if _in_c(M, tridiagonal, blocks, sizes, 0):
        return
    (D, _, G), (p, v, _) = tridiagonal, sizes
    K = len(D)
    rest = slice(K * p, None)
    D += blocks[:, p : p + v, p : p + v]
    G[:, :, rest] += blocks[:, p : p + v, p + v :]
    M[rest, rest] += blocks[:, p + v :, p + v : -1].sum(axis=0)
    if p:
        at = np.arange(K)
        G[:, :, : K * p].reshape(K, v, K, p)[at, :, at] += blocks[:, p : p + v, :p]
        _diagonal(M, K, p)[...] += blocks[:, :p, :p]
        M[rest, : K * p] += blocks[:, p + v :, :p].transpose(1, 0, 2).reshape(-1, K * p)


def _add_steps(M: np.ndarray, tridiagonal: Blocks, blocks: np.ndarray, sizes: BlockSizes) -> None:
    """Grams of steps: pose and chain here, pose and chain there, constants, right-hand side."""
    if _in_c(M, tridiagonal, blocks, sizes, 1):
        return
    (D, E, G), (p, v, _) = tridiagonal, sizes
    K, d = len(D), p + v
    rest, after = slice(K * p, None), slice(2 * d, None)
    here, there = slice(p, d), slice(d + p, 2 * d)
    D[:-1] += blocks[:, here, here]
    D[1:] += blocks[:, there, there]
    E += blocks[:, here, there]
    G[:-1, :, rest] += blocks[:, here, after]
    G[1:, :, rest] += blocks[:, there, after]
    M[rest, rest] += blocks[:, after, 2 * d : -1].sum(axis=0)
    if not p:
        return
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
    row, column = M.strides
    return np.lib.stride_tricks.as_strided(M, (count, p, p), (p * (row + column), row, column))
