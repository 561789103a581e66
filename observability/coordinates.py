"""Charts of the unknowns: the thesis' principal axes, the inertia tensor in frame g, and the state of the filters."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import pairwise

import casadi as ca
import numpy as np

from observability.exact_numbers import Rationals, rationals, unit_quaternion
from spinfilters.core.attitude_expressions import (
    Expression,
    conjugate,
    matrix_from_quaternion,
    product,
    quaternion_rate,
    rotate,
)
from spinfilters.core.errors import InputError, ShapeError
from spinfilters.core.mass_distribution import (
    from_second_moments,
    inertia,
    lower_factor,
    traceless_components,
)
from spinfilters.models.process import body_acceleration, derivative
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout, error_derivative

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
    name : str
        In words.
    blocks : tuple[Block, ...]
        Of a point, in order. A block of four numbers and three error components is a unit quaternion; others
        add.
    has_turned_axes : bool
        Whether principal axes may lie anywhere in g, rather than along its axes.
    """

    name: str
    blocks: tuple[Block, ...]
    has_turned_axes: bool = False

    @abstractmethod
    def rates(self, values: Values) -> Values:
        """Time derivatives of all blocks."""

    @abstractmethod
    def seen(self, values: Values) -> Values:
        """Quantities that sensors measure (`spinfilters.core.conventions`).

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
            *[self._changed_expression(block, values[block.name], moved[block.name]) for block in self.blocks]
        )

    def settled(self, moved: Values) -> Values:
        """Blocks of a moved state in the chart's own numbers."""
        return moved

    def point(self, given: Point) -> Rationals:
        """Exact numbers of a point; quaternions come out of unit norm.

        Raises
        ------
        InputError, ShapeError
            For a block that is missing, unknown or of another size, or numbers that are not finite.
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
            numbers += unit_quaternion(exact) if is_attitude(block) and _norm(exact) != 1 else exact
        return tuple(numbers)

    def _changed_expression(self, block: Block, value: Expression, moved: Expression) -> Expression:
        """The same expression has not changed: most moves leave most blocks alone."""
        if moved is value:
            return ca.SX.zeros(len(block.components))
        return self._block_change(block, value, moved)

    def _block_directions(self, block: Block, value: Expression) -> Expression:
        if not is_attitude(block):
            return ca.SX.eye(block.size)
        return ca.horzcat(*[product(value, ca.vertcat(ca.DM.eye(3)[:, axis] / 2, 0)) for axis in range(3)])

    def _block_change(self, block: Block, value: Expression, moved: Expression) -> Expression:
        if not is_attitude(block):
            return moved - value
        return 2 * product(conjugate(value), moved)[:3]


def is_attitude(block: Block) -> bool:
    """Whether a block is a unit quaternion."""
    return block.size == 4 and len(block.components) == 3


def _norm(values: Rationals) -> Fraction:
    return sum((value * value for value in values), Fraction(0))


SCALE = Block("n", 1, ("ln_scale",))
"""Logarithm of the inertia over J(s), which the filters do not hold: free motion does not depend on it."""
MASS = Block("s", 5, ("D_11", "D_22", "D_21", "D_31", "D_32"))


class FilterChart(Chart):
    """The state of a `StateLayout` without drag, with its own multiplicative errors.

    Parameters
    ----------
    with_scale : bool
        Whether the scale of the inertia is one more unknown, as a known torque needs it.
    """

    def __init__(self, layout: StateLayout | None = None, with_scale: bool = False) -> None:
        self.layout = layout or StateLayout(FULL_BLOCKS)
        self.name = "filter state"
        special = {"a": attitude("q"), "s": MASS}
        own = tuple(special.get(name) or vector(name) for name in self.layout.blocks)
        self.blocks = (*own, SCALE) if with_scale else own

    def rates(self, values: Values) -> Values:
        """Rates of the filters' process without noise."""
        rates = self.layout.unpack(derivative(self.layout, self.layout.pack(values)))
        return rates | {"n": 0 * values["n"]} if "n" in values else rates

    def seen(self, values: Values) -> Values:
        """All blocks but the masses and the scale."""
        return {name: value for name, value in values.items() if name not in ("s", "n")}

    def torque_field(self, values: Values) -> Values:
        """J^-1 over the scale."""
        scale = ca.exp(-values["n"]) if "n" in values else 1
        return {"w": scale * ca.inv_minor(inertia(values["s"]))}

    def directions(self, values: Values) -> Expression:
        """Derivative of the retraction at 0."""
        d = ca.SX.sym("d", self.layout.error_dim)
        moved = self.layout.retract_expression(self.layout.pack(values), d)
        own = error_derivative(moved, d)
        return ca.diagcat(own, 1) if "n" in values else own

    def change(self, values: Values, moved: Values) -> Expression:
        """Change of the masses as S where a move gives S as well as s; no move changes s itself."""
        return super().change(values, moved | {"s": moved.get("S", moved["s"])})

    def settled(self, moved: Values) -> Values:
        """s of the second moments that a move has left."""
        if "S" not in moved:
            return moved
        S = moved["S"]
        return moved | {"s": from_second_moments(S / ca.det(S) ** (1 / 3))}

    def _block_change(self, block: Block, value: Expression, moved: Expression) -> Expression:
        """Change of the masses, where ``moved`` is S.

        The traceless part of L^-1 S L^-T, without a logarithm or a root.
        """
        if block.name != "s":
            return super()._block_change(block, value, moved)
        inverse = ca.inv_minor(lower_factor(value))
        return traceless_components(inverse @ moved @ inverse.T)


