"""A body in a chart with its sensors in the terms of any other system: its flow, its exact rank, and its equations as a model."""

from collections.abc import Callable, Sequence
from fractions import Fraction

import casadi as ca
import numpy as np
from jaxtyping import Num

from observability.codistribution import Coefficients, ExactRank, Flow, OutputFamily, rank_by_orders
from observability.coordinates import is_attitude
from observability.exact_numbers import Arithmetic, PrimeField, Rationals
from observability.function_values import branch_decisions
from observability.model import Model
from observability.power_series import Series
from observability.residue_matrices import FIELD
from observability.system import System, SystemSensor
from observability.tape import Tape
from spinfilters.core.errors import InputError, ShapeError

InputSeries = Sequence[Rationals]
"""Taylor coefficients of one known input, lowest first; what is missing is 0."""


def body_rank(
    system: System,
    point: Rationals,
    orders: int,
    experiments: Sequence[InputSeries] = (),
    field: PrimeField = FIELD,
    stops: bool = False,
) -> ExactRank:
    """Rank of a body's sensors by the unknowns `System.names` at a point.

    Parameters
    ----------
    orders : int
        Taken at most.
    experiments : Sequence[InputSeries]
        With the system's known inputs; their rows are taken together.
    stops : bool
        Whether the first order that adds nothing is the last, as at a point in general position without inputs.
    """
    flows = [flow_of_system(system, point, field, given) for given in list(experiments) or [()]]
    return rank_by_orders(system.names, flows, field, orders, stops)


def flow_of_system(
    system: System, point: Rationals, arithmetic: Arithmetic, inputs: InputSeries = ()
) -> Flow:
    """A body's motion at a point, with tangents by the chart's directions; every sensor is a family of outputs.

    Parameters
    ----------
    point : Rationals
        Exact numbers of the chart (`Chart.point`).
    inputs : InputSeries
        Known inputs of the system.

    Raises
    ------
    InputError, ShapeError
        For a wrong number of numbers or inputs, or a point where an expression is not differentiable.
    """
    chart = system.chart
    if len(point) != chart.mean_dim:
        raise ShapeError(
            f"a point of the chart {chart.name} has {chart.mean_dim} numbers, got {len(point)}; make it with Chart.point"
        )
    if len(inputs) != len(system.inputs) or not all(inputs):
        raise InputError(
            f"the system has {len(system.inputs)} known inputs, got {len(inputs)} series; give the Taylor coefficients of each"
        )
    state = np.zeros((chart.mean_dim, 1, 1 + chart.error_dim), dtype=arithmetic.dtype)
    state[:, 0, 0] = arithmetic.numbers(point)
    state[:, 0, 1:] = _directions(system, point, arithmetic)
    at_start = [[point], [tuple(given[0] for given in inputs)]]
    decisions = branch_decisions(system.motion, at_start, arithmetic)
    families = [
        _family(tape, sensor, point, arithmetic)
        for tape, sensor in zip(system.outputs, system.sensors, strict=True)
    ]
    given = known_inputs(inputs, arithmetic, state.shape[1:])
    return Flow(arithmetic, system.motion, decisions, state, given, tuple(families))


def known_inputs(
    inputs: InputSeries, arithmetic: Arithmetic, shape: tuple[int, int]
) -> Callable[[int], Coefficients]:
    """Coefficients of known inputs by their order, the same at every point and without tangents."""

    def coefficients(order: int) -> Coefficients:
        values = np.zeros((len(inputs), *shape), dtype=arithmetic.dtype)
        for each, given in zip(values, inputs, strict=True):
            each[:, 0] = arithmetic.numbers(given[order : order + 1] or (Fraction(0),))
        return [(1, values)]

    return coefficients


def _family(tape: Tape, sensor: SystemSensor, point: Rationals, arithmetic: Arithmetic) -> OutputFamily:
    items = list(sensor.parameters)
    decisions = branch_decisions(tape, [[point] * len(items), items], arithmetic)
    numbers = np.stack([arithmetic.numbers(item) for item in items], axis=1)
    return OutputFamily(tape, decisions, numbers, sensor.unknown)


def _directions(system: System, point: Rationals, arithmetic: Arithmetic) -> Num[np.ndarray, "n e"]:
    tape = system.directions
    series = Series(tape, branch_decisions(tape, [[point]], arithmetic), arithmetic, (1, 1, 1))
    series.put(0, 0, arithmetic.numbers(point).reshape(-1, 1, 1))
    return series.advance(0)[:, 0, 0].reshape(system.chart.error_dim, system.chart.mean_dim).T


def model_of_system(system: System, point: Rationals | None = None, name: str = "the body") -> Model:
    """The model of a body: its chart's rates are f, its sensors' values h, unknown landmarks parameters, quaternions unit vectors.

    Parameters
    ----------
    system : System
        Chart, sensors and known inputs.
    point : Rationals, optional
        Exact numbers of the chart (`Chart.point`), where a special motion is asked for; landmarks are then those of the sensors.
    """
    chart = system.chart
    numbers = [_numbers_of(block.name, block.size) for block in chart.blocks]
    states = tuple(each for group in numbers for each in group)
    inputs = tuple(str(each.value).replace(" ", "_") for each in system.inputs)
    x, u = (ca.vertcat(ca.SX(0, 1), *[ca.SX.sym(each) for each in group]) for group in (states, inputs))
    symbols = {each: x[k] for k, each in enumerate(states)} | {each: u[k] for k, each in enumerate(inputs)}
    parameters = tuple(each.replace(" ", "_") for each in system.names[chart.error_dim :])
    symbols |= {each: ca.SX.sym(each) for each in parameters}
    outputs: dict[str, ca.SX] = {}
    values: dict[str, object] = {}
    own = iter(parameters)
    for index, sensor in enumerate(system.sensors):
        for item, given in enumerate(sensor.parameters):
            names = [next(own) for _ in range(sensor.unknown)]
            values |= dict(zip(names, given, strict=False))
            known = [ca.SX(float(number)) for number in given[sensor.unknown :]]
            value = ca.SX(system.measured(sensor, x, ca.vertcat(*[symbols[each] for each in names], *known)))
            outputs |= {f"y{index + 1}_{item + 1}_{k + 1}": value[k] for k in range(value.numel())}
    rate = ca.densify(ca.SX(system.rate(x, u)))
    special = {} if point is None else {**dict(zip(states, point, strict=True)), **values}
    return Model(
        states,
        parameters,
        inputs,
        (),
        (),
        symbols=symbols,
        rates={each: rate[k] for k, each in enumerate(states)},
        outputs=outputs,
        point=special,
        name=name,
        unit_vectors=tuple(
            group for group, block in zip(numbers, chart.blocks, strict=True) if is_attitude(block)
        ),
    )


def _numbers_of(name: str, size: int) -> tuple[str, ...]:
    return tuple(f"{name}_{k + 1}" for k in range(size))
