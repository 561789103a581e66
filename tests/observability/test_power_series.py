"""Power series of tapes: every operation, the Lie derivatives of whole systems, and how the expressions grow."""

from fractions import Fraction
from math import factorial

import casadi as ca
import numpy as np
import pytest

from experiments.benchmarks.symbolic_series import lie_derivatives
from observability import system as sensors
from observability.canonical_motions import landmarks, point_of
from observability.coordinates import Chart
from observability.exact_numbers import PrimeField, Rationals, Reals, as_floats, rationals
from observability.function_values import branch_decisions
from observability.power_series import Series
from observability.system import Input, System
from observability.tape import tape_of
from spinfilters.core.errors import InputError
from tests.observability.analyser_samples import CHARTS, TUMBLE, stereo_system
from tests.observability.float_rank import sensor_rows

ORDERS = 6
POINT = rationals((0.7, -1.3, 0.4))
EXPRESSIONS = {
    "products": lambda x: x[0] * x[1] - x[1] ** 2 * x[2],
    "quotients": lambda x: (x[0] + 2) / (x[1] * x[2]) - 1 / x[0],
    "root": lambda x: ca.sqrt(x[0] ** 2 + x[1] ** 2),
    "exponential": lambda x: ca.exp(x[0] - x[1] / 3) * x[2],
    "logarithm": lambda x: ca.log(x[0] + 3 * x[2]),
    "choices": lambda x: ca.fmax(x[0], x[1]) * ca.fmin(x[0], x[2]) + ca.fabs(x[1]) * x[0],
    "condition": lambda x: ca.if_else(x[0] > x[1], x[0] * x[2], x[1]),
}


def pushed(expression: ca.SX, x: ca.SX, rate: Rationals, arithmetic: Reals | PrimeField) -> np.ndarray:
    """Series of an expression along x + t rate with tangents by x: (orders, 4)."""
    tape = tape_of("the expression", [x], expression)
    series = Series(tape, branch_decisions(tape, [[POINT]], arithmetic), arithmetic, (ORDERS, 1, 4))
    found = []
    for order in range(ORDERS):
        values = np.zeros((3, 1, 4), dtype=arithmetic.dtype)
        if order == 0:
            values[:, 0, 0] = arithmetic.numbers(POINT)
            values[:, 0, 1:] = np.eye(3, dtype=arithmetic.dtype)
        elif order == 1:
            values[:, 0, 0] = arithmetic.numbers(rate)
        series.put(0, order, values)
        found.append(series.advance(order)[0, 0])
    return np.stack(found)


def _repeated_derivatives(system: System, index: int, orders: int) -> ca.Function:
    """(x, parameters) -> Lie derivatives and gradients by repeated differentiation, the oracle of small orders."""
    model, unknown = system.sensors[index].model, system.sensors[index].unknown
    x, p = ca.SX.sym("x", system.chart.mean_dim), ca.SX.sym("p", model.parameter_dim)
    derivatives, rate = [ca.SX(system.measured(system.sensors[index], x, p))], system.rate(x, ca.SX(0, 1))
    for _ in range(orders - 1):
        derivatives.append(ca.jtimes(derivatives[-1], x, rate))
    stacked = ca.vertcat(*derivatives)
    gradient = ca.jacobian(stacked, ca.vertcat(x, p))[:, : system.chart.mean_dim + unknown]
    return ca.Function("repeated", [x, p], [stacked, gradient])


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_coefficients_and_tangents_are_repeated_derivatives_over_factorials(name: str) -> None:
    x, t = ca.SX.sym("x", 3), ca.SX.sym("t")
    rate = rationals((0.3, 0.5, -0.2))
    expression = ca.SX(EXPRESSIONS[name](x))
    moved = ca.substitute(expression, x, x + t * as_floats(rate))
    derivative = moved
    found = pushed(expression, x, rate, Reals())
    for order in range(ORDERS):
        whole = ca.horzcat(derivative, ca.jacobian(derivative, x)) / factorial(order)
        expected = np.asarray(ca.Function("f", [x, t], [ca.densify(whole)])(as_floats(POINT), 0.0))[0]
        np.testing.assert_allclose(found[order], expected, rtol=1e-11, atol=1e-13 * np.abs(expected).max())
        derivative = ca.jacobian(derivative, t)


