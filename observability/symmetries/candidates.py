"""Which symmetries to try for a system at a point."""

from functools import singledispatch

import casadi as ca
import numpy as np

from observability.charts.chart import Chart, Values
from observability.charts.filter_state import FilterChart, with_second_moments
from observability.charts.principal import PrincipalChart
from observability.charts.tensor import TensorChart, entries, symmetric
from observability.rational import Rationals, as_floats
from observability.symmetries.geometric import GeometricMoves
from observability.symmetries.principal_moves import principal_symmetries
from observability.symmetries.symmetry import Symmetry, gauge_axes
from observability.system import System
from spinfilters.attitude.expressions import Expression
from spinfilters.dynamics.mass_distribution import inertia


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
