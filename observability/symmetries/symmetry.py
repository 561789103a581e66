"""Symmetry: a named move of the state by a finite amount."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import casadi as ca

from observability.charts.chart import Values
from observability.system import System
from spinfilters.attitude.expressions import (
    Expression,
    matrix_from_quaternion,
    product,
    quaternion_from_mrp,
    rotate,
)


@dataclass(frozen=True)
class State:
    """A symbolic point: the chart's blocks and unknown points.

    (3, items) of every sensor that has some.
    """

    values: Values
    points: tuple[Expression, ...]

    def with_values(self, **changed: Expression) -> "State":
        """The state with some blocks replaced."""
        return State(self.values | changed, self.points)


Move = Callable[[State, ca.SX], State]
"""The state after a move by an amount; at 0 nothing moves."""


@dataclass(frozen=True)
class Symmetry:
    """A candidate: whether a system has it is found out, not assumed.

    Attributes
    ----------
    group: of what kind it is, for sentences: "gauge translation".   name: the group with its direction.
    move: of the state.   amount: a finite step in the move's own unit that changes the state visibly.
    """

    group: str
    name: str
    move: Move
    amount: float


AXES = "xyz"


def unit(axis: int) -> ca.DM:
    """A unit vector."""
    return ca.DM.eye(3)[:, axis]


def turn(axis: Expression, amount: ca.SX) -> Expression:
    """Quaternion of the turn by the 4 x MRP ``amount`` times ``axis``."""
    return quaternion_from_mrp(amount * axis)


def turned_points(q: Expression, state: State) -> tuple[Expression, ...]:
    """R(q) p of all points."""
    return tuple(matrix_from_quaternion(q) @ points for points in state.points)


def shifted_points(shift: Expression, state: State) -> tuple[Expression, ...]:
    """p + shift of all points."""
    return tuple(points + ca.repmat(shift, 1, points.shape[1]) for points in state.points)


def scaled(state: State, names: tuple[str, ...], amount: ca.SX) -> State:
    """These blocks and all points times 1 + amount."""
    values = {name: state.values[name] * (1 + amount) for name in names if name in state.values}
    return State(state.values | values, tuple(points * (1 + amount) for points in state.points))


@dataclass(frozen=True)
class GaugeAxis:
    """An axis in g about which g may be free to rotate.

    Its name, and its direction from the blocks.
    """

    name: str
    direction: Callable[[Values], Expression]


def gauge_axes(system: System, still: bool) -> list[GaugeAxis]:
    """Gauge axes in g: x, y, z, or those that remain.

    Known things in g leave fewer: the axis of a torque, and of a spin if there is one.
    """
    axes = [GaugeAxis(AXES[k], _constant(unit(k))) for k in range(3)]
    for each in system.inputs:
        if each.is_torque:
            column = ca.DM([float(number) for number in system.torque_axes[each.axis]])
            axes.append(GaugeAxis(f"the axis of the {each.value}", _constant(column)))
    return axes if still else [*axes, GaugeAxis("the spin axis", _rate_in_g)]


def _constant(axis: ca.DM) -> Callable[[Values], Expression]:
    return lambda _: axis


def _rate_in_g(values: Values) -> Expression:
    return rotate(values["q_gb"], values["w"]) if "q_gb" in values else values["w"]


def inertial_symmetries(place: str | None, attitude: str | None) -> Iterator[Symmetry]:
    """Moves of the observer's frame i.

    A sensor on the body does not notice them; the blocks of place and attitude by name.
    """
    for k in range(3):
        if place is not None:
            yield Symmetry(
                "place of the observer", f"translation of i along {AXES[k]}", _block_shifted(place, k), 0.05
            )
            yield Symmetry(
                "drift of the observer", f"velocity of i along {AXES[k]}", _block_shifted("v", k), 0.01
            )
        if attitude is not None:
            names = () if place is None else (place, "v")
            yield Symmetry(
                "attitude in inertial space",
                f"rotation of i about {AXES[k]}",
                _turned_around(k, attitude, names),
                0.3,
            )


def turns_like_drift(slow_turn: Callable[[int | None], Move]) -> Iterator[Symmetry]:
    """Small rotations that resting landmarks cannot tell from drift."""
    group = "turn that looks like drift"
    yield Symmetry(group, "turn about the line of two landmarks", slow_turn(None), 0.02)
    for k in range(3):
        yield Symmetry(group, f"turn about {AXES[k]} that looks like drift", slow_turn(k), 0.02)


def _block_shifted(name: str, axis: int) -> Move:
    def move(state: State, amount: ca.SX) -> State:
        """The state moved by an amount."""
        return State(state.values | {name: state.values[name] + amount * unit(axis)}, state.points)

    return move


def _turned_around(axis: int, attitude: str, names: tuple[str, ...]) -> Move:
    def move(state: State, amount: ca.SX) -> State:
        """The state moved by an amount."""
        q = turn(unit(axis), amount)
        turned = {name: rotate(q, state.values[name]) for name in names}
        return State(state.values | turned | {attitude: product(q, state.values[attitude])}, state.points)

    return move
