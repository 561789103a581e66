"""Null vectors and Lie derivatives in rationals and as formulas, by hand where they are simple."""

import math
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

from observability import analyse
from observability.written_formulas import written
from spinfilters.core.errors import InputError

EULER = {
    "states": ["w1", "w2", "w3"],
    "parameters": ["J1", "J2", "J3"],
    "equations": {"w1": "(J2 - J3)*w2*w3/J1", "w2": "(J3 - J1)*w3*w1/J2", "w3": "(J1 - J2)*w1*w2/J3"},
    "outputs": {"y1": "w1", "y2": "w2", "y3": "w3"},
}
COMPARTMENTS = {
    "states": ["x0", "x1"],
    "parameters": ["a01", "a21", "a12"],
    "equations": {"x0": "-(a01 + a21)*x0 + a12*x1", "x1": "a21*x0 - a12*x1"},
    "outputs": {"y": "x0"},
}


def test_the_scale_of_the_moments_is_a_null_vector_in_rationals_and_in_symbols() -> None:
    found = analyse(EULER)
    assert found.symbolic_null_vectors == [{"J1": "J1/J3", "J2": "J2/J3", "J3": "1"}]
    exact = found.null_vectors
    assert exact is not None
    (vector,) = exact.vectors
    point = exact.point
    assert vector == {"J1": point["J1"] / point["J3"], "J2": point["J2"] / point["J3"], "J3": Fraction(1)}


def test_a_rational_null_vector_is_one_of_the_matrix_in_symbols() -> None:
    found = analyse(COMPARTMENTS)
    assert found.null_vectors is not None
    point = {name: float(value) for name, value in found.null_vectors.point.items()}
    matrix = found.observability_matrix()
    table = np.array([[eval(each, point) for each in row] for row in matrix.entries])
    assert np.linalg.matrix_rank(table) == found.rank
    (vector,) = found.null_vectors.vectors
    column = np.array([float(vector.get(name, Fraction(0))) for name in matrix.unknowns])
    assert np.abs(table @ column).max() < 1e-9 * np.abs(table).max()


def test_a_null_vector_without_a_generator_is_interpolated() -> None:
    # The state z drifts with what x has been: no field without a history moves it.
    document = {
        "states": ["x", "z"],
        "parameters": ["a"],
        "equations": {"x": "z*a", "z": "x**3*a"},
        "outputs": {"y": "x"},
    }
    found = analyse(document | {"parameters": ["a", "b"], "equations": {"x": "z*a", "z": "x**3*b"}})
    assert found.symbolic_null_vectors == [{"a": "-a/z", "b": "b/z", "z": "1"}]


def test_no_rational_null_vector_is_given_with_functions_of_no_rational_value() -> None:
    document = {"states": ["a", "b"], "equations": {"a": "sin(b - a)", "b": "1"}, "outputs": {"y": "a - b"}}
    assert analyse(document).null_vectors is None


def test_lie_derivatives_are_printed_with_their_gradients() -> None:
    words = str(analyse(EULER).observability_matrix(2))
    assert "L1 y2 = w1*w3*(J3 - J1)/J2\n" in words
    assert "  d/dJ2: w1*w3*(J1 - J3)/J2**2\n" in words


def test_a_special_point_is_put_in_after_differentiation() -> None:
    found = analyse(EULER, at={"w1": 0, "w2": 0, "w3": 1}).observability_matrix(2)
    assert [row.gradient for row in found.rows[3:]] == [
        {"w2": "(J2 - J3)/J1"},
        {"w1": "(J3 - J1)/J2"},
        {},
    ]


def test_derivatives_of_inputs_are_symbols_of_their_own() -> None:
    document = {
        "states": ["x"],
        "unknown_inputs": ["w"],
        "inputs": ["u"],
        "equations": {"x": "w*u"},
        "outputs": {"y": "x"},
    }
    found = analyse(document).observability_matrix(3)
    assert found.unknowns == ("x", "w", "d1_w")
    assert found.rows[2].formula == "d1_u*w + d1_w*u"


def test_a_formula_that_grows_too_long_is_refused_in_words() -> None:
    document = {
        "states": ["x", "z"],
        "parameters": ["a", "b"],
        "equations": {"x": "sin(x*z + a)/(x + b)", "z": "cos(x + z)/(z + exp(a*x))"},
        "outputs": {"y": "x"},
    }
    with pytest.raises(InputError, match="ask for fewer derivatives"):
        analyse(document).observability_matrix(12)


def test_a_written_formula_has_the_value_of_its_expression() -> None:
    a, b, c = (ca.SX.sym(name) for name in "abc")
    cases = {
        a * (b - c) / c: "a*(b - c)/c",
        -a - b: "-a - b",
        ca.sqrt(a + b) / 2: "sqrt(a + b)/2",
        ca.exp(-a * c) * b: "b*exp(-a*c)",
        (a + b) / (a + c): "(a + b)/(a + c)",
        a ** (b + 1): "(a)**(b + 1)",
        (a - b) ** 2 - a * a: "b*(b - 2*a)",
        a - a: "0",
    }
    values = {"a": 1.3, "b": 0.7, "c": 0.4}
    for expression, text in cases.items():
        assert written(expression) == text
        number = float(ca.Function("f", [a, b, c], [expression])(*values.values()))
        assert eval(text, {**values, "sqrt": math.sqrt, "exp": math.exp}) == pytest.approx(number)


NOTHING_REACHED: dict[str, dict[str, object]] = {
    "a constant": {"outputs": {"y": "1"}},
    "a state less itself": {"outputs": {"y": "x - x"}},
    "a known input": {"inputs": ["u"], "outputs": {"y": "u"}},
    "a known constant": {"known_constants": ["k"], "outputs": {"y": "k"}},
    "no states": {"states": [], "equations": {}, "outputs": {"y": "2"}},
}


@pytest.mark.parametrize("name", NOTHING_REACHED)
def test_outputs_that_depend_on_no_unknown_leave_them_all(name: str) -> None:
    document = {"states": ["x"], "parameters": ["a"], "equations": {"x": "a"}} | NOTHING_REACHED[name]
    found = analyse(document)
    assert found.rank == 0
    expected = [{each: "1"} for each in found.model.unknowns]
    assert found.document()["null_vectors"]["vectors"] == expected
    assert found.symbols_in_words().startswith("Null vectors.\nAnywhere:")
    assert found.symbolic_null_vectors == expected
