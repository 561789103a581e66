"""Chart of a state: blocks, rates, and what sensors see."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import pairwise

import casadi as ca
import numpy as np

from observability.rational import Rationals, rationals, unit_quaternion
from spinfilters.attitude.expressions import Expression, conjugate, product
from spinfilters.errors import InputError, ShapeError

Values = dict[str, Expression]
"""Blocks by name."""
Point = Mapping[str, Sequence[float | str | Fraction]]
"""Numbers of every block by name; floats are read as the simplest fraction that rounds to them."""


@dataclass(frozen=True)
class Block:
    """Block of a state: name, size, names of its error's components."""

    name: str
    size: int
    components: tuple[str, ...]


def vector(name: str, components: str = "xyz") -> Block:
    """A block that adds: as many numbers as components."""
    return Block(name, len(components), tuple(f"{name}_{letter}" for letter in components))


def attitude(name: str) -> Block:
    """A unit quaternion with a body-side error in rad."""
    return Block(name, 4, tuple(f"{name}_{letter}" for letter in "xyz"))


class Chart(ABC):
    """Coordinates of a motion.

    Attributes
    ----------
    name: in words.
    blocks: of a point, in order. A block of four numbers and three error components is a unit quaternion; others add.
    has_turned_axes: whether principal axes may lie anywhere in g, rather than along its axes.
    """

    name: str
    blocks: tuple[Block, ...]
    has_turned_axes: bool = False

    @abstractmethod
    def rates(self, values: Values) -> Values:
        """Time derivatives of all blocks."""

    @abstractmethod
    def seen(self, values: Values) -> Values:
        """Quantities that sensors measure (`spinfilters.conventions`).

        They are q, w in g axes and, where there is a place, t, v, c.
        """

    @abstractmethod
    def torque_field(self, values: Values) -> Values:
        """Columns (size, 3) by which a known torque enters the rates.

        The torque is in N m about the axes g.
        """

    @cached_property
    def mean_dim(self) -> int:
        """Numbers of a point."""
        return sum(block.size for block in self.blocks)

    @cached_property
    def error_dim(self) -> int:
        """Independent directions."""
        return sum(len(block.components) for block in self.blocks)

    @cached_property
    def components(self) -> tuple[str, ...]:
        """Names of the directions."""
        return tuple(name for block in self.blocks for name in block.components)

    def unpack(self, x: Expression) -> Values:
        """Blocks of a symbolic point."""
        edges = np.concatenate([[0], np.cumsum([block.size for block in self.blocks])]).tolist()
        return {
            block.name: x[start:stop]
            for block, (start, stop) in zip(self.blocks, pairwise(edges), strict=True)
        }

    def pack(self, values: Values) -> Expression:
        """The inverse of `unpack`."""
        return ca.vertcat(*[values[block.name] for block in self.blocks])

    def directions(self, values: Values) -> Expression:
        """(mean_dim, error_dim) change of a point per unit of every error component, at error 0."""
        return ca.diagcat(*[self._block_directions(block, values[block.name]) for block in self.blocks])

    def change(self, values: Values, moved: Values) -> Expression:
        """(error_dim,) the error from one point to another, to first order."""
        return ca.vertcat(
            *[self._changed(block, values[block.name], moved[block.name]) for block in self.blocks]
        )

    def settled(self, moved: Values) -> Values:
        """Blocks of a moved state in the chart's own numbers."""
        return moved

    def point(self, given: Point) -> Rationals:
        """Exact numbers of a point; quaternions come out of unit norm.

        Raises
        ------
        InputError, ShapeError: for a block that is missing, unknown or of another size, or numbers that are not finite.
        """
        names = [block.name for block in self.blocks]
        if set(names) != set(given):
            raise InputError(
                f"a point of the chart {self.name} has the blocks {', '.join(names)}; got {', '.join(given)}"
            )
        numbers: list[Fraction] = []
        for block in self.blocks:
            values = given[block.name]
            if len(values) != block.size:
                raise ShapeError(
                    f"block {block.name} of the chart {self.name} takes {block.size} numbers, got {len(values)}"
                )
            exact = rationals(values)
            numbers += unit_quaternion(exact) if _is_attitude(block) and _norm(exact) != 1 else exact
        return tuple(numbers)

    def _changed(self, block: Block, value: Expression, moved: Expression) -> Expression:
        """The same expression has not changed: most moves leave most blocks alone."""
        if moved is value:
            return ca.SX.zeros(len(block.components))
        return self._block_change(block, value, moved)

    def _block_directions(self, block: Block, value: Expression) -> Expression:
        if not _is_attitude(block):
            return ca.SX.eye(block.size)
        return ca.horzcat(*[product(value, ca.vertcat(ca.DM.eye(3)[:, axis] / 2, 0)) for axis in range(3)])

    def _block_change(self, block: Block, value: Expression, moved: Expression) -> Expression:
        if not _is_attitude(block):
            return moved - value
        return 2 * product(conjugate(value), moved)[:3]


def _is_attitude(block: Block) -> bool:
    return block.size == 4 and len(block.components) == 3


def _norm(values: Rationals) -> Fraction:
    return sum((value * value for value in values), Fraction(0))
