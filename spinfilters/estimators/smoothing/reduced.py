"""The linear problem of an iteration: landmarks and velocities eliminated, what remains factored and solved.

What remains is a symmetric matrix over poses and constants, its lower triangle, with the right-hand side as one more row. Constants
come last, so their covariance is in the corner of the Cholesky factor.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.linalg.lapack import dpotrf, dtrtri, dtrtrs

from spinfilters.estimators.smoothing.carried import CarriedAt
from spinfilters.estimators.smoothing.chain import Chain, eliminate_chain
from spinfilters.estimators.smoothing.elimination import Eliminated
from spinfilters.estimators.smoothing.memory import lent_zeros
from spinfilters.estimators.smoothing.motion import NOTHING, STRETCH, Grams, Motion
from spinfilters.estimators.smoothing.native import kernels
from spinfilters.estimators.smoothing.unknowns import Unknowns
from spinfilters.state.blocks.rigid_body import MASS_DISTRIBUTION
from spinfilters.symbolic.compiled import address

Blocks = tuple[np.ndarray, np.ndarray, np.ndarray]
"""D, E, G of a chain."""


@dataclass(frozen=True)
class LinearSystem:
    """What is to be solved.

    Attributes
    ----------
    M: (r + 1, r) lower triangle over poses and constants, then the right-hand side as a row.   chain: D, E, G.
    """

    M: Float[np.ndarray, "w r"]
    chain: Blocks

    @classmethod
    def empty(cls, unknowns: Unknowns, G: Float[np.ndarray, "k v w"]) -> "LinearSystem":
        """Without any information; G is zero."""
        K, v, width = G.shape
        return cls(np.zeros((width, width - 1)), (np.zeros((K, v, v)), np.zeros((max(K - 1, 0), v, v)), G))

    def copy(self) -> "LinearSystem":
        """In arrays of its own: solving overwrites them."""
        D, E, G = self.chain
        return LinearSystem(self.M.copy(), (D.copy(), E.copy(), G.copy()))


@dataclass(frozen=True)
class Reduced:
    """A factored linear problem.

    Attributes
    ----------
    root: (r, r) Cholesky factor of what remains, in the lower triangle; the rest is not zero.   chain: what was eliminated before.
    gradient: (r,) right-hand side of what remains.
    kept: (r,) step of poses and constants.   chains: (k, v) of the rest.
    decrement: by how much the linear problem's cost falls.
    """

    unknowns: Unknowns
    root: Float[np.ndarray, "r r"]
    chain: Chain
    kept: Float[np.ndarray, " r"]
    chains: Float[np.ndarray, "k v"]
    gradient: Float[np.ndarray, " r"]
    decrement: float

    @property
    def errors(self) -> Float[np.ndarray, "k n"]:
        """Step of every frame, in the order of the layout."""
        return self.unknowns.errors(self.kept, self.chains)

    @property
    def poses(self) -> Float[np.ndarray, "k p"]:
        """Step of every pose."""
        size = self.unknowns.frames * len(self.unknowns.pose)
        return self.kept[:size].reshape(self.unknowns.frames, -1)

    @cached_property
    def mass_std(self) -> float:
        """Largest standard deviation of the mass distribution, 0 of a layout without it: the constants come last in the root."""
        layout, constant = self.unknowns.layout, self.unknowns.constant
        if not layout.has(MASS_DISTRIBUTION):
            return 0.0
        c, mass = len(constant), layout.slice(MASS_DISTRIBUTION.name)
        corner = np.triu(dtrtri(self.root[-c:, -c:].T, lower=0)[0])
        variance = np.einsum("ij,ij->i", corner, corner)
        return float(variance[(constant >= mass.start) & (constant < mass.stop)].max() ** 0.5)


def solve_reduced(
    unknowns: Unknowns, system: LinearSystem, carried: CarriedAt | None, damping: float = 0.0
) -> Reduced | int:
    """Solve, overwriting the system; the number of the first undetermined unknown where it is not positive definite.

    Unknowns are numbered as in the elimination: chained errors frame after frame, then poses, then constants.
    """
    M, (D, E, G) = system.M, system.chain
    if carried is not None:
        carried.add_to(M, D, G)
    v, kept = len(unknowns.chain), unknowns.kept
    if damping:
        D[:, np.arange(v), np.arange(v)] *= 1 + damping
        M.flat[: kept * kept : kept + 1] *= 1 + damping
    chain = eliminate_chain(D, E, G, len(unknowns.pose), 0 if carried is None else carried.frames)
    if chain.failed >= 0:
        return chain.failed * v
    chain.reduce(M)
    gradient = M[-1].copy()
    upper, failed = dpotrf(M[:-1].T, lower=0, overwrite_a=1, clean=0) if kept else (M[:-1].T, 0)
    half = dtrtrs(upper, gradient, lower=0, trans=1)[0] if kept and not failed else gradient
    if failed or not np.isfinite(half).all():
        return unknowns.frames * v + max(failed - 1, 0)
    step = dtrtrs(upper, half, lower=0)[0] if kept else half
    decrement = float(half @ half) + float((chain.coupling[:, :, -1] ** 2).sum())
    return Reduced(unknowns, upper.T, chain, step, chain.back(step), gradient, decrement)


def assembled(unknowns: Unknowns, grams: tuple[Grams, ...], eliminated: Eliminated | None) -> LinearSystem:
    """The system of grams, and of landmarks that are eliminated already."""
    G = lent_zeros(unknowns.frames, len(unknowns.chain), unknowns.kept + 1)
    system = LinearSystem.empty(unknowns, G)
    if eliminated is not None:
        size = unknowns.frames * len(unknowns.pose)
        system = LinearSystem(eliminated.information, system.chain)
        system.M[-1, :size] += eliminated.pose_gradient[:size]
    for part in grams:
        _add(unknowns, system, part)
    return system


def assembled_by_stretches(
    motion: Motion, trajectory: Float[np.ndarray, "k m"]
) -> tuple[Grams, Grams, LinearSystem]:
    """The system of a long chain of frames, after the costs of sensors and dynamics (grams without rows).

    Never are the rows of more than `STRETCH` frames in memory.
    """
    unknowns, costs = motion.unknowns, np.zeros(2)
    K, v = unknowns.frames, len(unknowns.chain)
    system = LinearSystem.empty(unknowns, np.zeros((K, v, unknowns.kept + 1)))
    D, E, G = system.chain
    for begin in range(0, K, STRETCH):
        end = min(begin + STRETCH, K)
        part = motion.stretch(begin, end)
        here, ahead = slice(begin, end), slice(begin, end + 1)
        parts = ((here, part.measurements(trajectory[here])), (ahead, part.dynamics(trajectory[ahead])))
        for rows, grams in parts:
            _add(unknowns, LinearSystem(system.M, (D[rows], E[here], G[rows])), grams)
        costs += [grams.cost for _, grams in parts]
    sensors, dynamics = (Grams(NOTHING, NOTHING, float(cost), NOTHING) for cost in costs)
    return sensors, dynamics, system


def _add(unknowns: Unknowns, system: LinearSystem, grams: Grams) -> None:
    sizes = (len(unknowns.pose), len(unknowns.chain), len(unknowns.constant))
    if len(grams.frames):
        _add_frames(system.M, system.chain, grams.frames, sizes)
    if len(grams.steps):
        _add_steps(system.M, system.chain, grams.steps, sizes)


def _in_c(M: np.ndarray, chain: Blocks, grams: np.ndarray, sizes: tuple[int, int, int], both: int) -> bool:
    """Add grams of frames, or of steps from one to the next (``both``), where there is a compiler."""
    library = kernels()
    if library is None:
        return False
    grams = np.ascontiguousarray(grams)
    counts = (len(grams), both, len(chain[0]), *sizes)
    if library.add_grams(*counts, address(grams), *map(address, (M, *chain))):
        raise MemoryError("no memory to add what was measured")
    return True


def _add_frames(M: np.ndarray, chain: Blocks, grams: np.ndarray, sizes: tuple[int, int, int]) -> None:
    """Grams of single frames: pose, chain, constants, right-hand side."""
    if _in_c(M, chain, grams, sizes, 0):
        return
    (D, _, G), (p, v, _) = chain, sizes
    K = len(D)
    rest = slice(K * p, None)
    D += grams[:, p : p + v, p : p + v]
    G[:, :, rest] += grams[:, p : p + v, p + v :]
    M[rest, rest] += grams[:, p + v :, p + v : -1].sum(axis=0)
    if p:
        at = np.arange(K)
        G[:, :, : K * p].reshape(K, v, K, p)[at, :, at] += grams[:, p : p + v, :p]
        _diagonal(M, K, p)[...] += grams[:, :p, :p]
        M[rest, : K * p] += grams[:, p + v :, :p].transpose(1, 0, 2).reshape(-1, K * p)


def _add_steps(M: np.ndarray, chain: Blocks, grams: np.ndarray, sizes: tuple[int, int, int]) -> None:
    """Grams of steps: pose and chain here, pose and chain there, constants, right-hand side."""
    if _in_c(M, chain, grams, sizes, 1):
        return
    (D, E, G), (p, v, _) = chain, sizes
    K, d = len(D), p + v
    rest, after = slice(K * p, None), slice(2 * d, None)
    here, there = slice(p, d), slice(d + p, 2 * d)
    D[:-1] += grams[:, here, here]
    D[1:] += grams[:, there, there]
    E += grams[:, here, there]
    G[:-1, :, rest] += grams[:, here, after]
    G[1:, :, rest] += grams[:, there, after]
    M[rest, rest] += grams[:, after, 2 * d : -1].sum(axis=0)
    if not p:
        return
    pose, next_pose, at = slice(0, p), slice(d, d + p), np.arange(K - 1)
    by_pose = G[:, :, : K * p].reshape(K, v, K, p)
    by_pose[at, :, at] += grams[:, here, pose]
    by_pose[at, :, at + 1] += grams[:, here, next_pose]
    by_pose[at + 1, :, at] += grams[:, there, pose]
    by_pose[at + 1, :, at + 1] += grams[:, there, next_pose]
    diagonal = _diagonal(M, K, p)
    diagonal[:-1] += grams[:, pose, pose]
    diagonal[1:] += grams[:, next_pose, next_pose]
    _diagonal(M[p:], K - 1, p)[...] += grams[:, next_pose, pose]
    M[rest, : (K - 1) * p] += grams[:, after, pose].transpose(1, 0, 2).reshape(-1, (K - 1) * p)
    M[rest, p : K * p] += grams[:, after, next_pose].transpose(1, 0, 2).reshape(-1, (K - 1) * p)


def _diagonal(M: Float[np.ndarray, "a b"], count: int, p: int) -> Float[np.ndarray, "k p p"]:
    """The first ``count`` blocks of p x p on a matrix' diagonal, as a view."""
    row, column = M.strides
    return np.lib.stride_tricks.as_strided(M, (count, p, p), (p * (row + column), row, column))
