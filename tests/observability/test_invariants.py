"""What is determined of unknowns that are not: invariants, and a minimal model with the same outputs."""

from typing import Any

import pytest

from observability import analyse

EULER = {
    "states": ["w1", "w2", "w3"],
    "parameters": ["J1", "J2", "J3"],
    "equations": {"w1": "(J2 - J3)*w2*w3/J1", "w2": "(J3 - J1)*w3*w1/J2", "w3": "(J1 - J2)*w1*w2/J3"},
    "outputs": {"y1": "w1", "y2": "w2", "y3": "w3"},
}
CASES: dict[str, tuple[dict[str, Any], list[str]]] = {
    "ratios of moments": (EULER, ["J2/J1", "J3/J1"]),
    "a spring": (
        {
            "states": ["x", "v"],
            "parameters": ["k", "m", "d"],
            "equations": {"x": "v", "v": "-(k*x + d*v)/m"},
            "outputs": {"y": "x"},
        },
        ["k/m", "d/m"],
    ),
    "differences": (
        {
            "states": ["a", "b", "c"],
            "equations": {"a": "sin(b - a)", "b": "sin(c - a)", "c": "1"},
            "outputs": {"y": "a - b", "z": "b - c"},
        },
        ["a - c", "b - c"],
    ),
    "products of rotated vectors": (
        {
            "states": ["x", "y", "u", "v"],
            "equations": {"x": "u", "y": "v", "u": "-x", "v": "-y"},
            "outputs": {"d": "x**2 + y**2", "s": "x*u + y*v", "t": "u**2 + v**2"},
        },
        ["x**2 + y**2", "v*x - u*y", "u*x + v*y"],
    ),
    "sums of rates": (
        {
            "states": ["x0", "x1"],
            "parameters": ["a01", "a21", "a12"],
            "equations": {"x0": "-(a01 + a21)*x0 + a12*x1", "x1": "a21*x0 - a12*x1"},
            "outputs": {"y": "x0"},
        },
        ["a01 + a21 + a12", "a01*a12", "a01*x0 + a21*x0 - a12*x1"],
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_invariants_are_the_known_ones(name: str) -> None:
    document, wanted = CASES[name]
    found = analyse(document).invariants
    assert found.complete
    assert [signless(str(each)) for each in found.found] == [signless(each) for each in wanted]


def signless(text: str) -> set[str]:
    """Terms of a sum, whose order and common sign are free."""
    return set(text.replace("- ", "+ ").split(" + "))


def test_invariants_that_are_no_polynomials_are_said_to_lack() -> None:
    document = {
        "states": ["x"],
        "parameters": ["a", "n", "k"],
        "equations": {"x": "-a*(x/k)**n"},
        "outputs": {"y": "x"},
    }
    assert not analyse(document).invariants.complete


def test_a_minimal_model_has_ratios_in_the_place_of_moments() -> None:
    found = analyse(EULER).reparametrisation
    assert found is not None
    assert found.fixed == {"J1": 1}
    assert found.definitions == {"J2": "J2/J1", "J3": "J3/J1"}
    assert found.equations["w2"] == "w1*w3*(J3 - 1)/J2"
    again = analyse({**EULER, "parameters": ["J2", "J3"], "equations": found.equations})
    assert again.unobservable == ()


def test_a_state_that_scales_brings_its_own_rate_into_the_minimal_model() -> None:
    document = {
        "states": ["x", "v"],
        "parameters": ["a"],
        "equations": {"x": "v", "v": "-a*x"},
        "outputs": {"y": "v/x"},
    }
    found = analyse(document).reparametrisation
    assert found is not None
    assert found.fixed == {"x": 1}
    assert found.definitions == {"v": "v/x"}
    assert found.equations == {"v": "-v**2 - a"}
    assert found.outputs == {"y": "v"}


def test_a_text_names_invariants_and_the_minimal_model() -> None:
    words = str(analyse(EULER))
    assert "Determined of them: J2/J1, J3/J1." in words
    assert "The outputs are the same with J1 = 1 and J2/J1 in the place of J2" in words


def test_an_invariant_of_some_directions_only_is_not_called_determined() -> None:
    # Only exp(x) + sin(a*b) is determined, which is no polynomial: a*b is not.
    hidden = analyse(
        {
            "states": [],
            "parameters": ["x", "a", "b"],
            "equations": {},
            "outputs": {"y": "exp(x) + sin(a*b)"},
        }
    )
    assert not hidden.invariants.found
    turned = analyse(
        {
            "states": ["x", "y"],
            "parameters": ["k"],
            "equations": {"x": "-k*y", "y": "k*x"},
            "outputs": {"r": "x**2 + y**2"},
        }
    )
    assert str(turned.invariants) == "x**2 + y**2"
    assert turned.invariants.complete
