"""An exact rank is certified only where ranks at real points agree with it."""

from typing import Any

import casadi as ca
import pytest

from observability import analyse
from observability.real_rank import RealRank

UNKNOWN = "acos(a) + asin(a) - pi/2"
"""0, by a theorem that the exact arithmetic does not know."""


def model(output: str, known: tuple[str, ...] = (), equation: str = "-k*x") -> dict[str, Any]:
    """A decay seen through an output."""
    return {
        "states": ["x"],
        "parameters": ["k"],
        "known_constants": list(known),
        "equations": {"x": equation},
        "outputs": {"y": output},
    }


@pytest.mark.parametrize(
    "factor",
    [
        "sin(4*atan(1))",
        "cos(4*atan(1)/3) - 0.5",
        "exp(1) - exp(1/2)**2",
        "exp(2*log(3)) - 9",
        "sqrt(2)*sqrt(3) - sqrt(6)",
        "4*atan(1/5) - atan(1/239) - atan(1)",
        "0.1 + 0.2 - 0.3",
        "0.1*3 - 0.3",
        "sin(pi)",
        "cos(pi/3) - 1/2",
        "tan(pi/4) - 1",
        "pi - 4*atan(1)",
    ],
)
def test_a_constant_that_is_zero_determines_nothing(factor: str) -> None:
    assert analyse(model(f"({factor})*x")).rank == 0


@pytest.mark.parametrize("factor", ["exp(-40)", "1e-20", "1e-20 + 1e-21", "sin(1e-20)", "pi - 3.14159"])
def test_a_small_constant_is_not_taken_for_zero(factor: str) -> None:
    found = analyse(model(f"({factor})*x"))
    assert (found.rank, found.certified) == (2, True)


@pytest.mark.parametrize(
    ("factor", "names"),
    [
        ("log(a) + log(b) - log(a*b)", ("a", "b")),
        ("log(a**2) - 2*log(a)", ("a",)),
        ("acos(a) + asin(a) - 2*atan(1)", ("a",)),
        ("atan2(a, b) + atan2(b, a) - 2*atan(1)", ("a", "b")),
        ("cos(a) + cos(a - 8*atan(1)/3) + cos(a + 8*atan(1)/3)", ("a",)),
        ("cos(a + 2*pi) - cos(a)", ("a",)),
    ],
)
def test_a_relation_that_residues_do_not_know_is_never_certified(factor: str, names: tuple[str, ...]) -> None:
    found = analyse(model(f"({factor})*x", names))
    assert found.rank == 0 or (not found.certified and found.real_rank is RealRank.LOWER)


@pytest.mark.parametrize(
    "factor", ["sin(a)", "log(a)", "acos(a)", "atan2(a, b)", "exp(pi*a)", "a**b", "sqrt(a) + b"]
)
def test_functions_without_such_a_relation_are_certified(factor: str) -> None:
    found = analyse(model(f"({factor})*x", ("a", "b")))
    assert (found.rank, found.certified) == (2, True)


def test_a_branch_of_an_inverse_function_is_not_certified_for_all() -> None:
    found = analyse(model("asin(sin(x)) - x"))
    assert not found.certified
    assert "one branch" in str(found)


def test_equations_that_are_nowhere_real_are_told() -> None:
    found = analyse(
        {
            "states": ["x"],
            "parameters": ["a"],
            "equations": {"x": "sqrt(-1 - x**2)*a"},
            "outputs": {"y": "x"},
        }
    )
    assert not found.certified
    assert "no point was found at which all roots and logarithms are real" in str(found)


def test_numbers_that_casadi_computed_are_read_as_the_fractions_they_stand_for() -> None:
    x, k = ca.SX.sym("x"), ca.SX.sym("k")
    found = analyse(-k * x, (0.1 * x) * 3 - 0.3 * x, x, parameters=k)
    assert found.rank == 0


def test_a_rounding_error_that_casadi_computed_is_not_certified() -> None:
    x, k = ca.SX.sym("x"), ca.SX.sym("k")
    found = analyse(-k * x, (0.1 + 0.2 - 0.3) * x + 0 * ca.sin(k), x, parameters=k)
    assert not found.certified


@pytest.mark.parametrize("level", [2, 3, 4, 9, "1/4", 0.3])
def test_a_root_at_a_given_value_is_analysed(level: float | str) -> None:
    tank = {
        "states": ["h"],
        "parameters": ["k"],
        "equations": {"h": "-k*sqrt(h)"},
        "outputs": {"y": "h"},
        "point": {"h": level},
    }
    found = analyse(tank)
    assert (found.rank, found.certified) == (2, True)


