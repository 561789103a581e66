"""Generators in closed form of systems whose symmetries are known."""

from typing import Any

import pytest

from observability import analyse

CASES: dict[str, tuple[dict[str, Any], list[dict[str, str]], str]] = {
    "Euler's equations leave the scale of the moments": (
        {
            "states": ["w1", "w2", "w3"],
            "parameters": ["J1", "J2", "J3"],
            "equations": {
                "w1": "(J2 - J3)*w2*w3/J1",
                "w2": "(J3 - J1)*w3*w1/J2",
                "w3": "(J1 - J2)*w1*w2/J3",
            },
            "outputs": {"y1": "w1", "y2": "w2", "y3": "w3"},
        },
        [{"J1": "J1", "J2": "J2", "J3": "J3"}],
        "scaling",
    ),
    "a difference leaves a common shift": (
        {
            "states": ["a", "b"],
            "equations": {"a": "sin(b - a)", "b": "cos(a - b)"},
            "outputs": {"y": "a - b"},
        },
        [{"a": "1", "b": "1"}],
        "translation",
    ),
    "a distance leaves a rotation": (
        {
            "states": ["x", "y", "u", "v"],
            "equations": {"x": "u", "y": "v", "u": "-x", "v": "-y"},
            "outputs": {"d": "x**2 + y**2", "s": "x*u + y*v", "t": "u**2 + v**2"},
        },
        [{"x": "y", "y": "-x", "u": "v", "v": "-u"}],
        "affine",
    ),
    "a gain times a power is one number": (
        {
            "states": ["x"],
            "parameters": ["a", "n", "k"],
            "equations": {"x": "-a*(x/k)**n"},
            "outputs": {"y": "x"},
        },
        [{"a": "a*n", "k": "k"}],
        "polynomial",
    ),
    "what is seen through an unknown force leaves the mass": (
        {
            "states": ["x", "v"],
            "parameters": ["m"],
            "unknown_inputs": ["F"],
            "equations": {"x": "v", "v": "F/m"},
            "outputs": {"y": "x"},
        },
        [{"m": "m"}],
        "scaling",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_generators_are_the_known_ones(name: str) -> None:
    document, components, kind = CASES[name]
    found = analyse(document)
    assert found.certified
    assert [each.components for each in found.generators] == components
    assert {each.kind for each in found.generators} == ({kind} if kind else set())


def test_a_direction_without_a_closed_form_is_said_to_be_one() -> None:
    found = analyse(
        {
            "states": ["x"],
            "parameters": ["a", "b"],
            "equations": {"x": "-(a + exp(b))*x"},
            "outputs": {"y": "x"},
        }
    )
    assert "1 direction without a closed form." in str(found)


def test_an_unknown_input_is_certified_by_its_generators() -> None:
    found = analyse(CASES["what is seen through an unknown force leaves the mass"][0])
    assert found.proof.name == "GENERATORS"
    assert found.null_dimension == 1


def test_a_quadratic_generator_is_found() -> None:
    document = {
        "states": ["x"],
        "parameters": ["k", "s", "t"],
        "equations": {"x": "-k*x**2"},
        "outputs": {"y": "s*x/(t*x + 1)"},
    }
    found = analyse(document)
    assert found.null_dimension == len(found.generators) == 2
    assert [each.kind for each in found.generators] == ["scaling", "polynomial"]
