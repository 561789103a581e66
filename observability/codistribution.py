"""Gradients of Lie derivatives at one point, order by order, with their exact rank and null space.

Landmarks are many and meet only in the chart's directions. So every item's own unknowns are eliminated first, all items at once
(their rank is the sum over items), and what remains has as many columns as the chart has directions.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from jaxtyping import Num

from observability.exact_numbers import Arithmetic, Rationals
from observability.function_values import branch_decisions
from observability.power_series import Series
from observability.residue_matrices import FIELD, Reduced, null_vectors, product_of, reduce_columns
from observability.system import System, SystemSensor
from observability.tape import Tape
from spinfilters.core.errors import InputError, ShapeError

InputSeries = Sequence[Rationals]
"""Taylor coefficients of one known input, lowest first; what is missing is 0."""


@dataclass(frozen=True)
class SensorCodistribution:
    """Rows of one sensor in the codistribution.

    Attributes
    ----------
    common : ndarray of shape (l, k, r, n)
        (items, orders, values, n) by the chart's directions.
    own : ndarray of shape (l, k, r, o)
        (items, orders, values, unknown) by each item's own unknowns.
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
    point : Rationals
        Exact numbers of the chart (`Chart.point`).
    orders : int
        0 to orders - 1.
    inputs : InputSeries
        Known inputs of the system.

    Raises
    ------
    InputError, ShapeError
        For a wrong number of orders, numbers or inputs, or a point where an expression is not differentiable.
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
    series = Series(
        system.motion, branch_decisions(system.motion, start, arithmetic), arithmetic, (orders, 1, width)
    )
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
    series = Series(
        tape, branch_decisions(tape, points, arithmetic), arithmetic, (orders, count, width + unknown)
    )
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
    series = Series(tape, branch_decisions(tape, [[point]], arithmetic), arithmetic, (1, 1, 1))
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


@dataclass(frozen=True)
class Elimination:
    """All rows of a codistribution, eliminated.

    Attributes
    ----------
    rank : int
        Of the whole.
    own : tuple[Reduced, ...]
        Per sensor, its items with their own unknowns eliminated; columns are (own, common).
    common : Reduced
        What remains of all, in the chart's directions, as a batch of one.
    """

    rank: int
    own: tuple[Reduced, ...]
    common: Reduced

    def null_space(self) -> Num[np.ndarray, "n d"]:
        """Null space of the rows, as residues.

        Directions that no row sees, in the order of `System.names`.
        """
        base = null_vectors(self.common, self.common.rows.shape[2])
        sizes = [reduced.pivots.size for reduced in self.own]
        total = len(base) + sum(sizes)
        space = [np.concatenate([base, *[_answered(reduced, base) for reduced in self.own]])]
        offset = len(base)
        for reduced, size in zip(self.own, sizes, strict=True):
            space += list(_own_null_vectors(reduced, offset, total))
            offset += size
        return np.concatenate(space, axis=1)


def eliminate(sensors: list[SensorCodistribution]) -> Elimination:
    """Eliminate every item's own unknowns, then the chart's directions."""
    own = []
    for rows in sensors:
        items, unknown, directions = len(rows.own), rows.own.shape[-1], rows.common.shape[-1]
        matrices = np.concatenate([rows.own, rows.common], axis=3)
        own.append(reduce_columns(matrices.reshape(items, -1, unknown + directions), unknown))
    rest = [reduced.rest[:, :, reduced.pivots.shape[1] :] for reduced in own]
    stacked = np.concatenate([part.reshape(-1, part.shape[2]) for part in rest])
    stacked = stacked[stacked.any(axis=1)] if stacked.any() else stacked[:1]
    common = reduce_columns(stacked[np.newaxis], stacked.shape[1])
    return Elimination(
        sum(int(reduced.rank.sum()) for reduced in own) + int(common.rank[0]), tuple(own), common
    )


def _answered(reduced: Reduced, base: Num[np.ndarray, "n d"]) -> Num[np.ndarray, "o d"]:
    """Own unknowns of every item that make up for a change of the chart's directions."""
    items, unknown = reduced.pivots.shape
    answer = np.zeros((items, unknown, base.shape[1]), dtype=np.uint64)
    for item, column in zip(*np.nonzero(reduced.pivots >= 0), strict=True):
        row = reduced.rows[item, reduced.pivots[item, column], unknown:]
        answer[item, column] = FIELD.negative(product_of(row[np.newaxis], base)[0])
    return answer.reshape(items * unknown, base.shape[1])


def _own_null_vectors(reduced: Reduced, offset: int, total: int) -> list[Num[np.ndarray, "n 1"]]:
    """Directions within one item's own unknowns."""
    _items, unknown = reduced.pivots.shape
    vectors = []
    for item, column in zip(*np.nonzero(reduced.pivots < 0), strict=True):
        vector = np.zeros((total, 1), dtype=np.uint64)
        start = offset + item * unknown
        vector[start + column] = 1
        bound = np.flatnonzero(reduced.pivots[item] >= 0)
        vector[start + bound, 0] = FIELD.negative(reduced.rows[item, reduced.pivots[item, bound], column])
        vectors.append(vector)
    return vectors
