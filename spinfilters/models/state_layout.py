"""Layout of a state, blocks in order with their retraction and its derivatives, and Gaussian beliefs over a layout."""

import builtins
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import pairwise
from typing import Final, NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.attitude_expressions import Expression
from spinfilters.core.compiled import Compiled
from spinfilters.core.errors import InputError, ShapeError
from spinfilters.core.linear_algebra import correlation_root
from spinfilters.core.vectorised import Vectorised
from spinfilters.core.working_time import building, built_property
from spinfilters.models.state_blocks import BLOCKS, RIGID_BODY, PointAndError, StateBlock

FULL_BLOCKS = tuple(block.name for block in RIGID_BODY)
"""Pose, velocities, centre of mass and mass distribution."""
ROTATION_BLOCKS = tuple(block.name for block in RIGID_BODY if not block.translational)
"""What a gyro alone can see."""
POSE_BLOCKS = ("t", "a")
"""What an observation of a landmark depends on; the pose of the first epoch defines frame g."""
Quantity = Callable[[dict[str, Expression]], Expression]
"""A column vector or matrix of the blocks of a state (as `StateLayout.unpack`)."""


@dataclass(frozen=True)
class StateLayout:
    """The blocks of a state, in the order of `spinfilters.models.state_blocks.BLOCKS`.

    A point ``x`` (mean_dim,) and an error ``d`` (error_dim,) hold the points and the errors of the blocks one after the other; each
    block has its own chart. The attitude is the quaternion q_ig with 4 x MRP on the body side as its error.

    Attributes
    ----------
    blocks : tuple[str, ...]
        Their names.
    """

    blocks: tuple[str, ...]

    def __post_init__(self) -> None:
        known = tuple(name for name in BLOCKS if name in self.blocks)
        if self.blocks != known:
            raise InputError(
                f"state blocks {self.blocks} must be distinct, known and in the order {tuple(BLOCKS)}"
            )

    @cached_property
    def members(self) -> tuple[StateBlock, ...]:
        """The blocks themselves."""
        return tuple(BLOCKS[name] for name in self.blocks)

    def has(self, block: StateBlock) -> bool:
        """Whether it holds a block.

        Parameters
        ----------
        block : StateBlock
            The block, or its name.

        Returns
        -------
        bool
            Whether the layout has it.
        """
        return block.name in self.blocks

    def joined(self, *blocks: StateBlock) -> "StateLayout":
        """The layout with these blocks too.

        Parameters
        ----------
        blocks : StateBlock
            Blocks to add; those that are there already change nothing.

        Returns
        -------
        StateLayout
            Blocks in the order of `BLOCKS`.
        """
        wanted = {*self.blocks, *(block.name for block in blocks)}
        return StateLayout(tuple(name for name in BLOCKS if name in wanted))

    @cached_property
    def without_translation(self) -> "StateLayout":
        """The layout of the blocks of a rotation alone."""
        return StateLayout(tuple(block.name for block in self.members if not block.translational))

    @cached_property
    def translates(self) -> bool:
        """Whether it holds a position, with the velocity and the centre of mass."""
        return self.without_translation != self

    @cached_property
    def constant(self) -> tuple[StateBlock, ...]:
        """Blocks that are the same at every time."""
        return tuple(block for block in self.members if block.constant)

    @cached_property
    def moving(self) -> tuple[StateBlock, ...]:
        """Blocks that the process model moves."""
        return tuple(block for block in self.members if not block.constant)

    @cached_property
    def curved(self) -> tuple[StateBlock, ...]:
        """Blocks whose errors a reset transforms; where there are none, `reset_jacobian` is the identity."""
        return tuple(block for block in self.members if block.chart.reset_jacobian is not None)

    @cached_property
    def constant_indices(self) -> Int[np.ndarray, " c"]:
        """Components of a point that belong to constant blocks."""
        every = np.arange(self.mean_dim)
        return np.concatenate([every[:0], *[every[self.mean_slice(block.name)] for block in self.constant]])

    @cached_property
    def error_dim(self) -> int:
        """Number of error components."""
        return sum(block.dimension for block in self.members)

    @cached_property
    def mean_dim(self) -> int:
        """Number of components of a point: one more than the error where there is an attitude."""
        return sum(block.mean_size for block in self.members)

    def slice(self, block: str) -> builtins.slice:
        """Slice of a block in an error vector.

        Parameters
        ----------
        block : str
            Name of a block of the layout.

        Returns
        -------
        builtins.slice
            Of the block's components.
        """
        return self._error_slices[block]

    def mean_slice(self, block: str) -> builtins.slice:
        """Slice of a block in a point.

        Parameters
        ----------
        block : str
            Name of a block of the layout.

        Returns
        -------
        builtins.slice
            Of the block's components; those of the attitude hold a quaternion.
        """
        return self._mean_slices[block]

    def block_of(self, component: int) -> StateBlock:
        """The block to which a component of the error belongs.

        Parameters
        ----------
        component : int
            Number of a component of the error, from 0.

        Returns
        -------
        StateBlock
            The block that it belongs to.
        """
        return next(block for block in self.members if component < self.slice(block.name).stop)

    def unpack(self, x: Expression) -> dict[str, Expression]:
        """Blocks of a symbolic point by `StateBlock.symbol`: their names, and ``q`` of the attitude.

        Parameters
        ----------
        x : Expression
            Point, (mean_dim,).

        Returns
        -------
        dict[str, Expression]
            Expression of each block.
        """
        return {block.symbol: x[self.mean_slice(block.name)] for block in self.members}

    def pack(self, values: dict[str, Expression]) -> Expression:
        """The inverse of `unpack`.

        Parameters
        ----------
        values : dict[str, Expression]
            Expression of each block, by its symbol.

        Returns
        -------
        Expression
            Point, (mean_dim,).
        """
        return ca.vertcat(*[values[block.symbol] for block in self.members])

    def retract_expression(self, x: Expression, d: Expression) -> Expression:
        """x [+] d, symbolically.

        Parameters
        ----------
        x : Expression
            Point, (mean_dim,).
        d : Expression
            Error, (error_dim,).

        Returns
        -------
        Expression
            Point at that error from x; its quaternion is not normalised again.
        """
        parts = []
        for block in self.members:
            parts.append(block.chart.retract(x[self.mean_slice(block.name)], d[self.slice(block.name)]))
        return ca.vertcat(*parts)

    def local_expression(self, x: Expression, y: Expression) -> Expression:
        """y [-] x, the error that takes x to y, symbolically; the attitude error goes the short way round.

        Parameters
        ----------
        x : Expression
            Point from which the error is counted, (mean_dim,).
        y : Expression
            Point to which it leads, (mean_dim,).

        Returns
        -------
        Expression
            Error, (error_dim,).
        """
        return self._difference(x, y, [block.chart.local for block in self.members])

    def near_local_expression(self, x: Expression, y: Expression) -> Expression:
        """`local_expression` to first order at y = x: the same derivative there, and a shorter expression.

        Parameters
        ----------
        x : Expression
            Point from which the error is counted, (mean_dim,).
        y : Expression
            Point near x, (mean_dim,).

        Returns
        -------
        Expression
            Error to first order, (error_dim,).
        """
        return self._difference(x, y, [block.chart.near_local for block in self.members])

    def _difference(self, x: Expression, y: Expression, how: list[PointAndError]) -> Expression:
        places = [self.mean_slice(block.name) for block in self.members]
        return ca.vertcat(*[local(x[at], y[at]) for local, at in zip(how, places, strict=True)])

    def retract(
        self, x: Float[np.ndarray, "*batch m"], d: Float[np.ndarray, "*batch n"]
    ) -> Float[np.ndarray, "*batch m"]:
        """The point that lies at error ``d`` from ``x``, its quaternion normalised.

        Parameters
        ----------
        x : ndarray of float, shape (..., m)
            Points.
        d : ndarray of float, shape (..., n)
            Errors, each of its point or one of all.

        Returns
        -------
        ndarray of float, shape (..., m)
            Points at these errors.
        """
        return self._retract(x, d)[0]

    def local(
        self, x: Float[np.ndarray, "*batch m"], y: Float[np.ndarray, "*batch m"]
    ) -> Float[np.ndarray, "*batch n"]:
        """The error that takes ``x`` to ``y``.

        Parameters
        ----------
        x : ndarray of float, shape (..., m)
            Points from which errors are counted.
        y : ndarray of float, shape (..., m)
            Points to which they lead.

        Returns
        -------
        ndarray of float, shape (..., n)
            Errors; that of an attitude goes the short way round.
        """
        return self._local(x, y)[0]

    def local_pairs(
        self, x: Float[np.ndarray, "k m"], y: Float[np.ndarray, "k m"]
    ) -> Float[np.ndarray, "k n"]:
        """`local` of many pairs of points, side by side.

        Parameters
        ----------
        x : ndarray of float, shape (k, m)
            Points from which errors are counted.
        y : ndarray of float, shape (k, m)
            Points to which they lead, of each the one in the same row.

        Returns
        -------
        ndarray of float, shape (k, n)
            Errors.
        """
        return _local_lanes(self)(x, y, rows=(None, None))[0]

    def retract_each(
        self, x: Float[np.ndarray, " m"], d: Float[np.ndarray, "k n"]
    ) -> Float[np.ndarray, "k m"]:
        """`retract` of one point by many errors, side by side.

        Parameters
        ----------
        x : ndarray of float, shape (m,)
            The point.
        d : ndarray of float, shape (k, n)
            Errors, such as those of sigma points.

        Returns
        -------
        ndarray of float, shape (k, m)
            Points at these errors.
        """
        return _retract_lanes(self)(x[np.newaxis], d, rows=(None, None))[0]

    def local_each(self, x: Float[np.ndarray, " m"], y: Float[np.ndarray, "k m"]) -> Float[np.ndarray, "k n"]:
        """`local` of many points about one, side by side.

        Parameters
        ----------
        x : ndarray of float, shape (m,)
            Point from which errors are counted.
        y : ndarray of float, shape (k, m)
            Points to which they lead.

        Returns
        -------
        ndarray of float, shape (k, n)
            Errors; that of an attitude goes the short way round.
        """
        return _local_lanes(self)(x[np.newaxis], y, rows=(None, None))[0]

    def reset_jacobian(self, d: Float[np.ndarray, "*batch n"]) -> Float[np.ndarray, "*batch n n"]:
        """Derivative of the error about retract(x, d) with respect to the error about x, at d.

        Parameters
        ----------
        d : ndarray of float, shape (..., n)
            Errors that have been folded into a point.

        Returns
        -------
        ndarray of float, shape (..., n, n)
            Derivatives, the identity for blocks whose errors add.
        """
        return self._reset(d)[0]

    @cached_property
    def _error_slices(self) -> dict[str, builtins.slice]:
        return _slices(self.blocks, [block.dimension for block in self.members])

    @cached_property
    def _mean_slices(self) -> dict[str, builtins.slice]:
        return _slices(self.blocks, [block.mean_size for block in self.members])

    @built_property
    def _retract(self) -> Compiled:
        return _retract_function(self)

    @built_property
    def _local(self) -> Compiled:
        return _local_function(self)

    @built_property
    def _reset(self) -> Compiled:
        return _reset_function(self)

    @property
    def retraction(self) -> Compiled:
        """`retract` as a compiled function, for other compiled code to call."""
        return self._retract

    @property
    def differences(self) -> Compiled:
        """`local` as a compiled function."""
        return self._local

    @property
    def many_retractions(self) -> Vectorised:
        """`retract_each`, for other compiled code to call."""
        return _retract_lanes(self)

    @property
    def many_differences(self) -> Vectorised:
        """`local_each`, for other compiled code to call."""
        return _local_lanes(self)

    @property
    def resetting(self) -> Compiled:
        """`reset_jacobian` as a compiled function."""
        return self._reset

    @property
    def many_resets(self) -> "MatrixEntries":
        """`reset_jacobian` of many errors side by side, for other compiled code to call."""
        return _reset_lanes(self)

    def origin(self) -> Float[np.ndarray, " m"]:
        """The point with identity attitude and zeros elsewhere.

        Returns
        -------
        ndarray of float, shape (m,)
            Point of the layout.
        """
        return np.array([number for block in self.members for number in block.origin])