@pytest.mark.parametrize("name", ["products", "quotients", "choices", "condition"])
def test_residues_of_the_series_are_those_of_the_exact_rational_coefficients(name: str) -> None:
    x, rate = ca.SX.sym("x", 3), rationals((0.3, 0.5, -0.2))
    field = PrimeField()
    exact = pushed(ca.SX(EXPRESSIONS[name](x)), x, rate, field)[:2]
    floats = pushed(ca.SX(EXPRESSIONS[name](x)), x, rate, Reals())[:2]
    candidates = [Fraction(value).limit_denominator(10**7) for value in floats.ravel()]
    np.testing.assert_array_equal(exact.ravel(), field.numbers(candidates))


@pytest.mark.parametrize("chart", CHARTS, ids=lambda chart: chart.name)
def test_power_series_agree_with_repeated_differentiation_of_the_same_system(chart: Chart) -> None:
    system = stereo_system(chart, 4)
    x = as_floats(point_of(chart, TUMBLE))
    parameters = np.stack([as_floats(item) for item in system.sensors[0].parameters])
    values, gradients = lie_derivatives(system, 0, 5)(x, parameters)
    oracle = _repeated_derivatives(system, 0, 5)
    for item, value, gradient in zip(parameters, values, gradients, strict=True):
        expected, slope = (np.asarray(each) for each in oracle(x, item))
        np.testing.assert_allclose(value, expected[:, 0], rtol=1e-14, atol=1e-14 * np.abs(expected).max())
        size = np.linalg.norm(slope, axis=1, keepdims=True)
        np.testing.assert_allclose(gradient / size, slope / size, rtol=0, atol=1e-14)


@pytest.mark.parametrize("chart", CHARTS, ids=lambda chart: chart.name)
def test_the_numeric_rows_are_the_symbolic_ones_by_error_components_over_factorials(chart: Chart) -> None:
    system, point = stereo_system(chart, 3), point_of(chart, TUMBLE)
    (rows,) = sensor_rows(system, point, 5)
    x = ca.SX.sym("x", chart.mean_dim)
    directions = np.asarray(
        ca.Function("d", [x], [ca.densify(chart.directions(chart.unpack(x)))])(as_floats(point))
    )
    parameters = np.stack([as_floats(item) for item in system.sensors[0].parameters])
    _, gradients = lie_derivatives(system, 0, 5)(as_floats(point), parameters)
    scale = np.array([factorial(order) for order in range(5)])[:, np.newaxis, np.newaxis]
    for item, gradient in enumerate(gradients):
        shaped = gradient.reshape(5, 3, -1) / scale
        np.testing.assert_allclose(
            rows[:, item, :, 3:], shaped[..., : chart.mean_dim] @ directions, rtol=1e-11, atol=1e-10
        )
        np.testing.assert_allclose(
            rows[:, item, :, :3], shaped[..., chart.mean_dim :], rtol=1e-11, atol=1e-10
        )


@pytest.mark.parametrize("chart", CHARTS, ids=lambda chart: chart.name)
def test_order_eight_of_four_landmarks_is_a_small_expression(chart: Chart) -> None:
    assert lie_derivatives(stereo_system(chart, 4), 0, 9).nodes <= 110_000


def test_the_expression_does_not_grow_with_the_number_of_landmarks() -> None:
    chart = CHARTS[0]
    few, many = (lie_derivatives(stereo_system(chart, count), 0, 4).nodes for count in (1, 50))
    assert few == many


def test_symbolic_derivatives_along_inputs_are_refused() -> None:
    system = System(CHARTS[0], [sensors.watching("stereo", landmarks(1))], [Input.INSPECTOR_X])
    with pytest.raises(InputError, match="use gradient_rows"):
        lie_derivatives(system, 0, 3)