def with_second_moments(values: Values, J: Expression) -> Values:
    """The blocks with the inertia added as second moments, S = tr(J)/2 I - J; s remains until the chart sets it."""
    return values | {"S": ca.trace(J) / 2 * ca.DM.eye(3) - J}


RATIOS = vector("k", "12")
"""k1 = ln(Jxx/Jyy), k2 = ln(Jyy/Jzz) (Tweddle 2013, Eqs 4.97-4.98)."""
MOMENTS = vector("J", "xyz")
"""Principal moments (Tweddle 2013, Eq. 3.11)."""


class PrincipalChart(Chart):
    """Chart in principal axes b: w with k1, k2 or three moments.

    Optionally attitudes q_ib, q_gb; optionally r, v, c.
    R_ig = R_ib R_gb', t = r - R_ig c (Tweddle 2013, section 4.6; his T_gb is c). Singular where moments are equal: the axes b
    are then no function of the body.

    Parameters
    ----------
    inertia : Block
        `RATIOS` or `MOMENTS`.
    with_attitude, with_place : bool
        Whether the blocks q_ib and q_gb, and r, v and c, belong to the state.
    """

    def __init__(self, inertia: Block = RATIOS, with_attitude: bool = True, with_place: bool = True) -> None:
        place, turned = (vector("r"), vector("v")), (attitude("q_ib"),)
        self.name, self.has_turned_axes = "principal axes", with_attitude
        self.blocks = (
            *(place if with_place else ()),
            *(turned if with_attitude else ()),
            vector("w"),
            inertia,
            *((attitude("q_gb"),) if with_attitude else ()),
            *((vector("c"),) if with_place else ()),
        )

    def rates(self, values: Values) -> Values:
        """Euler's equations in principal axes, and the kinematics of r and q_ib."""
        rates = {name: 0 * value for name, value in values.items()}
        rates["w"] = body_acceleration(values["w"], principal_inertia(values))
        if "q_ib" in values:
            rates["q_ib"] = quaternion_rate(values["q_ib"], values["w"])
        if "r" in values:
            rates["r"] = values["v"]
        return rates

    def seen(self, values: Values) -> Values:
        """q_ig, w in g axes, t = r - R_ig c, v and c."""
        if "q_ib" not in values:
            return {"w": values["w"]}
        q = product(values["q_ib"], conjugate(values["q_gb"]))
        seen = {"q": q, "w": rotate(values["q_gb"], values["w"])}
        if "r" in values:
            seen |= {"t": values["r"] - rotate(q, values["c"]), "v": values["v"], "c": values["c"]}
        return seen

    def torque_field(self, values: Values) -> Values:
        """Torque columns in axes b, equal to axes g where the chart holds no q_gb."""
        inverse = ca.inv_minor(principal_inertia(values))
        if "q_gb" in values:
            inverse = inverse @ matrix_from_quaternion(values["q_gb"]).T
        return {"w": inverse}


def principal_inertia(values: Values) -> Expression:
    """J in principal axes: diag(e^k1, 1, e^-k2) (Tweddle 2013, Eq. 4.99), or of the three moments."""
    if "J" in values:
        return ca.diag(values["J"])
    return ca.diag(ca.vertcat(ca.exp(values["k"][0]), 1, ca.exp(-values["k"][1])))


TENSOR = Block("J", 6, ("J_xx", "J_yy", "J_zz", "J_xy", "J_xz", "J_yz"))


class TensorChart(Chart):
    """Chart in g axes: w with all six entries of J.

    Free motion shows five of them; optionally q (of q_ig); optionally t, v, c.
    """

    def __init__(self, with_attitude: bool = True, with_place: bool = True) -> None:
        self.name, self.has_turned_axes = "inertia tensor", True
        self.blocks = (
            *((vector("t"),) if with_place else ()),
            *((attitude("q"),) if with_attitude else ()),
            *((vector("v"),) if with_place else ()),
            vector("w"),
            *((vector("c"),) if with_place else ()),
            TENSOR,
        )

    def rates(self, values: Values) -> Values:
        """Euler's equations in g axes, and the kinematics of t and q."""
        rates = {name: 0 * value for name, value in values.items()}
        rates["w"] = body_acceleration(values["w"], symmetric(values["J"]))
        if "q" in values:
            rates["q"] = quaternion_rate(values["q"], values["w"])
        if "t" in values:
            rates["t"] = values["v"] - rotate(values["q"], ca.cross(values["w"], values["c"]))
        return rates

    def seen(self, values: Values) -> Values:
        """All blocks but the inertia."""
        return {name: value for name, value in values.items() if name != "J"}

    def torque_field(self, values: Values) -> Values:
        """J^-1."""
        return {"w": ca.inv_minor(symmetric(values["J"]))}


def symmetric(entries: Expression) -> Expression:
    """The 3 x 3 matrix of (xx, yy, zz, xy, xz, yz)."""
    xx, yy, zz, xy, xz, yz = (entries[k] for k in range(6))
    return ca.vertcat(ca.horzcat(xx, xy, xz), ca.horzcat(xy, yy, yz), ca.horzcat(xz, yz, zz))


def entries(matrix: Expression) -> Expression:
    """The inverse of `symmetric`."""
    return ca.vertcat(matrix[0, 0], matrix[1, 1], matrix[2, 2], matrix[0, 1], matrix[0, 2], matrix[1, 2])