EVERY: Final = builtins.slice(None)


def error_derivative(y: Expression, d: ca.SX, columns: Sequence[int] | builtins.slice = EVERY) -> Expression:
    """dy/dd at d = 0 of an error d, or of the chosen components of it."""
    return ca.substitute(ca.jacobian(y, d)[:, columns], d, ca.SX.zeros(*d.shape))


@building()
def with_error_jacobian(layout: StateLayout, name: str, quantity: Quantity) -> Compiled:
    """x -> (y, dy/dd at d = 0) with y = quantity(x [+] d), over any leading axes of x.

    The derivative goes through the layout's own retraction, so it is right for every error chart. A matrix y
    comes as the column of its columns. Interpreted at first: one history does not repay a compiler.
    """
    x, d = ca.SX.sym("x", layout.mean_dim), ca.SX.sym("d", layout.error_dim)
    moved = ca.vec(quantity(layout.unpack(layout.retract_expression(x, d))))
    value, jacobian = (
        ca.substitute(y, d, ca.DM.zeros(layout.error_dim)) for y in (moved, ca.jacobian(moved, d))
    )
    return Compiled.late(ca.Function(name, [x], [value, jacobian], ["x"], ["y", "Y"]))


@cache
@building()
def _retract_function(layout: StateLayout) -> Compiled:
    """Retraction as a function, cached for equal layouts."""
    x, d = ca.SX.sym("x", layout.mean_dim), ca.SX.sym("d", layout.error_dim)
    y = layout.unpack(layout.retract_expression(x, d))
    for block in layout.members:
        if block.chart.normalised is not None:
            y[block.symbol] = block.chart.normalised(y[block.symbol])
    return Compiled(ca.Function("retract", [x, d], [layout.pack(y)], ["x", "d"], ["y"]))


