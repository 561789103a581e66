"""Marginalization prior of removed epochs and landmarks. A square-root information matrix, kept at first estimates.

It is a quadratic |R e - y|^2 in the errors e of poses, constants and the oldest epoch's velocities about the points where each
was when it was first carried. Its directions that a change of frame g moves along must stay those that it was made with, or
moved estimates
would seem to have measured the gauge: about a new point R is corrected by R_now N_now = R N_first, with N the gauge's directions
(Huang et al. 2010 call for it; here the oldest pose takes the correction).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.smoothing.factors.variable_ordering import VariableOrdering
from spinfilters.models.gauge import gauge_directions


@dataclass(frozen=True)
class MarginalizationPrior:
    """A quadratic over F epochs.

    Attributes
    ----------
    ordering: how the F epochs' errors are split; columns: their poses, the constants, the chain of the first epoch.
    first: (F, m) points at which each was first carried.   information_sqrt: (q, q) R.   right: (q,) y.   constant_cost: the
        least cost there is.
    """

    ordering: VariableOrdering
    first: Float[np.ndarray, "F m"]
    information_sqrt: Float[np.ndarray, "q q"]
    right: Float[np.ndarray, " q"]
    constant_cost: float

    @cached_property
    def gram(self) -> Float[np.ndarray, "q q"]:
        """R'R."""
        return self.information_sqrt.T @ self.information_sqrt

    @cached_property
    def _gauge(self) -> Float[np.ndarray, "q 6"]:
        return gauge_columns(self.ordering, self.first)

    @cached_property
    def knows_constants(self) -> bool:
        """Whether epochs were marginalized, since landmarks alone tell no constants or velocities."""
        return bool(self.information_sqrt[:, len(self.first) * len(self.ordering.pose) :].any())

    def at(self, trajectory: Float[np.ndarray, "k m"]) -> "LinearizedPrior":
        """Linearised about a trajectory that begins with the F epochs."""
        here = trajectory[: len(self.first)]
        away = column_errors(self.ordering, self.ordering.layout.local(self.first, here))
        rest = self.right - self.information_sqrt @ away
        gram, gradient, p = self.gram.copy(), self.information_sqrt.T @ rest, len(self.ordering.pose)
        if p:
            shift = self.shift(here)
            moved = self.gram @ shift
            gram[:, :p] += moved
            gram[:p] += moved.T
            gram[:p, :p] += shift.T @ moved
            gradient[:p] += shift.T @ gradient
        return LinearizedPrior(self, gram, gradient, float(rest @ rest) + self.constant_cost)

    def shift(self, here: Float[np.ndarray, "F m"]) -> Float[np.ndarray, "q p"]:
        """D in R_now = R (I + D on the oldest pose's columns)."""
        p = len(self.ordering.pose)
        now = gauge_columns(self.ordering, here)
        return np.linalg.solve(now[:p].T, (self._gauge - now).T).T


@dataclass(frozen=True)
class LinearizedPrior:
    """Marginalization prior linearised: its Gram matrix, gradient and cost."""

    marginal_prior: MarginalizationPrior
    gram: Float[np.ndarray, "q q"]
    gradient: Float[np.ndarray, " q"]
    cost: float

    @property
    def epochs(self) -> int:
        """Number of epochs that the prior reaches over."""
        return len(self.marginal_prior.first)

    def add_to(
        self, M: Float[np.ndarray, "w r"], D: Float[np.ndarray, "k v v"], G: Float[np.ndarray, "k v w"]
    ) -> None:
        """Into the linear problem of a window, in place."""
        ordering, K = self.marginal_prior.ordering, len(D)
        p, c = len(ordering.pose), len(ordering.constant)
        poses, constants = slice(0, self.epochs * p), slice(self.epochs * p, self.epochs * p + c)
        tridiagonal, to = slice(constants.stop, None), slice(K * p, K * p + c)
        M[poses, poses] += self.gram[poses, poses]
        M[to, poses] += self.gram[constants, poses]
        M[to, to] += self.gram[constants, constants]
        M[-1, poses] += self.gradient[poses]
        M[-1, to] += self.gradient[constants]
        D[0] += self.gram[tridiagonal, tridiagonal]
        G[0, :, poses] += self.gram[tridiagonal, poses]
        G[0, :, to] += self.gram[tridiagonal, constants]
        G[0, :, -1] += self.gradient[tridiagonal]


def column_errors(ordering: VariableOrdering, errors: Float[np.ndarray, "F n"]) -> Float[np.ndarray, " q"]:
    """Errors of F epochs in the order of the prior's columns."""
    poses = errors[:, ordering.pose].reshape(-1)
    return np.concatenate([poses, errors[0, ordering.constant], errors[0, ordering.tridiagonal]])


def gauge_columns(ordering: VariableOrdering, points: Float[np.ndarray, "F m"]) -> Float[np.ndarray, "q 6"]:
    """Directions of the gauge in the order of the prior's columns."""
    every = gauge_directions(ordering.layout, points)
    poses = every[:, ordering.pose].reshape(-1, every.shape[2])
    return np.concatenate([poses, every[0, ordering.constant], every[0, ordering.tridiagonal]])
