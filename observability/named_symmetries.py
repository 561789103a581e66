"""Named symmetries that a null space is explained by."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import singledispatch

import casadi as ca
import numpy as np

from observability.coordinates import (
    Chart,
    FilterChart,
    PrincipalChart,
    TensorChart,
    Values,
    entries,
    symmetric,
    with_second_moments,
)
from observability.exact_numbers import Rationals, as_floats
from observability.symmetry import (
    AXES,
    GaugeAxis,
    Move,
    State,
    Symmetry,
    gauge_axes,
    inertial_symmetries,
    principal_symmetries,
    rotation_of_g,
    scaled,
    shifted_points,
    turn,
    turned_points,
    turns_like_drift,
    unit,
)
from observability.system import System
from spinfilters.core.attitude_expressions import (
    Expression,
    conjugate,
    matrix_from_quaternion,
    product,
    rotate,
)
from spinfilters.core.mass_distribution import inertia


def candidates(system: System, point: Rationals) -> list[Symmetry]:
    """Candidates by preference: where several say the same, the first names it."""
    chart = system.chart
    rate = as_floats(point)[_place(chart, "w")]
    values = chart.unpack(ca.SX.sym("x", chart.mean_dim))
    found = of_chart(chart, system, values, rate)
    mapped = [sensor for sensor in system.sensors if sensor.unknown == 3]
    return [each for each in found if mapped or each.group not in NEED_LANDMARKS]


NEED_LANDMARKS = {"turn that looks like drift", "spin about the line to the landmark"}


@singledispatch
def of_chart(chart: Chart, system: System, values: Values, rate: np.ndarray) -> list[Symmetry]:
    """Candidates of a chart at a rate (3,), rad/s.

    Each kind of chart registers its own; another has none.
    """
    return []


@of_chart.register
def _(chart: PrincipalChart, system: System, values: Values, rate: np.ndarray) -> list[Symmetry]:
    still = not rate.any()
    axes = gauge_axes(system, still)
    return list(principal_symmetries(values, axes, still, bool(rate.all()) and "k" in values))


@of_chart.register
def _(chart: TensorChart, system: System, values: Values, rate: np.ndarray) -> list[Symmetry]:
    axes = gauge_axes(system, not rate.any())
    return list(GeometricMoves(_tensor, _with_tensor, axes, scale_held=True).symmetries(values, _spin(rate)))


@of_chart.register
def _(chart: FilterChart, system: System, values: Values, rate: np.ndarray) -> list[Symmetry]:
    axes = gauge_axes(system, not rate.any())
    moves = GeometricMoves(_filter_inertia, with_second_moments, axes, scale_held=False)
    return list(moves.symmetries(values, _spin(rate)))


def _spin(rate: np.ndarray) -> int | None:
    """Axis about which a body turns least; None of one at rest."""
    return int(np.argmin(np.abs(rate))) if rate.any() else None


def _place(chart: Chart, name: str) -> slice:
    start = 0
    for block in chart.blocks:
        if block.name == name:
            return slice(start, start + block.size)
        start += block.size
    return slice(0, 0)


def _tensor(values: Values) -> Expression:
    return symmetric(values["J"])


def _with_tensor(values: Values, J: Expression) -> Values:
    return values | {"J": entries(J)}


def _filter_inertia(values: Values) -> Expression:
    return inertia(values["s"])


PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


@dataclass(frozen=True)
class GeometricMoves:
    """Candidates over a chart in axes g.

    Attributes
    ----------
    inertia : Callable[[dict[str, Expression]], Expression]
        J of the blocks.
    with_inertia : Callable[[dict[str, Expression], Expression], dict[str, Expression]]
        The blocks with another J.
    axes : Sequence[GaugeAxis]
        Of rotations of g with names.
    scale_held : bool
        Whether the chart holds J with its scale.
    """

    inertia: Callable[[dict[str, Expression]], Expression]
    with_inertia: Callable[[dict[str, Expression], Expression], dict[str, Expression]]
    axes: Sequence[GaugeAxis]
    scale_held: bool

    def symmetries(self, values: dict[str, Expression], spin: int | None) -> Iterator[Symmetry]:
        """All candidates of symmetries.

        ``spin``: an axis far from the rate's, None of a body that does not rotate.
        """
        if "c" in values:
            yield from (
                Symmetry("gauge translation", f"translation of g along {AXES[k]}", _shift_along(k), 0.05)
                for k in range(3)
            )
        if "q" in values:
            yield from (
                Symmetry("gauge rotation", rotation_of_g(axis.name), self._turn_about(axis), 0.3)
                for axis in self.axes
            )
        if self.scale_held:
            yield Symmetry("scale of the inertia", "scale of the inertia", self._heavier, 0.2)
        if "c" in values:
            yield Symmetry("scale of all lengths", "scale of all lengths", _longer, 0.1)
            yield from _centre(spin)
        yield from self._masses(spin)
        if "q" in values:
            yield from inertial_symmetries("t" if "t" in values else None, "q")
        if "c" in values:
            yield from self._few_landmarks(spin)
        if "b" in values:
            yield from self._bias_for_rate()

    def _bias_for_rate(self) -> Iterator[Symmetry]:
        """Errors of a gyro's bias that look like another rate of a body that spins steadily."""
        words = "bias of the gyro against the rate"
        for axis in self.axes:
            yield Symmetry(
                words, f"{words}, with rotation of g about {axis.name}", self._turned_with_bias(axis), 0.3
            )
        yield Symmetry(words, f"{words} along the spin axis", _faster_with_bias, 0.1)

    def _turned_with_bias(self, axis: GaugeAxis) -> Move:
        turned = self._turn_about(axis)

        def move(state: State, amount: ca.SX) -> State:
            """The state moved by an amount, with the measured rate w + b as before."""
            moved = turned(state, amount)
            rate = state.values["w"] + state.values["b"]
            return State(moved.values | {"b": rate - moved.values["w"]}, moved.points)

        return move

    def _masses(self, spin: int | None) -> Iterator[Symmetry]:
        for index, (row, column) in enumerate(PAIRS):
            words = f"J_{AXES[row]}{AXES[column]}" if spin is None else f"J about the spin axis, {index + 1}"
            group = "inertia" if spin is None else "inertia that keeps the spin axis principal"
            yield Symmetry(group, words, self._mass(spin, row, column), 0.1)

    def _few_landmarks(self, spin: int | None) -> Iterator[Symmetry]:
        if spin is None:
            yield from turns_like_drift(_slow_turn)
        else:
            yield Symmetry(
                "spin about the line to the landmark",
                "spin about the line to the landmark",
                self._precession,
                0.1,
            )

    def _turn_about(self, axis: GaugeAxis) -> Move:
        def move(state: State, amount: ca.SX) -> State:
            """The state moved by an amount."""
            q, values = turn(axis.direction(state.values), amount), state.values
            R = matrix_from_quaternion(q)
            changed = values | {"q": product(values["q"], conjugate(q)), "w": R @ values["w"]}
            changed = self.with_inertia(changed, R @ self.inertia(values) @ R.T)
            if "c" in values:
                changed["c"] = R @ values["c"]
            return State(changed, turned_points(q, state))

        return move

    def _heavier(self, state: State, amount: ca.SX) -> State:
        return State(self.with_inertia(state.values, self.inertia(state.values) * (1 + amount)), state.points)

    def _mass(self, spin: int | None, row: int, column: int) -> Move:
        """Change of J that keeps the rate along a principal axis; any change of J where the rate is zero."""

        def move(state: State, amount: ca.SX) -> State:
            """The state moved by an amount."""
            frame = ca.DM.eye(3) if spin is None else _axes_across_rate(state.values["w"], spin)
            first, second = frame[:, row], frame[:, column]
            change = first @ second.T / ca.dot(first, first)
            J = self.inertia(state.values) + amount * (change + change.T) / 2
            return State(self.with_inertia(state.values, J), state.points)

        return move

    def _precession(self, state: State, amount: ca.SX) -> State:
        """More moment about the line from centre to landmark.

        The angular momentum stays the same: the line of a sphere moves as before.
        """
        values = state.values
        d, J = state.points[0][:, 0] - values["c"], self.inertia(values)
        changed = J + amount * ca.trace(J) / 3 * d @ d.T / ca.dot(d, d)
        rate = ca.inv_minor(changed) @ J @ values["w"]
        return State(self.with_inertia(values | {"w": rate}, changed), state.points)