@cache
@building()
def _local_function(layout: StateLayout) -> Compiled:
    x, y = ca.SX.sym("x", layout.mean_dim), ca.SX.sym("y", layout.mean_dim)
    return Compiled(ca.Function("local", [x, y], [layout.local_expression(x, y)], ["x", "y"], ["d"]))


@cache
@building()
def _retract_lanes(layout: StateLayout) -> Vectorised:
    return Vectorised(_retract_function(layout).function)


@cache
@building()
def _local_lanes(layout: StateLayout) -> Vectorised:
    return Vectorised(_local_function(layout).function)


@cache
@building()
def _reset_function(layout: StateLayout) -> Compiled:
    d, jacobian = _reset_expression(layout)
    return Compiled(ca.Function("reset_jacobian", [d], [jacobian], ["d"], ["J"]))


def _reset_expression(layout: StateLayout) -> tuple[ca.SX, ca.SX]:
    """An error and the reset Jacobian at it, the identity outside the curved blocks."""
    d = ca.SX.sym("d", layout.error_dim)
    jacobian = ca.SX.eye(layout.error_dim)
    for block in layout.curved:
        at = layout.slice(block.name)
        assert block.chart.reset_jacobian is not None
        jacobian[at, at] = block.chart.reset_jacobian(d[at])
    return d, jacobian


