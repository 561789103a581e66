"""Null space in terms of named symmetries, checked by finite moves and by the outputs' Taylor series."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import singledispatch

import casadi as ca
import numpy as np
from jaxtyping import Float, Num

from observability.body_model import InputSeries, known_inputs
from observability.codistribution import ExactRank, Flow, motion_coefficients
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
from observability.exact_numbers import Arithmetic, Rationals, Reals, as_floats
from observability.function_values import BranchDecisions, branch_decisions
from observability.power_series import Series
from observability.residue_matrices import in_span, reduce_columns
from observability.symmetry import (
    AXES,
    GaugeAxis,
    Move,
    State,
    Symmetry,
    gauge_axes,
    gauge_rotations,
    gauge_translations,
    inertial_symmetries,
    principal_symmetries,
    scaled,
    shifted_points,
    turn,
    turned_points,
    turns_like_drift,
    unit,
)
from observability.system import System
from observability.tape import Tape, evaluate, float_choices, tape_of
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
            yield from gauge_translations(_shift_along)
        if "q" in values:
            yield from gauge_rotations(self.axes, self._turn_about)
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


ORDERS = 22
"""With steps that turn by at most 0.6 rad the first term left out is below 1e-16 of the state."""


@dataclass(frozen=True)
class Trajectories:
    """Several states of one system, moved on together.

    Attributes
    ----------
    states : ndarray of shape (n, b)
        (mean_dim, b).
    parameters : tuple[ndarray, ...]
        (parameter_dim, items, b) of every sensor.
    """

    states: Float[np.ndarray, "n b"]
    parameters: tuple[Float[np.ndarray, "_ _ b"], ...]


def simulate(
    system: System, start: Trajectories, duration: float, steps: int, inputs: InputSeries = ()
) -> list[Float[np.ndarray, "k _ _ b"]]:
    """Values of each sensor at the start and at ``steps`` equal times after it."""
    states = [start.states]
    for step in range(steps):
        states.append(
            _state_after(system, states[-1], duration / steps, _shift_inputs(inputs, step * duration / steps))
        )
    return [
        np.stack([_measure_outputs(system, index, x, start.parameters[index]) for x in states])
        for index in range(len(system.sensors))
    ]


def _state_after(
    system: System, x: Float[np.ndarray, "n b"], dt: float, inputs: InputSeries
) -> Float[np.ndarray, "n b"]:
    start = x[:, :, np.newaxis]
    flow = Flow(
        Reals(),
        system.motion,
        _smooth(system, x, inputs),
        start,
        known_inputs(inputs, Reals(), start.shape[1:]),
    )
    coefficients = motion_coefficients(flow, ORDERS)
    return sum((each[:, :, 0] * dt**order for order, (each, _) in enumerate(coefficients)), np.zeros_like(x))


def _smooth(system: System, x: Float[np.ndarray, "n b"], inputs: InputSeries) -> BranchDecisions:
    known = np.array([[float(given[0])] * x.shape[1] for given in inputs]).reshape(-1, x.shape[1])
    return BranchDecisions(float_choices(system.motion, [x, known]), {})


def _measure_outputs(
    system: System, index: int, x: Float[np.ndarray, "n b"], parameters: Float[np.ndarray, "p l b"]
) -> Float[np.ndarray, "r l b"]:
    tape, (_, items, batch) = system.outputs[index], parameters.shape
    states = np.repeat(x[:, np.newaxis], items, axis=1)
    registers = evaluate(tape, [states.reshape(len(x), -1), parameters.reshape(len(parameters), -1)])
    return registers[tape.output].reshape(-1, items, batch)


def _shift_inputs(inputs: InputSeries, time: float) -> InputSeries:
    """The same inputs as series about a later time."""
    return [_polynomial_at(given, Fraction(time)) for given in inputs]


def _polynomial_at(given: Rationals, time: Fraction) -> Rationals:
    coefficients = list(given)
    for start in range(len(coefficients) - 1):  # Horner's scheme, repeated
        for k in range(len(coefficients) - 2, start - 1, -1):
            coefficients[k] += time * coefficients[k + 1]
    return tuple(coefficients)


FINITE_TOLERANCE = 1e-9
"""Px, m, rad/s, or parts of a quaternion, that outputs may differ by after a finite move along a symmetry: rounding only."""
TURN = 1.5
"""Angle in rad over which outputs are compared, or seconds for a body that hardly turns."""
STEPS = 3
SQUARE_LAW = (3.5, 4.5)
"""Halving a move that is a symmetry to first order only divides the change of the outputs by 4."""


@dataclass(frozen=True)
class Explained:
    """One direction of the null space.

    Attributes
    ----------
    symmetry : Symmetry
        What it is called.
    change : float
        Largest difference of any output after the finite move.
    finite : bool
        Whether outputs stay; if not, they change with the square of the move.
    """

    symmetry: Symmetry
    change: float
    finite: bool


@dataclass(frozen=True)
class Tangents:
    """Candidates that no row sees and that are independent, with their directions in floats (n, k)."""

    symmetries: list[Symmetry]
    directions: Float[np.ndarray, "n k"]

    def of(self, symmetries: Sequence[Symmetry]) -> Float[np.ndarray, "n k"]:
        """Directions of some of them."""
        return self.directions[:, [self.symmetries.index(each) for each in symmetries]]


def tangent_symmetries(system: System, point: Rationals, exact: ExactRank) -> Tangents:
    """All independent candidates whose tangents lie in the null space, exactly."""
    found = candidates(system, point)
    if not found or not exact.null_space.shape[1]:
        return Tangents([], np.zeros((system.dimension, 0)))
    tape = _tape_of_moves(system, found)
    tangents = _tangents(tape, system, point, exact.field)
    unseen = np.flatnonzero(in_span(exact.null_space, tangents, exact.field))
    pivots = reduce_columns(tangents[np.newaxis, :, unseen], len(unseen), exact.field).pivots[0]
    kept = unseen[pivots >= 0]
    return Tangents([found[k] for k in kept], _tangents(tape, system, point, Reals())[:, kept])


def explained(
    system: System, point: Rationals, symmetries: Sequence[Symmetry], inputs: InputSeries = ()
) -> list[Explained]:
    """Symmetries with the effect of a finite move.

    What is neither a symmetry nor one to first order is left out.
    """
    moved = _move_state(system, point, symmetries, (1.0, 0.5))
    outputs = simulate(system, moved, _duration(system, point), STEPS, inputs)
    differences = np.zeros(2 * len(symmetries))
    for values in outputs:
        change = np.abs(values[..., 1:] - values[..., :1])
        differences = np.maximum(differences, change.reshape(-1, len(differences)).max(axis=0))
    whole, half = differences.reshape(2, -1)
    finite = whole <= FINITE_TOLERANCE
    square = (SQUARE_LAW[0] * half <= whole) & (whole <= SQUARE_LAW[1] * half)
    found = zip(symmetries, whole, finite, finite | square, strict=True)
    return [
        Explained(symmetry, float(change), bool(holds)) for symmetry, change, holds, known in found if known
    ]


def _tape_of_moves(system: System, symmetries: Sequence[Symmetry]) -> Tape:
    """(state and parameters, amount) -> errors of all moves, stacked."""
    x, parameters, amount = _symbols(system)
    errors = [_error(system, x, parameters, symmetry, amount) for symmetry in symmetries]
    flat = ca.vertcat(x, *[ca.vec(each) for each in parameters])
    return tape_of("a symmetry", [flat, amount], ca.vertcat(*errors))


def _tangents(tape: Tape, system: System, point: Rationals, arithmetic: Arithmetic) -> Num[np.ndarray, "n k"]:
    """Directions of the moves at amount 0, in the order of `System.names`."""
    numbers = _flat(system, point)
    decisions = branch_decisions(tape, [[numbers], [(Fraction(0),)]], arithmetic)
    series = Series(tape, decisions, arithmetic, (1, 1, 2))
    values = np.zeros((len(numbers), 1, 2), dtype=arithmetic.dtype)
    values[:, 0, 0] = arithmetic.numbers(numbers)
    series.put(0, 0, values)
    series.put(1, 0, np.array([[[0, 1]]], dtype=arithmetic.dtype))
    return series.advance(0)[:, 0, 1].reshape(-1, system.dimension).T


def _move_state(
    system: System, point: Rationals, symmetries: Sequence[Symmetry], shares: Sequence[float]
) -> Trajectories:
    """The state itself, then moved by each symmetry's amount times the first share, then the next."""
    x, parameters, share = _symbols(system)
    flat, numbers = ca.vertcat(x, *[ca.vec(each) for each in parameters]), as_floats(_flat(system, point))
    columns = []
    for symmetry in symmetries:
        state = symmetry.move(_state(system, x, parameters), share * symmetry.amount)
        settled = system.chart.pack(system.chart.settled(state.values))
        columns.append(
            ca.vertcat(settled, *[ca.vec(each) for each in _with_points(system, parameters, state)])
        )
    move = ca.Function("move", [flat, share], [ca.densify(ca.horzcat(*columns))])
    stacked = np.concatenate(
        [numbers[:, np.newaxis], *[np.asarray(move(numbers, each)) for each in shares]], axis=1
    )
    edges = np.cumsum([system.chart.mean_dim, *[each.numel() for each in parameters]])
    parts = np.split(stacked, edges[:-1])
    shaped = tuple(
        part.reshape(sensor.count, -1, stacked.shape[1]).swapaxes(0, 1)
        for part, sensor in zip(parts[1:], system.sensors, strict=True)
    )
    return Trajectories(parts[0], shaped)


