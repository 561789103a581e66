"""Symmetries of a system, and those that move its principal axes: finite moves that no measurement notices."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import casadi as ca

from observability.coordinates import Values
from observability.system import System
from spinfilters.core.attitude_expressions import (
    Expression,
    conjugate,
    matrix_from_quaternion,
    product,
    quaternion_from_mrp,
    rotate,
)


@dataclass(frozen=True)
class State:
    """A symbolic point: the chart's blocks, and the unknown points (3, items) of every sensor that has some."""

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
    group : str
        Of what kind it is, for sentences: "gauge translation".
    name : str
        The group with its direction.
    move : Move
        Of the state.
    amount : float
        a finite step in the move's own unit that changes the state visibly.
    """

    group: str
    name: str
    move: Move
    amount: float


AXES = "xyz"
INERTIAL_ATTITUDE = "attitude in inertial space"
"""Kind of the rotations of frame i that no sensor on the body notices; of one known direction, the heading about it."""


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
    """An axis in g about which g may be free to rotate: its name, and its direction from the blocks."""

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


def rotation_of_g(axis: str) -> str:
    """Name of the symmetry that rotates g in the body about an axis of that name."""
    return f"rotation of g about {axis}"


def _constant(axis: ca.DM) -> Callable[[Values], Expression]:
    return lambda _: axis


def _rate_in_g(values: Values) -> Expression:
    return rotate(values["q_gb"], values["w"]) if "q_gb" in values else values["w"]


def gauge_translations(shift: Callable[[int], Move]) -> Iterator[Symmetry]:
    """Moves of the origin of g in the body, by the move along each of its axes."""
    for k in range(3):
        yield Symmetry("gauge translation", f"translation of g along {AXES[k]}", shift(k), 0.05)


def gauge_rotations(axes: Sequence[GaugeAxis], turn_about: Callable[[GaugeAxis], Move]) -> Iterator[Symmetry]:
    """Rotations of g in the body, by the move about each of its free axes."""
    for axis in axes:
        yield Symmetry("gauge rotation", rotation_of_g(axis.name), turn_about(axis), 0.3)


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
                INERTIAL_ATTITUDE,
                f"rotation of i about {AXES[k]}",
                _turned_around(k, attitude, names),
                0.3,
            )


def turns_like_drift(slow_turn: Callable[[int | None], Move]) -> Iterator[Symmetry]:
    """Small rotations that resting landmarks cannot distinguish from drift."""
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


def principal_symmetries(
    values: dict[str, Expression], axes: list[GaugeAxis], still: bool, crooked: bool
) -> Iterator[Symmetry]:
    """All candidates over a chart with these blocks.

    Parameters
    ----------
    axes : list[GaugeAxis]
        Of rotations of g with names.
    still : bool
        The body does not rotate, so that no spin axis is defined.
    crooked : bool
        Its rate has no component that is 0.
    """
    yield from _gauge_and_scales(values, axes)
    if "q_gb" in values:
        yield from _rolls(still)
    if "c" in values:
        yield from _centre(still)
    if "q_ib" in values:
        yield from inertial_symmetries("r" if "r" in values else None, "q_ib")
    if "c" in values:
        yield from _first_order(still, crooked)


def _gauge_and_scales(values: dict[str, Expression], axes: list[GaugeAxis]) -> Iterator[Symmetry]:
    """Symmetries of g's place in the body, scales, and single masses."""
    if "c" in values:
        yield from gauge_translations(_shift_along)
    if "q_gb" in values:
        yield from gauge_rotations(axes, _turn_about)
    if "J" in values:
        yield Symmetry("scale of the inertia", "scale of the inertia", _heavier, 0.2)
    if "r" in values:
        yield Symmetry("scale of all lengths", "scale of all lengths", _longer, 0.1)
    if "k" in values:
        yield from (Symmetry(f"k{k + 1}", f"k{k + 1}", _ratio(k), 0.1) for k in range(2))
    if "J" in values:
        yield from (
            Symmetry(f"moment about {AXES[k]}", f"moment about {AXES[k]}", _moment(k), 0.1) for k in range(3)
        )


def _centre(still: bool) -> Iterator[Symmetry]:
    if still:
        for k in range(3):
            yield Symmetry("centre of mass", f"centre of mass along {AXES[k]}", _centre_along_axis(k), 0.05)
    else:
        yield Symmetry(
            "centre of mass along the spin axis",
            "centre of mass along the spin axis",
            _centre_along_spin,
            0.05,
        )


