"""Null space in terms of named symmetries, checked by finite moves and by the outputs' Taylor series."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import casadi as ca
import numpy as np
from jaxtyping import Float, Num

from observability.body_model import InputSeries, known_inputs
from observability.codistribution import ExactRank, Flow, motion_coefficients
from observability.exact_numbers import Arithmetic, Rationals, Reals, as_floats
from observability.function_values import BranchDecisions, branch_decisions
from observability.named_symmetries import candidates
from observability.power_series import Series
from observability.residue_matrices import in_span, reduce_columns
from observability.symmetry import State, Symmetry
from observability.system import System
from observability.tape import Tape, evaluate, float_choices, tape_of

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