def _error(system: System, x: ca.SX, parameters: Sequence[ca.SX], symmetry: Symmetry, amount: ca.SX) -> ca.SX:
    """Error of the moved state against the state, in the order of `System.names`."""
    state = _state(system, x, parameters)
    moved = symmetry.move(state, amount)
    points = [after - before for before, after in zip(state.points, moved.points, strict=True)]
    own = iter(points)
    flat = [
        ca.vec(next(own)) if sensor.unknown == 3 else ca.SX.zeros(sensor.unknown * sensor.count)
        for sensor in system.sensors
    ]
    return ca.vertcat(system.chart.change(state.values, moved.values), *flat)


def _symbols(system: System) -> tuple[ca.SX, list[ca.SX], ca.SX]:
    parameters = [ca.SX.sym("p", sensor.model.parameter_dim, sensor.count) for sensor in system.sensors]
    return ca.SX.sym("x", system.chart.mean_dim), parameters, ca.SX.sym("amount")


def _state(system: System, x: ca.SX, parameters: Sequence[ca.SX]) -> State:
    mapped = zip(parameters, system.sensors, strict=True)
    return State(system.chart.unpack(x), tuple(p[:3, :] for p, sensor in mapped if sensor.unknown == 3))


def _with_points(system: System, parameters: Sequence[ca.SX], state: State) -> list[ca.SX]:
    points = iter(state.points)
    return [
        ca.vertcat(next(points), p[3:, :]) if sensor.unknown == 3 else p
        for p, sensor in zip(parameters, system.sensors, strict=True)
    ]


def _flat(system: System, point: Rationals) -> Rationals:
    return point + tuple(number for sensor in system.sensors for item in sensor.parameters for number in item)


def _duration(system: System, point: Rationals) -> float:
    """Seconds in which the body turns by `TURN`, at most as many as `TURN`."""
    x = as_floats(point)
    rate = ca.Function("w", [u := ca.SX.sym("x", len(x))], [system.chart.seen(system.chart.unpack(u))["w"]])(
        x
    )
    return TURN / max(1.0, float(np.linalg.norm(_floats(rate))))


def _floats(value: ca.DM) -> Float[np.ndarray, " n"]:
    return np.asarray(value)[:, 0]