def _rolls(still: bool) -> Iterator[Symmetry]:
    if not still:
        yield Symmetry(
            "roll about the spin axis",
            "roll of the principal axes about the spin axis",
            _roll_about(None),
            0.3,
        )
    for k in range(3):
        yield Symmetry(
            "roll of the principal axes", f"roll of the principal axes about {AXES[k]}", _roll_about(k), 0.3
        )


def _first_order(still: bool, crooked: bool) -> Iterator[Symmetry]:
    """Symmetries of one or two landmarks to first order."""
    if still:
        yield from turns_like_drift(_slow_turn)
    elif crooked:
        yield Symmetry(
            "spin about the line to the landmark", "spin about the line to the landmark", _precession, 0.02
        )


def _shift_along(axis: int):
    def move(state: State, amount: ca.SX) -> State:
        """The state moved by an amount."""
        shift = amount * unit(axis)
        return State(state.values | {"c": state.values["c"] + shift}, shifted_points(shift, state))

    return move


def _turn_about(axis: GaugeAxis):
    def move(state: State, amount: ca.SX) -> State:
        """The state moved by an amount."""
        q = turn(axis.direction(state.values), amount)
        changed = {"q_gb": product(q, state.values["q_gb"])}
        if "c" in state.values:
            changed["c"] = rotate(q, state.values["c"])
        return State(state.values | changed, turned_points(q, state))

    return move


def _heavier(state: State, amount: ca.SX) -> State:
    return state.with_values(J=state.values["J"] * (1 + amount))


def _longer(state: State, amount: ca.SX) -> State:
    return scaled(state, ("r", "v", "c"), amount)


def _ratio(index: int):
    def move(state: State, amount: ca.SX) -> State:
        """The state moved by an amount."""
        return state.with_values(k=state.values["k"] + amount * ca.DM.eye(2)[:, index])

    return move


def _moment(axis: int):
    def move(state: State, amount: ca.SX) -> State:
        """The state moved by an amount."""
        return state.with_values(J=state.values["J"] + amount * unit(axis))

    return move


def _roll_about(axis: int | None):
    """Rotation of the axes b within the body.

    About one of them or about the rate: R_ig and the rate in g stay.
    """

    def move(state: State, amount: ca.SX) -> State:
        """The state moved by an amount."""
        values = state.values
        q = turn(values["w"] if axis is None else unit(axis), amount)
        return state.with_values(
            q_ib=product(values["q_ib"], q),
            q_gb=product(values["q_gb"], q),
            w=rotate(conjugate(q), values["w"]),
        )

    return move


def _centre_moved(state: State, along_b: Expression) -> State:
    """The centre of mass elsewhere in the body, the body where it is."""
    values = state.values
    return state.with_values(
        c=values["c"] + rotate(values["q_gb"], along_b), r=values["r"] + rotate(values["q_ib"], along_b)
    )


def _centre_along_spin(state: State, amount: ca.SX) -> State:
    return _centre_moved(state, amount * state.values["w"])


def _centre_along_axis(axis: int):
    def move(state: State, amount: ca.SX) -> State:
        """The state moved by an amount."""
        return _centre_moved(state, amount * unit(axis))

    return move


def _slow_turn(axis: int | None):
    """Slow rate of a resting body, and a velocity that compensates.

    About an axis or the line of the first two landmarks.
    """

    def move(state: State, amount: ca.SX) -> State:
        """The state moved by an amount."""
        values, points = state.values, state.points[0]
        first, second = points[:, 0], points[:, min(1, points.shape[1] - 1)]
        line = rotate(conjugate(values["q_gb"]), second - first)
        rate = amount * (line if axis is None else unit(axis))
        arm = rotate(conjugate(values["q_gb"]), first - values["c"])
        drift = rotate(values["q_ib"], ca.cross(rate, arm))
        return state.with_values(w=values["w"] + rate, v=values["v"] - drift)

    return move


def _precession(state: State, amount: ca.SX) -> State:
    """Rate of a sphere about the line from centre to landmark.

    Its moments make the rest of the rate follow. To first order w' = (dJ w) x w has to be amount w x d, so dJ w = -amount d +
    m w, where dJ = diag(k1, 0, -k2).
    """
    values = state.values
    w = values["w"]
    d = rotate(conjugate(values["q_gb"]), state.points[0][:, 0] - values["c"])
    m = d[1] / w[1]
    ratios = ca.vertcat(m - d[0] / w[0], d[2] / w[2] - m)
    return state.with_values(w=w + amount * d, k=values["k"] + amount * ratios)
