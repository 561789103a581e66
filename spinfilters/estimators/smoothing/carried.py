"""What frames and landmarks that have left still say of the frames within: a square root, kept at first estimates.

It is a quadratic |R e - y|^2 in the errors e of poses, constants and the oldest frame's velocities about the points where each
was when it was first carried. Its directions that a change of frame g moves along must stay those that it was made with, or
moved estimates
would seem to have measured the gauge: about a new point R is corrected by R_now N_now = R N_first, with N the gauge's directions
(Huang et al. 2010 call for it; here the oldest pose takes the correction).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.smoothing.unknowns import Unknowns
from spinfilters.models.gauge import gauge_directions


@dataclass(frozen=True)
class Carried:
    """A quadratic over F frames.

    Attributes
    ----------
    unknowns: how the F frames' errors are split; columns: their poses, the constants, the chain of the first frame.
    first: (F, m) points at which each was first carried.   root: (q, q) R.   right: (q,) y.   lost: the least cost there is.
    """

    unknowns: Unknowns
    first: Float[np.ndarray, "F m"]
    root: Float[np.ndarray, "q q"]
    right: Float[np.ndarray, " q"]
    lost: float

    @cached_property
    def gram(self) -> Float[np.ndarray, "q q"]:
        """R'R."""
        return self.root.T @ self.root

    @cached_property
    def _gauge(self) -> Float[np.ndarray, "q 6"]:
        return gauge_columns(self.unknowns, self.first)

    @cached_property
    def knows_constants(self) -> bool:
        """Whether frames have left, not landmarks alone: those say nothing of constants and velocities."""
        return bool(self.root[:, len(self.first) * len(self.unknowns.pose) :].any())

    def at(self, trajectory: Float[np.ndarray, "k m"]) -> "CarriedAt":
        """About a trajectory that begins with the F frames."""
        here = trajectory[: len(self.first)]
        away = column_errors(self.unknowns, self.unknowns.layout.local(self.first, here))
        rest = self.right - self.root @ away
        gram, gradient, p = self.gram.copy(), self.root.T @ rest, len(self.unknowns.pose)
        if p:
            shift = self.shift(here)
            moved = self.gram @ shift
            gram[:, :p] += moved
            gram[:p] += moved.T
            gram[:p, :p] += shift.T @ moved
            gradient[:p] += shift.T @ gradient
        return CarriedAt(self, gram, gradient, float(rest @ rest) + self.lost)

    def shift(self, here: Float[np.ndarray, "F m"]) -> Float[np.ndarray, "q p"]:
        """D in R_now = R (I + D on the oldest pose's columns)."""
        p = len(self.unknowns.pose)
        now = gauge_columns(self.unknowns, here)
        return np.linalg.solve(now[:p].T, (self._gauge - now).T).T

    def root_at(self, here: Float[np.ndarray, "F m"]) -> Float[np.ndarray, "q q1"]:
        """Rows [R_now | y_now] about other points of the F frames."""
        away = column_errors(self.unknowns, self.unknowns.layout.local(self.first, here))
        root, p = self.root.copy(), len(self.unknowns.pose)
        if p:
            root[:, :p] += self.root @ self.shift(here)
        return np.concatenate([root, (self.right - self.root @ away)[:, None]], axis=1)


@dataclass(frozen=True)
class CarriedAt:
    """A carried quadratic linearised: its Gram matrix, gradient and cost."""

    carried: Carried
    gram: Float[np.ndarray, "q q"]
    gradient: Float[np.ndarray, " q"]
    cost: float

    @property
    def frames(self) -> int:
        """How many frames it reaches over."""
        return len(self.carried.first)

    def add_to(
        self, M: Float[np.ndarray, "w r"], D: Float[np.ndarray, "k v v"], G: Float[np.ndarray, "k v w"]
    ) -> None:
        """Into the linear problem of a window, in place."""
        unknowns, K = self.carried.unknowns, len(D)
        p, c = len(unknowns.pose), len(unknowns.constant)
        poses, constants = slice(0, self.frames * p), slice(self.frames * p, self.frames * p + c)
        chain, to = slice(constants.stop, None), slice(K * p, K * p + c)
        M[poses, poses] += self.gram[poses, poses]
        M[to, poses] += self.gram[constants, poses]
        M[to, to] += self.gram[constants, constants]
        M[-1, poses] += self.gradient[poses]
        M[-1, to] += self.gradient[constants]
        D[0] += self.gram[chain, chain]
        G[0, :, poses] += self.gram[chain, poses]
        G[0, :, to] += self.gram[chain, constants]
        G[0, :, -1] += self.gradient[chain]


def column_errors(unknowns: Unknowns, errors: Float[np.ndarray, "F n"]) -> Float[np.ndarray, " q"]:
    """Errors of F frames in the order of a carried quadratic's columns."""
    poses = errors[:, unknowns.pose].reshape(-1)
    return np.concatenate([poses, errors[0, unknowns.constant], errors[0, unknowns.chain]])


def gauge_columns(unknowns: Unknowns, points: Float[np.ndarray, "F m"]) -> Float[np.ndarray, "q 6"]:
    """Directions of the gauge in the order of a carried quadratic's columns."""
    every = gauge_directions(unknowns.layout, points)
    poses = every[:, unknowns.pose].reshape(-1, every.shape[2])
    return np.concatenate([poses, every[0, unknowns.constant], every[0, unknowns.chain]])