def _axes_across_rate(w: Expression, spin: int) -> Expression:
    """Two directions across the rate, and the rate.

    Moments about each, and the product of the first two, keep it principal.
    """
    a = ca.cross(w, unit(spin))
    return ca.horzcat(a, ca.cross(w, a), w)


def _centre(spin: int | None) -> Iterator[Symmetry]:
    if spin is None:
        for k in range(3):
            yield Symmetry("centre of mass", f"centre of mass along {AXES[k]} of g", _centre_along(k), 0.05)
    else:
        yield Symmetry(
            "centre of mass along the spin axis",
            "centre of mass along the spin axis",
            _centre_along(None),
            0.05,
        )


def _faster_with_bias(state: State, amount: ca.SX) -> State:
    """A faster rate about the same axis and a bias that takes it away."""
    change = amount * state.values["w"]
    return state.with_values(w=state.values["w"] + change, b=state.values["b"] - change)


def _shift_along(axis: int) -> Move:
    def move(state: State, amount: ca.SX) -> State:
        """The state moved by an amount."""
        shift, values = amount * unit(axis), state.values
        changed = values | {"c": values["c"] + shift, "t": values["t"] - rotate(values["q"], shift)}
        return State(changed, shifted_points(shift, state))

    return move


def _longer(state: State, amount: ca.SX) -> State:
    return scaled(state, ("t", "v", "c"), amount)


def _centre_along(axis: int | None) -> Move:
    """Move of the centre of mass within the body, along the rate or an axis; g and all points stay."""

    def move(state: State, amount: ca.SX) -> State:
        """The state moved by an amount."""
        values = state.values
        return state.with_values(c=values["c"] + amount * (values["w"] if axis is None else unit(axis)))

    return move


def _slow_turn(axis: int | None) -> Move:
    """Slow rate of a resting body, and a velocity that compensates.

    About an axis or the line of the first two landmarks.
    """

    def move(state: State, amount: ca.SX) -> State:
        """The state moved by an amount."""
        values, points = state.values, state.points[0]
        first, second = points[:, 0], points[:, min(1, points.shape[1] - 1)]
        rate = amount * (second - first if axis is None else unit(axis))
        drift = rotate(values["q"], ca.cross(rate, first - values["c"]))
        return state.with_values(w=values["w"] + rate, v=values["v"] - drift)

    return move