@cache
@building()
def _reset_lanes(layout: StateLayout) -> "MatrixEntries":
    d, jacobian = _reset_expression(layout)
    entries = ca.Function("reset_entries", [d], [entries_of(jacobian)])
    return MatrixEntries(Vectorised(entries), Places.of(jacobian))


class Places(NamedTuple):
    """Places of those entries of a matrix that may not be zero.

    Attributes
    ----------
    row, column : ndarray of int, shape (k,)
        Of each entry.
    """

    row: Int[np.ndarray, " k"]
    column: Int[np.ndarray, " k"]

    @classmethod
    def of(cls, matrix: ca.SX) -> "Places":
        """Those of a matrix's structural nonzeros, in their order."""
        row, column = matrix.sparsity().get_triplet()
        return cls(np.array(row, dtype=np.int64), np.array(column, dtype=np.int64))


def entries_of(matrix: ca.SX) -> ca.SX:
    """A matrix's structural nonzeros as a column, in the order of `Places.of`."""
    return ca.densify(ca.vertcat(*matrix.nonzeros()))  # pyright: ignore[reportCallIssue, reportArgumentType]


class MatrixEntries(NamedTuple):
    """A function that gives those entries of a matrix that may not be zero.

    Attributes
    ----------
    function : Vectorised
        Of the entries.
    places : Places
        Of each.
    """

    function: Vectorised
    places: Places


