"""Which blocks a state holds, and how a point on its manifold and an error vector meet."""

import builtins
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
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
from spinfilters.dynamics.mass_distribution import (
    local_mass,
    near_local_mass,
    reset_mass_jacobian,
    retract_mass,
)
from spinfilters.errors import InputError
from spinfilters.symbolic import Compiled, building

Chart = Callable[[Expression, Expression], Expression]
"""How a block's point takes an error, or how two of its points differ."""
ROTATION_BLOCKS = ("a", "w", "s")
"""What a gyro alone can see."""
FULL_BLOCKS = ("t", "a", "v", "w", "c", "s")
"""Pose, velocities, centre of mass and mass distribution."""


@dataclass(frozen=True)
class StateLayout:
    """The blocks of a state, in the order of `spinfilters.conventions.STATE_BLOCKS`.

    A point ``x`` (mean_dim,) holds the attitude as the quaternion q_ig, an error ``d`` (error_dim,) as 4 x MRP on the body side.
    The error of the mass distribution is multiplicative too (`spinfilters.dynamics.mass_distribution`); every other block adds.
    """

    blocks: tuple[str, ...]

    def __post_init__(self) -> None:
        known = tuple(block for block in STATE_BLOCKS if block in self.blocks)
        if self.blocks != known:
            raise InputError(
                f"state blocks {self.blocks} must be distinct, known and in the order {tuple(STATE_BLOCKS)}"
            )

    @cached_property
    def error_dim(self) -> int:
        """Number of error components."""
        return sum(STATE_BLOCKS[block] for block in self.blocks)

    @cached_property
    def mean_dim(self) -> int:
        """Number of components of a point: one more than the error where there is an attitude."""
        return sum(_mean_size(block) for block in self.blocks)

    def slice(self, block: str) -> builtins.slice:
        """Where a block stands in an error vector."""
        return self._error_slices[block]

    def mean_slice(self, block: str) -> builtins.slice:
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
            parts.append(_RETRACT.get(block, _add)(point, error))
        return ca.vertcat(*parts)

    def local_expression(self, x: Expression, y: Expression) -> Expression:
        """y [-] x, the error that takes x to y, symbolically; the attitude error goes the short way round."""
        return self._difference(x, y, _LOCAL)

    def near_local_expression(self, x: Expression, y: Expression) -> Expression:
        """`local_expression` to first order at y = x: the same derivative there, and a shorter expression."""
        return self._difference(x, y, _NEAR_LOCAL)

    def _difference(self, x: Expression, y: Expression, how: dict[str, Chart]) -> Expression:
        pairs = ((block, x[self.mean_slice(block)], y[self.mean_slice(block)]) for block in self.blocks)
        return ca.vertcat(*[how.get(block, _subtract)(here, there) for block, here, there in pairs])

    def retract(
        self, x: Float[np.ndarray, "*batch m"], d: Float[np.ndarray, "*batch n"]
    ) -> Float[np.ndarray, "*batch m"]:
        """The point that lies at error ``d`` from ``x``, its quaternion normalised."""
        return self._retract(x, d)[0]

    def local(
        self, x: Float[np.ndarray, "*batch m"], y: Float[np.ndarray, "*batch m"]
    ) -> Float[np.ndarray, "*batch n"]:
        """The error that takes ``x`` to ``y``."""
        return self._local(x, y)[0]

    def reset_jacobian(self, d: Float[np.ndarray, "*batch n"]) -> Float[np.ndarray, "*batch n n"]:
        """Derivative of the error about retract(x, d) with respect to the error about x, at d."""
        return self._reset(d)[0]

    @cached_property
    def _error_slices(self) -> dict[str, builtins.slice]:
        return _slices(self.blocks, [STATE_BLOCKS[block] for block in self.blocks])

    @cached_property
    def _mean_slices(self) -> dict[str, builtins.slice]:
        return _slices(self.blocks, [_mean_size(block) for block in self.blocks])

    @cached_property
    @building()
    def _retract(self) -> Compiled:
        return _retract_function(self)

    @cached_property
    @building()
    def _local(self) -> Compiled:
        return _local_function(self)

    @cached_property
    @building()
    def _reset(self) -> Compiled:
        return _reset_function(self)

    def origin(self) -> Float[np.ndarray, " m"]:
        """The point with identity attitude and zeros elsewhere."""
        x = np.zeros(self.mean_dim)
        if "a" in self.blocks:
            x[self.mean_slice("a").stop - 1] = 1.0
        return x


@cache
def _retract_function(layout: StateLayout) -> Compiled:
    """Made once in a process for equal layouts, as those below: expressions take longer to build than most recordings to smooth."""
    x, d = ca.SX.sym("x", layout.mean_dim), ca.SX.sym("d", layout.error_dim)
    y = layout.unpack(layout.retract_expression(x, d))
    if "q" in y:
        y["q"] = y["q"] / ca.sqrt(ca.dot(y["q"], y["q"]))
    return Compiled(ca.Function("retract", [x, d], [layout.pack(y)], ["x", "d"], ["y"]))


@cache
def _local_function(layout: StateLayout) -> Compiled:
    x, y = ca.SX.sym("x", layout.mean_dim), ca.SX.sym("y", layout.mean_dim)
    return Compiled(ca.Function("local", [x, y], [layout.local_expression(x, y)], ["x", "y"], ["d"]))


@cache
def _reset_function(layout: StateLayout) -> Compiled:
    d, e = ca.SX.sym("d", layout.error_dim), ca.SX.sym("e", 3)
    jacobian = ca.SX.eye(layout.error_dim)
    if "a" in layout.blocks:
        a = layout.slice("a")
        moved = product(conjugate(quaternion_from_mrp(d[a])), quaternion_from_mrp(e))
        turn = ca.jacobian(short_mrp_from_quaternion(moved), e)
        jacobian[a, a] = ca.substitute(turn, e, d[a])
    if "s" in layout.blocks:
        jacobian[layout.slice("s"), layout.slice("s")] = reset_mass_jacobian(d[layout.slice("s")])
    return Compiled(ca.Function("reset_jacobian", [d], [jacobian], ["d"], ["J"]))


def _add(point: Expression, error: Expression) -> Expression:
    return point + error


def _subtract(here: Expression, there: Expression) -> Expression:
    return there - here


def _retract_attitude(q: Expression, a: Expression) -> Expression:
    return product(q, quaternion_from_mrp(a))


def _local_attitude(q: Expression, p: Expression) -> Expression:
    return short_mrp_from_quaternion(product(conjugate(q), p))


_RETRACT: dict[str, Chart] = {"a": _retract_attitude, "s": retract_mass}
_LOCAL: dict[str, Chart] = {"a": _local_attitude, "s": local_mass}
_NEAR_LOCAL: dict[str, Chart] = {"a": _local_attitude, "s": near_local_mass}


def _mean_size(block: str) -> int:
    return 4 if block == "a" else STATE_BLOCKS[block]


def _slices(blocks: tuple[str, ...], sizes: list[int]) -> dict[str, slice]:
    edges = np.concatenate([[0], np.cumsum(sizes)]).tolist()
    return {block: slice(start, stop) for block, (start, stop) in zip(blocks, pairwise(edges), strict=True)}
