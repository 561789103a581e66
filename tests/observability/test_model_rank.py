"""Exact ranks of small systems whose answers can be seen by hand or are in textbooks."""

from typing import Any

import casadi as ca
import pytest

from observability import analyse, model_rank
from observability.model import Model, model_of_expressions, model_of_text
from observability.model_rank import exact_rank, reached
from spinfilters.core.errors import InputError

SPRING = {
    "states": ["x", "v"],
    "parameters": ["k", "m", "d"],
    "equations": {"x": "v", "v": "-(k*x + d*v)/m"},
    "outputs": {"y": "x"},
}
PENDULUM = {
    "states": ["angle", "rate"],
    "parameters": ["length"],
    "known_constants": ["g"],
    "equations": {"angle": "rate", "rate": "-g/length*sin(angle)"},
    "outputs": {"y": "angle"},
}
ROCKET = {
    "states": ["h", "v"],
    "parameters": ["scale", "drag"],
    "known_constants": ["g"],
    "equations": {"h": "v", "v": "-g - drag*v**2*exp(-h/scale)"},
    "outputs": {"y": "h"},
}
GROWTH = {
    "states": ["n"],
    "parameters": ["rate", "exponent"],
    "equations": {"n": "rate*n**exponent"},
    "outputs": {"y": "n"},
}
WIND = {
    "states": ["x", "v"],
    "parameters": ["drag"],
    "unknown_inputs": ["wind"],
    "inputs": ["thrust"],
    "equations": {"x": "v", "v": "thrust - drag*(v - wind)"},
    "outputs": {"y": "x"},
}
TWO_TANKS = {
    "states": ["a", "b"],
    "parameters": ["k1", "k2"],
    "inputs": ["flow"],
    "equations": {"a": "flow - k1*sqrt(a)", "b": "k1*sqrt(a) - k2*sqrt(b)"},
    "outputs": {"y": "b"},
}


def _lost(model: Model) -> tuple[int, int, set[str]]:
    """Rank, dimension, and unknowns that are not observable."""
    part = reached(model)
    found = exact_rank(part)
    moved = {name for name, row in zip(found.names, found.null_space, strict=True) if row.any()}
    return found.rank, len(model.unknowns), moved | (set(model.unknowns) - set(part.unknowns))


@pytest.mark.parametrize(
    ("document", "expected"),
    [
        (SPRING, (4, 5, {"k", "m", "d"})),
        (PENDULUM, (3, 3, set())),
        (PENDULUM | {"parameters": ["length", "g"], "known_constants": []}, (3, 4, {"length", "g"})),
        (PENDULUM | {"point": {"angle": 0, "rate": 0}}, (2, 3, {"length"})),
        (ROCKET, (4, 4, set())),
        (
            ROCKET
            | {"parameters": ["scale", "drag", "m", "g"], "known_constants": [], "outputs": {"y": "h/m"}},
            (5, 6, {"h", "v", "drag", "scale", "m", "g"}),
        ),
        (GROWTH, (3, 3, set())),
        (WIND, (3, 4, {"drag", "wind"})),
        (WIND | {"known_constants": ["drag"], "parameters": []}, (3, 3, set())),
        (TWO_TANKS, (4, 4, set())),
        (TWO_TANKS | {"outputs": {"y": "a"}}, (2, 4, {"b", "k2"})),
        (SPRING | {"known_initial_values": {"x": "0", "v": "0"}}, (0, 3, {"k", "m", "d"})),
    ],
)
def test_rank_dimension_and_names_are_the_known_ones(
    document: dict[str, Any], expected: tuple[int, int, set[str]]
) -> None:
    assert _lost(model_of_text(document)) == expected


def test_a_power_of_a_given_initial_value_is_exact() -> None:
    document = GROWTH | {"known_initial_values": {"n": "0.37"}, "parameters": ["rate", "exponent", "a"]}
    document["equations"] = {"n": "rate*n**exponent + a*n"}
    assert _lost(model_of_text(document)) == (3, 3, set())