def _slices(blocks: tuple[str, ...], sizes: list[int]) -> dict[str, slice]:
    edges = np.concatenate([[0], np.cumsum(sizes)]).tolist()
    return {block: slice(start, stop) for block, (start, stop) in zip(blocks, pairwise(edges), strict=True)}


@dataclass(frozen=True)
class Gaussian:
    """Mean and covariance of a state.

    The covariance is held as a factor, P = factor factor', so that rounding cannot make it indefinite.

    Attributes
    ----------
    layout : StateLayout
        Which blocks the state holds.
    mean : Float[np.ndarray, ' m']
        (mean_dim,) a point of the layout.
    factor : Float[np.ndarray, 'n n']
        (error_dim, error_dim) any square root of the error covariance.
    """

    layout: StateLayout
    mean: Float[np.ndarray, " m"]
    factor: Float[np.ndarray, "n n"]

    def __post_init__(self) -> None:
        n = self.layout.error_dim
        if self.mean.shape != (self.layout.mean_dim,) or self.factor.shape != (n, n):
            raise ShapeError(
                f"a Gaussian over {self.layout.blocks} needs a mean of shape ({self.layout.mean_dim},) and a factor of shape "
                f"({n}, {n}), got {self.mean.shape} and {self.factor.shape}"
            )

    @classmethod
    def from_covariance(
        cls, layout: StateLayout, mean: Float[np.ndarray, " m"], covariance: Float[np.ndarray, "n n"]
    ) -> "Gaussian":
        """Gaussian of a symmetric positive definite covariance.

        Raises
        ------
        InputError
            When the covariance is not positive definite; it is not repaired.
        """
        scale = np.sqrt(np.diag(covariance))
        if not np.all(np.isfinite(scale) & (scale > 0)):
            raise InputError(
                f"covariance has the diagonal {np.diag(covariance).tolist()}; every variance must be positive"
            )
        try:
            factor = scale[:, None] * correlation_root(covariance)
        except np.linalg.LinAlgError as error:
            raise InputError(
                "covariance is not positive definite; give a symmetric positive definite matrix"
            ) from error
        return cls(layout, mean, factor)

    def whitened(self, rows: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
        """Rows of errors in standard deviations: factor^-1 rows. LinAlgError: a singular factor."""
        return np.linalg.solve(self.factor, rows)

    @property
    def state(self) -> "Gaussian":
        """The belief itself."""
        return self

    @property
    def joint(self) -> None:
        """None: a belief of the state alone."""
        return None

    @property
    def covariance(self) -> Float[np.ndarray, "n n"]:
        """P = factor factor', positive semidefinite by construction."""
        return self.factor @ self.factor.T

    @property
    def std(self) -> Float[np.ndarray, " n"]:
        """Standard deviation of every error component."""
        return np.sqrt(np.einsum("ij,ij->i", self.factor, self.factor))
