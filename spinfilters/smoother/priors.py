"""Order of the unknowns of a smoothing problem, and its priors: of the first state, and of what was marginalised."""

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple, Protocol

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.compiled import address, addresses
from spinfilters.core.errors import InputError
from spinfilters.models.gauge import gauge_directions, gauge_function
from spinfilters.models.state_blocks import StateBlock
from spinfilters.models.state_layout import POSE_BLOCKS, StateLayout
from spinfilters.smoother.kernels import kernels
from spinfilters.smoother.linearisation_kernels import PriorStructure, charts_of


class StatePrior(Protocol):
    """A Gaussian of one state: a `FirstStatePrior`, or a `Gaussian`."""

    @property
    def mean(self) -> Float[np.ndarray, " m"]:
        """(mean_dim,) state."""
        ...

    @property
    def factor(self) -> Float[np.ndarray, "n n"]:
        """(n, n) square root of its covariance."""
        ...

    def whitened(self, rows: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
        """Rows of errors in its standard deviations: factor^-1 rows. LinAlgError: a singular factor."""
        ...


@dataclass(frozen=True)
class FirstStatePrior:
    """Prior of the first state: independent, or with correlations.

    Attributes
    ----------
    mean : (m,) float array
        Point of the layout.
    std : (n,) float array
        Standard deviations of its error.
    root : (n, n) float array or None
        Square root of the covariance, lower triangular, where components are correlated; None of an independent prior.
    """

    mean: Float[np.ndarray, " m"]
    std: Float[np.ndarray, " n"]
    root: Float[np.ndarray, "n n"] | None = None

    @classmethod
    def of_factor(cls, mean: Float[np.ndarray, " m"], factor: Float[np.ndarray, "n n"]) -> "FirstStatePrior":
        """Prior of a covariance's square root, lower triangular."""
        std = np.linalg.norm(factor, axis=1)
        is_diagonal = np.count_nonzero(factor) == np.count_nonzero(np.diag(factor))
        return cls(mean, np.diag(factor).copy() if is_diagonal else std, None if is_diagonal else factor)

    @property
    def factor(self) -> Float[np.ndarray, "n n"]:
        """Square root of the covariance."""
        return self._factor

    def whitened(self, rows: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
        """Rows of errors in standard deviations, as `StatePrior.whitened`."""
        if not self.std.all():
            raise np.linalg.LinAlgError("a standard deviation is zero")
        if self.root is not None:
            return np.linalg.solve(self.root, rows)
        return rows * (1.0 / self.std)[:, None]

    @cached_property
    def _factor(self) -> Float[np.ndarray, "n n"]:
        return np.diag(self.std) if self.root is None else self.root


@dataclass(frozen=True)
class VariableOrdering:
    """Errors of ``epochs`` epochs over a layout.

    Attributes
    ----------
    has_landmarks : bool
        Whether landmark observations couple the poses of different epochs.
    """

    layout: StateLayout
    epochs: int
    has_landmarks: bool

    def __post_init__(self) -> None:
        if self.has_landmarks and self.layout.blocks[:2] != POSE_BLOCKS:
            raise InputError(
                f"landmarks need a state that begins with blocks t, a; the layout has {self.layout.blocks}"
            )

    @property
    def pose(self) -> Int[np.ndarray, " p"]:
        """Error components of an epoch coupled by landmark observations."""
        return self.components.pose

    @property
    def tridiagonal(self) -> Int[np.ndarray, " v"]:
        """Error components of an epoch coupled only to its neighbours in time."""
        return self.components.tridiagonal

    @property
    def constant(self) -> Int[np.ndarray, " c"]:
        """Error components that are the same in every epoch."""
        return self.components.constant

    @property
    def moving(self) -> Int[np.ndarray, " d"]:
        """Pose components, then tridiagonal ones."""
        return self.components.moving

    @cached_property
    def components(self) -> "ErrorComponents":
        """Those of all epochs alike."""
        return error_components(self.layout, self.has_landmarks)

    @property
    def order(self) -> Int[np.ndarray, " n"]:
        """All components of an epoch: pose, tridiagonal, constant.

        Chains are eliminated first, where each meets only its neighbours; poses stay because landmarks tie them to one another, and
        constants come last because every epoch meets them: what is eliminated before them stays sparse.
        """
        return self.components.order

    @cached_property
    def curved_columns(self) -> list[tuple[slice, Int[np.ndarray, "e d"]]]:
        """Slice in an error and columns in a prior of every block whose errors a reset transforms, by epoch.

        A prior's columns are the poses of all epochs, the constants, and the tridiagonal components of the first epoch.
        """
        p, behind = len(self.pose), self.epochs * len(self.pose)
        # component of an error -> its column for the first epoch, and how far apart the epochs' columns are
        first = {int(each): (k, p) for k, each in enumerate(self.pose)}
        rest = np.concatenate([self.constant, self.tridiagonal])
        first |= {int(each): (behind + k, 0) for k, each in enumerate(rest)}
        found = []
        for block in self.layout.curved:
            place = self.layout.slice(block.name)
            begin, apart = first[place.start]
            epochs = np.arange(self.epochs if apart else 1)
            found.append((place, begin + epochs[:, np.newaxis] * apart + np.arange(block.dimension)))
        return found

    @cached_property
    def curved_places(self) -> tuple[Int[np.ndarray, " b"], Int[np.ndarray, " b"]]:
        """Of every block of `curved_columns` the first epoch's first column, and how far apart the epochs' columns are."""
        first = [int(columns[0, 0]) for _, columns in self.curved_columns]
        apart = [
            int(columns[1, 0] - columns[0, 0]) if len(columns) > 1 else 0
            for _, columns in self.curved_columns
        ]
        return np.array(first, dtype=np.int64), np.array(apart, dtype=np.int64)

    @property
    def separator_dim(self) -> int:
        """Dimension of the separator: all poses, then the constants."""
        return self.epochs * len(self.pose) + len(self.constant)

    def errors(
        self, separator_step: Float[np.ndarray, " r"], tridiagonal_step: Float[np.ndarray, "k v"]
    ) -> Float[np.ndarray, "k n"]:
        """Each epoch's error in the order of the layout."""
        p = len(self.pose)
        result = np.empty((self.epochs, self.layout.error_dim))
        # Separator step: poses epoch by epoch, then the constants, which are the same in every epoch.
        result[:, self.pose] = separator_step[: self.epochs * p].reshape(self.epochs, p)
        result[:, self.tridiagonal] = tridiagonal_step
        result[:, self.constant] = separator_step[self.epochs * p :]
        return result


class ErrorComponents(NamedTuple):
    """Error components of any epoch by how they are eliminated; see `VariableOrdering`."""

    pose: Int[np.ndarray, " p"]
    tridiagonal: Int[np.ndarray, " v"]
    constant: Int[np.ndarray, " c"]
    moving: Int[np.ndarray, " d"]
    order: Int[np.ndarray, " n"]


@lru_cache(maxsize=64)
def error_components(layout: StateLayout, has_landmarks: bool) -> ErrorComponents:
    """Components of a layout, the same arrays for all windows."""

    def components_of(blocks: Sequence[StateBlock]) -> Int[np.ndarray, " b"]:
        every = np.arange(layout.error_dim)
        return np.concatenate([every[:0], *[every[layout.slice(block.name)] for block in blocks]])

    coupled = [block for block in layout.moving if has_landmarks and block.name in POSE_BLOCKS]
    pose = components_of(coupled)
    tridiagonal = components_of([block for block in layout.moving if block not in coupled])
    constant, moving = components_of(layout.constant), np.concatenate([pose, tridiagonal])
    return ErrorComponents(pose, tridiagonal, constant, moving, np.concatenate([moving, constant]))


Resets = list[tuple[Int[np.ndarray, "e d"], Float[np.ndarray, "e d d"]]]
"""Columns of each block with a curved chart, by epoch, and a Jacobian of each epoch's."""


@dataclass(frozen=True)
class MarginalizationPrior:
    """A quadratic over F epochs.

    Attributes
    ----------
    ordering : VariableOrdering
        How the F epochs' errors are split; columns: their poses, the constants, the chain of the first epoch.
    first : ndarray of float, shape (F, m)
        Points about which each epoch was first linearised in a prior.
    information_sqrt : ndarray of float, shape (q, q)
        Square root R of the information.
    right : ndarray of float, shape (q,)
        Right-hand side y.
    constant_cost : float
        Constant of the marginalized cost: its least value.
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
    def gauge(self) -> Float[np.ndarray, "q 6"]:
        """Directions of the gauge at the first estimates."""
        return gauge_columns(self.ordering, self.first)

    @cached_property
    def knows_constants(self) -> bool:
        """Whether epochs were marginalized, since landmarks alone determine no constants or velocities."""
        return bool(self.information_sqrt[:, len(self.first) * len(self.ordering.pose) :].any())

    def at(self, trajectory: Float[np.ndarray, "k m"]) -> "LinearizedPrior":
        """Linearised about a trajectory that begins with the F epochs."""
        here = trajectory[: len(self.first)]
        if (made := self._linearised_in_c(here)) is not None:
            return made
        errors = self.ordering.layout.local(self.first, here)
        rest = self.right - self.information_sqrt @ column_errors(self.ordering, errors)
        resets = column_resets(self.ordering, errors)
        # R' R and R' rest by errors about here, d = away + G^-1 e with the reset Jacobian G of each epoch
        by_trial = inverse_resets(resets)
        gram = with_columns_reset(with_columns_reset(self.gram, by_trial).T, by_trial)
        gradient = with_columns_reset((rest @ self.information_sqrt)[None], by_trial)[0]
        p = len(self.ordering.pose)
        if p:
            shift = self.shift(here, resets)
            moved = gram @ shift
            gram[:, :p] += moved
            gram[:p] += moved.T
            gram[:p, :p] += shift.T @ moved
            gradient[:p] += shift.T @ gradient
        return LinearizedPrior(self, gram, gradient, float(rest @ rest) + self.constant_cost)

    def _linearised_in_c(self, here: Float[np.ndarray, "F m"]) -> "LinearizedPrior | None":
        """`at` in one call; None without compiled code."""
        library, call = kernels(), prior_structure(self.ordering, self.first, self)
        if library is None or call is None:
            return None
        gram, gradient, here = np.empty_like(self.gram), np.empty_like(self.right), np.ascontiguousarray(here)
        arrays = addresses(here, gram, gradient)
        cost = library.linearise_prior(*call.addresses, *arrays)
        if cost < 0:
            raise MemoryError("no memory to linearise what was marginalized")
        return LinearizedPrior(self, gram, gradient, cost)

    def shift(self, here: Float[np.ndarray, "F m"], resets: Resets) -> Float[np.ndarray, "q p"]:
        """D in R_now = R G^-1 (I + D on the oldest pose's columns), with the reset Jacobians G at ``here``."""
        p = len(self.ordering.pose)
        now = gauge_columns(self.ordering, here)
        turned = [(columns, jacobians.swapaxes(1, 2)) for columns, jacobians in resets]
        then = with_columns_reset(self.gauge.T, turned).T
        return np.linalg.solve(now[:p].T, (then - now).T).T


class PriorCall(NamedTuple):
    """First arguments of the functions in C that take a prior, and what keeps them alive."""

    charts: int
    gauge: int
    structure: PriorStructure
    kept: tuple[np.ndarray, ...]

    @property
    def addresses(self) -> tuple[int, int, int]:
        """Of charts, of the loop of directions of the gauge, and of the prior."""
        return self.charts, self.gauge, ctypes.addressof(self.structure)


def prior_structure(
    ordering: VariableOrdering, first: Float[np.ndarray, "F m"], prior: MarginalizationPrior | None = None
) -> PriorCall | None:
    """The columns of a prior about some first estimates, with its numbers where they are given; None without compiled code."""
    has_poses = len(ordering.pose) > 0
    charts = None if kernels() is None else charts_of(ordering.layout)
    loop = gauge_function(ordering.layout).loop if has_poses and charts is not None else 0
    if charts is None or loop is None:
        return None
    components = (ordering.pose, ordering.constant, ordering.tridiagonal)
    columns = (*components, *ordering.curved_places, np.ascontiguousarray(first))
    numbers, gauge, least = (), None, 0.0
    if prior is not None:
        numbers, least = (prior.information_sqrt, prior.right, prior.gram), prior.constant_cost
        gauge = address(prior.gauge) if has_poses else None
    structure = PriorStructure(
        *(len(first), *map(len, components), *addresses(*columns)),
        *(addresses(*numbers) if numbers else (None,) * 3),
        *(gauge, least),
    )
    return PriorCall(charts.address, loop, structure, columns)


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


def column_resets(ordering: VariableOrdering, errors: Float[np.ndarray, "F n"]) -> Resets:
    """Reset Jacobians, at some errors, of the blocks whose charts are curved, with their columns in a prior."""
    jacobians = ordering.layout.reset_jacobian(errors)
    return [(columns, jacobians[: len(columns), place, place]) for place, columns in ordering.curved_columns]


def inverse_resets(resets: Resets) -> Resets:
    """The inverse of each Jacobian."""
    return [(columns, np.linalg.inv(jacobians)) for columns, jacobians in resets]


def with_columns_reset(rows: Float[np.ndarray, "r x"], resets: Resets) -> Float[np.ndarray, "r x"]:
    """Rows times the block-diagonal matrix of the Jacobians; columns of other blocks, and those behind the prior's, stay."""
    result = rows.copy()
    for columns, jacobians in resets:
        # (e, r, d) @ (e, d, d): each epoch's columns by its own Jacobian
        turned = rows[:, columns].swapaxes(0, 1) @ jacobians
        result[:, columns] = turned.swapaxes(0, 1)
    return result


def gauge_columns(ordering: VariableOrdering, points: Float[np.ndarray, "F m"]) -> Float[np.ndarray, "q 6"]:
    """Directions of the gauge in the order of the prior's columns."""
    every = gauge_directions(ordering.layout, points)
    poses = every[:, ordering.pose].reshape(-1, every.shape[2])
    return np.concatenate([poses, every[0, ordering.constant], every[0, ordering.tridiagonal]])