def test_expressions_and_functions_of_casadi_give_what_text_gives() -> None:
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p", 3)
    f, h = ca.vertcat(x[1], -(p[0] * x[0] + p[2] * x[1]) / p[1]), x[0]
    expected = (4, 5, {"p_0", "p_1", "p_2"})
    assert _lost(model_of_expressions(f, h, x, p)) == expected
    functions = ca.Function("f", [x, p], [f]), ca.Function("h", [x], [h])
    assert _lost(model_of_expressions(*functions, x, p)) == expected


def test_a_branch_is_taken_where_the_point_lies() -> None:
    document = {
        "states": ["x"],
        "parameters": ["a", "b"],
        "point": {"x": "-2"},
        "equations": {"x": "a*max(x, 0) + b*min(x, 0)"},
        "outputs": {"y": "x"},
    }
    assert _lost(model_of_text(document)) == (2, 3, {"a"})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"equations": {"x": "v"}}, "the state 'v' has no equation"),
        ({"equations": SPRING["equations"] | {"z": "1"}}, "the equation of 'z' is of no state"),
        ({"equations": SPRING["equations"] | {"v": "-w*x"}}, "'w' is unknown"),
        ({"equations": SPRING["equations"] | {"v": "-(k*x"}}, "a parenthesis is not closed"),
        ({"equations": SPRING["equations"] | {"v": "k*x/0"}}, "divided by 0"),
        (
            {"equations": SPRING["equations"] | {"v": "__import__(x)"}},
            "the function '__import__' is unknown",
        ),
        ({"equations": SPRING["equations"] | {"v": "k.real"}}, "'.' has no meaning here"),
        ({"equations": SPRING["equations"] | {"v": "atan2(x)"}}, "atan2 takes 2 arguments, got 1"),
        ({"equations": SPRING["equations"] | {"v": "(" * 5000 + "x"}}, "more than 100 parentheses"),
        ({"equations": SPRING["equations"] | {"v": "x^" * 5000 + "x"}}, "more than 100 powers"),
        ({"equations": SPRING["equations"] | {"v": "x+" * 20_000 + "x"}}, "give at most 20000"),
        ({"equations": SPRING["equations"] | {"v": "1e999999999*x"}}, "the number 1e999999999 is too long"),
        ({"outputs": {}}, "nothing is measured"),
        ({"parameters": ["k", "m", "d", "x"]}, "'x' is declared twice"),
        ({"parameters": ["k", "m", "sin"]}, "'sin' is no name"),
        ({"parameters": "kmd"}, "give a list of names"),
        ({"point": {"q": 1}}, "the point names 'q'"),
        ({"point": {"x": "1/0"}}, "which is no number"),
        ({"known_initial_values": {"k": "1"}}, "is of no state"),
        ({"equation": {}}, "'equation' is unknown"),
    ],
)
def test_what_is_wrong_in_a_model_is_one_line_with_its_name(change: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as error:
        model_of_text(SPRING | change)
    assert words in str(error.value)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 400


def test_a_division_by_zero_at_the_point_is_said() -> None:
    document = SPRING | {"point": {"m": 0}}
    with pytest.raises(InputError, match="division by 0"):
        exact_rank(reached(model_of_text(document)))


def test_a_symbol_without_a_role_is_named() -> None:
    x, p = ca.SX.sym("x"), ca.SX.sym("p")
    with pytest.raises(InputError, match="'p' is in f or h but has no role"):
        model_of_expressions(-p * x, x, x)


def test_a_model_whose_derivatives_take_too_long_is_refused_with_the_cure(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(model_rank, "LARGEST_WORK", 1e4)
    names = [f"x{k}" for k in range(20)]
    document = {
        "states": names,
        "equations": {name: f"{names[k - 1]}*{names[k - 7]}" for k, name in enumerate(names)},
        "outputs": {"y": "x0"},
    }
    with pytest.raises(InputError, match="by 20 unknowns take too long; measure more states"):
        analyse(document)
