"""Gradients of Lie derivatives, order by order, at one point of a system."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from jaxtyping import Num

from observability.arithmetic import Arithmetic
from observability.branch_decisions import branch_decisions
from observability.rational import Rationals
from observability.series import Series
from observability.system import System, SystemSensor
from observability.tape import Tape
from spinfilters.errors import InputError, ShapeError

InputSeries = Sequence[Rationals]
"""Taylor coefficients of one known input, lowest first; what is missing is 0."""


@dataclass(frozen=True)
class SensorCodistribution:
    """Rows of one sensor in the codistribution.

    Attributes
    ----------
    common: (items, orders, values, n) by the chart's directions.
    own: (items, orders, values, unknown) by each item's own unknowns.
    """

    common: Num[np.ndarray, "l k r n"]
    own: Num[np.ndarray, "l k r o"]

    def upto(self, orders: int) -> "SensorCodistribution":
        """The first orders alone."""
        return SensorCodistribution(self.common[:, :orders], self.own[:, :orders])


def codistribution(
    system: System, point: Rationals, orders: int, arithmetic: Arithmetic, inputs: InputSeries = ()
) -> list[SensorCodistribution]:
    """Rows of every sensor: the k-th is the gradient of the k-th Lie derivative over k!.

    Parameters
    ----------
    point: exact numbers of the chart (`Chart.point`).   orders: 0 to orders - 1.   inputs: known inputs of the system.

    Raises
    ------
    InputError, ShapeError: for a wrong number of orders, numbers or inputs, or a point where an expression is not differentiable.
    """
    motion = motion_series(system, point, orders, arithmetic, inputs)
    return [
        _rows(tape, sensor, motion, point, arithmetic)
        for tape, sensor in zip(system.outputs, system.sensors, strict=True)
    ]


def motion_series(
    system: System, point: Rationals, orders: int, arithmetic: Arithmetic, inputs: InputSeries = ()
) -> Num[np.ndarray, "k n m"]:
    """Taylor coefficients of the state with tangents by the chart's directions: (orders, mean_dim, 1 + error_dim)."""
    _check(system, point, orders, inputs)
    size, width = system.chart.mean_dim, 1 + system.chart.error_dim
    state = np.zeros((orders, size, 1, width), dtype=arithmetic.dtype)
    state[0, :, 0, 0] = arithmetic.numbers(point)
    state[0, :, 0, 1:] = _directions(system, point, arithmetic)
    padded = [tuple(given[:orders]) + (Fraction(0),) * (orders - len(given)) for given in inputs]
    start = [[point], [tuple(given[0] for given in padded)]]
    series = Series(system.motion, branch_decisions(system.motion, start), arithmetic, (orders, 1, width))
    for order in range(orders):
        series.put(0, order, state[order])
        series.put(1, order, _constants([tuple(given[order] for given in padded)], width, arithmetic))
        if order + 1 < orders:
            share = arithmetic.numbers([Fraction(1, order + 1)])
            state[order + 1] = arithmetic.product(series.advance(order), share)
    return state[:, :, 0]


def _rows(
    tape: Tape,
    sensor: SystemSensor,
    motion: Num[np.ndarray, "k n m"],
    point: Rationals,
    arithmetic: Arithmetic,
) -> SensorCodistribution:
    orders, size, width = motion.shape
    count, unknown = sensor.count, sensor.unknown
    state = np.zeros((orders, size, count, width + unknown), dtype=arithmetic.dtype)
    state[..., :width] = motion[:, :, np.newaxis]
    parameters = _constants(sensor.parameters, width + unknown, arithmetic)
    for k in range(unknown):
        parameters[k, :, width + k] = 1
    points = [[point] * count, list(sensor.parameters)]
    series = Series(tape, branch_decisions(tape, points), arithmetic, (orders, count, width + unknown))
    values = []
    for order in range(orders):
        series.put(0, order, state[order])
        series.put(1, order, parameters if order == 0 else np.zeros_like(parameters))
        values.append(series.advance(order))
    rows = np.stack(values).transpose(2, 0, 1, 3)
    return SensorCodistribution(rows[..., 1:width], rows[..., width:])


def _constants(items: Sequence[Rationals], width: int, arithmetic: Arithmetic) -> Num[np.ndarray, "n b m"]:
    """An input that does not depend on the unknowns, for a batch of items."""
    values = np.zeros((len(items[0]), len(items), width), dtype=arithmetic.dtype)
    for index, item in enumerate(items):
        values[:, index, 0] = arithmetic.numbers(item)
    return values


def _directions(system: System, point: Rationals, arithmetic: Arithmetic) -> Num[np.ndarray, "n e"]:
    tape = system.directions
    series = Series(tape, branch_decisions(tape, [[point]]), arithmetic, (1, 1, 1))
    series.put(0, 0, _constants([point], 1, arithmetic))
    return series.advance(0)[:, 0, 0].reshape(system.chart.error_dim, system.chart.mean_dim).T


def _check(system: System, point: Rationals, orders: int, inputs: InputSeries) -> None:
    if orders < 1:
        raise InputError(f"{orders} orders leave no rows; take at least 1")
    if len(point) != system.chart.mean_dim:
        raise ShapeError(
            f"a point of the chart {system.chart.name} has {system.chart.mean_dim} numbers, got {len(point)}; "
            "make it with Chart.point"
        )
    if len(inputs) != len(system.inputs) or not all(inputs):
        raise InputError(
            f"the system has {len(system.inputs)} known inputs, got {len(inputs)} series; give the Taylor coefficients of each"
        )
