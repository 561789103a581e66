"""Outputs of a system along its motion, by Taylor series."""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from jaxtyping import Float

from observability.arithmetic import Reals
from observability.branch_decisions import BranchDecisions, float_branch_decisions
from observability.codistribution import InputSeries
from observability.rational import Rationals
from observability.series import Series
from observability.system import System
from observability.tape import evaluate

ORDERS = 22
"""With steps that turn by at most 0.6 rad the first term left out is below 1e-16 of the state."""


@dataclass(frozen=True)
class Trajectories:
    """Several states of one system, moved on together.

    Attributes
    ----------
    states: (mean_dim, b).   parameters: (parameter_dim, items, b) of every sensor.
    """

    states: Float[np.ndarray, "n b"]
    parameters: tuple[Float[np.ndarray, "_ _ b"], ...]


def simulate(
    system: System, start: Trajectories, duration: float, steps: int, inputs: InputSeries = ()
) -> list[Float[np.ndarray, "k _ _ b"]]:
    """Values of each sensor at the start and at ``steps`` equal times after it."""
    states = [start.states]
    for step in range(steps):
        states.append(_after(system, states[-1], duration / steps, _shifted(inputs, step * duration / steps)))
    return [
        np.stack([_measured(system, index, x, start.parameters[index]) for x in states])
        for index in range(len(system.sensors))
    ]


def _after(
    system: System, x: Float[np.ndarray, "n b"], dt: float, inputs: InputSeries
) -> Float[np.ndarray, "n b"]:
    arithmetic, batch = Reals(), x.shape[1]
    series = Series(system.motion, _smooth(system, x, inputs), arithmetic, (ORDERS, batch, 1))
    coefficient, after = x[:, :, np.newaxis], x.copy()
    for order in range(ORDERS - 1):
        series.put(0, order, coefficient)
        known = [float(given[order]) if order < len(given) else 0.0 for given in inputs]
        series.put(1, order, np.tile(np.array(known).reshape(-1, 1, 1), (1, batch, 1)))
        coefficient = series.advance(order) / (order + 1)
        after = after + coefficient[:, :, 0] * dt ** (order + 1)
    return after


def _smooth(system: System, x: Float[np.ndarray, "n b"], inputs: InputSeries) -> BranchDecisions:
    known = np.array([[float(given[0])] * x.shape[1] for given in inputs]).reshape(-1, x.shape[1])
    return float_branch_decisions(system.motion, [x, known])


def _measured(
    system: System, index: int, x: Float[np.ndarray, "n b"], parameters: Float[np.ndarray, "p l b"]
) -> Float[np.ndarray, "r l b"]:
    tape, (_, items, batch) = system.outputs[index], parameters.shape
    states = np.repeat(x[:, np.newaxis], items, axis=1)
    registers = evaluate(tape, [states.reshape(len(x), -1), parameters.reshape(len(parameters), -1)])
    return registers[tape.output].reshape(-1, items, batch)


def _shifted(inputs: InputSeries, time: float) -> InputSeries:
    """The same inputs as series about a later time."""
    return [_polynomial_at(given, Fraction(time)) for given in inputs]


def _polynomial_at(given: Rationals, time: Fraction) -> Rationals:
    coefficients = list(given)
    for start in range(len(coefficients) - 1):  # Horner's scheme, repeated
        for k in range(len(coefficients) - 2, start - 1, -1):
            coefficients[k] += time * coefficients[k + 1]
    return tuple(coefficients)
