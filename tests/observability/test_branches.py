"""An answer of equations with branches names the branch it holds on."""

import casadi as ca
import pytest

from observability import ModelAnalysis, analyse


def largest(**point: float) -> ModelAnalysis:
    """A decay with the larger of two rates."""
    return analyse(
        {
            "states": ["x"],
            "parameters": ["a", "b"],
            "equations": {"x": "-max(a, b)*x"},
            "outputs": {"y": "x"},
            "point": point,
        }
    )


@pytest.mark.parametrize(
    ("point", "condition", "hidden"), [({"a": 2, "b": 1}, "a > b", "b"), ({"a": 1, "b": 2}, "a < b", "a")]
)
def test_the_branch_at_the_point_is_named(point: dict[str, float], condition: str, hidden: str) -> None:
    found = largest(**point)
    assert found.branches == [condition]
    assert found.unobservable == (hidden,)
    assert f"All this holds where {condition};" in str(found)
    assert found.document()["holds_where"] == [condition]


def test_the_branch_at_a_generic_point_is_the_one_that_was_analysed() -> None:
    found = largest()
    assert (found.branches, found.unobservable) in [(["a > b"], ("b",)), (["a < b"], ("a",))]


def test_equations_without_branches_name_none() -> None:
    x, k = ca.SX.sym("x"), ca.SX.sym("k")
    assert analyse(-k * x, x, x, parameters=k).branches == []


def test_a_comparison_and_an_absolute_value_are_named() -> None:
    x, k = ca.SX.sym("x"), ca.SX.sym("k")
    found = analyse(ca.if_else(x > k, -k * x, ca.fabs(x - 3)), x, x, parameters=k)
    assert "x - 3 < 0" in found.branches
    assert {"k < x", "k > x"} & set(found.branches)


def test_functions_are_compared_with_real_points_of_the_same_branch() -> None:
    found = analyse(
        {
            "states": ["x"],
            "parameters": ["a", "b"],
            "equations": {"x": "-x"},
            "outputs": {"y": "log(max(a, b))*x"},
        }
    )
    assert (found.rank, found.certified) == (1, True)