@pytest.mark.parametrize(
    "factor",
    [
        "log(a) + log(b) - log(a*b)",
        "log(a/b) - log(a) + log(b)",
        "log(a**2) - 2*log(a)",
        "log(sqrt(a*b)) - log(a)/2 - log(b)/2",
        "log(exp(a)*exp(b)) - a - b",
        "log(a**b) - b*log(a)",
        "log(6*a) - log(2*a) - log(3)",
        "log(4*a) - 2*log(2*a) + log(a)",
        "log(a/3) - log(a) + log(3)",
        "log(a)/log(10) - log(a**2)/log(100)",
        "(2*a)**b*log(2*a) - 2**b*a**b*(log(2) + log(a))",
        "sin(a + pi/2) - cos(a)",
        "sin(pi - a) - sin(a)",
        "cos(a - 2*pi) - cos(a)",
        "tan(a + pi) - tan(a)",
        "cos(a - 3*pi/2) + sin(a)",
        "cos(a + pi/3) + cos(a - pi/3) - cos(a)",
        "sin(a + pi/6) - sin(a)*sqrt(3)/2 - cos(a)/2",
        "sin(a + pi/4) - (sin(a) + cos(a))*sqrt(2)/2",
        "sin(5*pi/6 - a) - sin(a + pi/6)",
        "cos(a + pi/12) - cos(a + pi/3)*sqrt(2)/2 - sin(a + pi/3)*sqrt(2)/2",
        "tan(a + pi/4) - (1 + tan(a))/(1 - tan(a))",
        "cos(a + (b + pi/4))*sqrt(2) - cos(a + b) + sin(a + b)",
        "cos(2*(a + pi/6)) - (cos(2*a) - sqrt(3)*sin(2*a))/2",
        "sin(3*(pi/4 - a)) - (sin(3*a) + cos(3*a))/sqrt(2)",
        "cos(a - b + pi/12) - cos(a - b)*cos(pi/12) + sin(a - b)*sin(pi/12)",
        "a*(sqrt(2) + sqrt(3)) - a*sqrt(2) - a*sqrt(3)",
        "exp(a*(1 + sqrt(2))) - exp(a)*exp(a*sqrt(2))",
        "cos((1 + sqrt(2))*a) - cos(a)*cos(sqrt(2)*a) + sin(a)*sin(sqrt(2)*a)",
    ],
)
def test_sums_of_logarithms_and_turns_by_parts_of_pi_are_decided(factor: str) -> None:
    found = analyse(model(f"({factor})*x", ("a", "b")))
    assert (found.rank, found.certified) == (0, True)


@pytest.mark.parametrize(
    "factor",
    [
        "log((a - 1)*(b - 2))",
        "log(-a*b)",
        "log(2*a)",
        "log(-2*a)",
        "log(6*a) - log(2*a) - log(5)",
        "log(2*a) - log(a) - 0.6931",
        "sin(a + 1.5707963)",
        "sin(a + pi/6) - 0.866*sin(a) - cos(a)/2",
        "sin(a + pi/4)*sqrt(a + b)",
        "cos(2*(a + pi/6)) - (cos(2*a) + sqrt(3)*sin(2*a))/2",
        "exp(a*(1 + sqrt(2))) - exp(a)*exp(a*sqrt(3))",
        "a*(sqrt(2) + sqrt(3)) - 3.1462643*a",
    ],
)
def test_what_is_not_zero_stays_certified(factor: str) -> None:
    found = analyse(model(f"({factor})*x", ("a", "b")))
    assert (found.rank, found.certified) == (2, True)


@pytest.mark.parametrize(
    "factor",
    [
        "sqrt(a*(3 + 2*sqrt(2))) - sqrt(a)*(1 + sqrt(2))",
        "cos(a + pi/5) - cos(a)*cos(pi/5) + sin(a)*sin(pi/5)",
    ],
)
def test_relations_of_other_constants_are_left_open(factor: str) -> None:
    found = analyse(model(f"({factor})*x", ("a", "b")))
    assert not found.certified


def test_a_sum_that_shares_its_terms_is_searched_to_a_depth() -> None:
    angle, before = ca.SX.sym("a"), ca.SX.sym("b")
    x, a, b = ca.SX.sym("x"), angle, before
    for _ in range(60):
        before, angle = angle, angle + before
    found = analyse(-x, [x, ca.cos(angle + ca.pi / 4)], x, parameters=[a, b])
    assert found.rank == 2


@pytest.mark.parametrize("rate", ["-k*sqrt(2*x)", "-k*log(2*x)*sqrt(3*x)"])
def test_a_root_of_a_multiple_is_analysed(rate: str) -> None:
    found = analyse(model("x", equation=rate))
    assert (found.rank, found.certified) == (2, True)


def test_a_rank_that_is_too_high_is_called_an_upper_bound() -> None:
    found = analyse(model(f"({UNKNOWN})*x", ("a", "b")))
    assert "have at most rank 2" in str(found)
    assert "Observable at most: k, x." in str(found)


@pytest.mark.parametrize(("factor", "certified"), [("log(a)", True), (UNKNOWN, False)])
def test_steps_in_discrete_time_are_compared_as_well(factor: str, certified: bool) -> None:
    found = analyse(model(f"({factor})*x", ("a", "b"), "k*x") | {"time": "discrete"})
    assert (found.rank, found.certified) == (2, certified)
