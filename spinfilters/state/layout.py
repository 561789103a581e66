"""Which blocks a state holds, and how a point on its manifold and an error vector meet."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.attitude.expressions import (
    Expression,
    conjugate,
    product,
    quaternion_from_mrp,
    short_mrp_from_quaternion,
)
from spinfilters.conventions import STATE_BLOCKS
from spinfilters.errors import InputError
from spinfilters.symbolic import Compiled

ROTATION_BLOCKS = ("a", "w", "s")
"""What a gyro alone can see."""
FULL_BLOCKS = ("t", "a", "v", "w", "c", "s")
"""Pose, velocities, centre of mass and mass distribution."""


@dataclass(frozen=True)
class StateLayout:
    """The blocks of a state, in the order of `spinfilters.conventions.STATE_BLOCKS`.

    A point ``x`` (mean_dim,) holds the attitude as the quaternion q_ig, an error ``d`` (error_dim,) as 4 x MRP on the body side;
    every other block is a vector in both.
    """

    blocks: tuple[str, ...]

    def __post_init__(self) -> None:
        known = tuple(block for block in STATE_BLOCKS if block in self.blocks)
        if self.blocks != known:
            raise InputError(f"state blocks {self.blocks} must be distinct, known and in the order {tuple(STATE_BLOCKS)}")

    @cached_property
    def error_dim(self) -> int:
        """Number of error components."""
        return sum(STATE_BLOCKS[block] for block in self.blocks)

    @cached_property
    def mean_dim(self) -> int:
        """Number of components of a point: one more than the error where there is an attitude."""
        return sum(_mean_size(block) for block in self.blocks)

    def slice(self, block: str) -> slice:
        """Where a block stands in an error vector."""
        return self._error_slices[block]

    def mean_slice(self, block: str) -> slice:
        """Where a block stands in a point."""
        return self._mean_slices[block]

    def unpack(self, x: Expression) -> dict[str, Expression]:
        """Blocks of a symbolic point by name; the attitude is named ``q``."""
        return {"q" if block == "a" else block: x[self.mean_slice(block)] for block in self.blocks}

    def pack(self, values: dict[str, Expression]) -> Expression:
        """The inverse of `unpack`."""
        return ca.vertcat(*[values["q" if block == "a" else block] for block in self.blocks])

    def retract_expression(self, x: Expression, d: Expression) -> Expression:
        """x [+] d, symbolically."""
        parts = []
        for block in self.blocks:
            point, error = x[self.mean_slice(block)], d[self.slice(block)]
            parts.append(product(point, quaternion_from_mrp(error)) if block == "a" else point + error)
        return ca.vertcat(*parts)

    def local_expression(self, x: Expression, y: Expression) -> Expression:
        """y [-] x, the error that takes x to y, symbolically; the attitude error goes the short way round."""
        parts = []
        for block in self.blocks:
            here, there = x[self.mean_slice(block)], y[self.mean_slice(block)]
            parts.append(short_mrp_from_quaternion(product(conjugate(here), there)) if block == "a" else there - here)
        return ca.vertcat(*parts)

    def retract(self, x: Float[np.ndarray, "*batch m"], d: Float[np.ndarray, "*batch n"]) -> Float[np.ndarray, "*batch m"]:
        """The point that lies at error ``d`` from ``x``, its quaternion normalised."""
        return self._retract(x, d)[0]

    def local(self, x: Float[np.ndarray, "*batch m"], y: Float[np.ndarray, "*batch m"]) -> Float[np.ndarray, "*batch n"]:
        """The error that takes ``x`` to ``y``."""
        return self._local(x, y)[0]

    def reset_jacobian(self, d: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n n"]:
        """Derivative of the error about retract(x, d) with respect to the error about x, at d."""
        return self._reset(d)[0]

    @cached_property
    def _error_slices(self) -> dict[str, "slice"]:
        return _slices(self.blocks, [STATE_BLOCKS[block] for block in self.blocks])

    @cached_property
    def _mean_slices(self) -> dict[str, "slice"]:
        return _slices(self.blocks, [_mean_size(block) for block in self.blocks])

    @cached_property
    def _retract(self) -> Compiled:
        x, d = ca.SX.sym("x", self.mean_dim), ca.SX.sym("d", self.error_dim)
        y = self.unpack(self.retract_expression(x, d))
        if "q" in y:
            y["q"] = y["q"] / ca.sqrt(ca.dot(y["q"], y["q"]))
        return Compiled(ca.Function("retract", [x, d], [self.pack(y)], ["x", "d"], ["y"]))

    @cached_property
    def _local(self) -> Compiled:
        x, y = ca.SX.sym("x", self.mean_dim), ca.SX.sym("y", self.mean_dim)
        return Compiled(ca.Function("local", [x, y], [self.local_expression(x, y)], ["x", "y"], ["d"]))

    @cached_property
    def _reset(self) -> Compiled:
        d, e = ca.SX.sym("d", self.error_dim), ca.SX.sym("e", self.error_dim)
        x = self.origin()
        moved = self.local_expression(self.retract_expression(x, d), self.retract_expression(x, e))
        jacobian = ca.substitute(ca.jacobian(moved, e), e, d)
        return Compiled(ca.Function("reset_jacobian", [d], [jacobian], ["d"], ["J"]))

    def origin(self) -> Float[np.ndarray, " m"]:
        """The point with identity attitude and zeros elsewhere."""
        x = np.zeros(self.mean_dim)
        if "a" in self.blocks:
            x[self.mean_slice("a").stop - 1] = 1.0
        return x


def _mean_size(block: str) -> int:
    return 4 if block == "a" else STATE_BLOCKS[block]


def _slices(blocks: tuple[str, ...], sizes: list[int]) -> dict[str, slice]:
    edges = np.concatenate([[0], np.cumsum(sizes)]).tolist()
    return {block: slice(start, stop) for block, (start, stop) in zip(blocks, pairwise(edges), strict=True)}
