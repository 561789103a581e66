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
    assert found.generators == components
    assert {each.kind for each in found.symmetries} == ({kind} if kind else set())


RATIONAL = {
    "two compartments": (
        {
            "states": ["x0", "x1"],
            "parameters": ["a01", "a21", "a12"],
            "equations": {"x0": "-(a01 + a21)*x0 + a12*x1", "x1": "a21*x0 - a12*x1"},
            "outputs": {"y": "x0"},
        },
        {"a01": "a01", "a21": "-a01 + a12", "a12": "-a12", "x1": "x0 + x1"},
    ),
    "a sum of two states that decay alike": (
        {
            "states": ["a", "b", "r", "s"],
            "parameters": ["k", "m"],
            "equations": {"a": "k*r - s*a", "b": "m*r - s*b", "r": "1 - r*s", "s": "r - s**2"},
            "outputs": {"y": "a + b", "y1": "r", "y2": "s", "y3": "k", "y4": "m"},
        },
        {"a": "-a*m + b*k", "b": "a*m - b*k"},
    ),
}


@pytest.mark.parametrize("name", RATIONAL)
def test_a_generator_is_interpolated_from_null_vectors(name: str) -> None:
    document, components = RATIONAL[name]
    found = analyse(document)
    assert found.null_dimension == len(found.generators) == 1
    own = found.generators[0]
    turned = {key: signed_terms(value) for key, value in own.items()}
    wanted = {key: signed_terms(value) for key, value in components.items()}
    assert turned in (wanted, {key: {(-a, b) for a, b in value} for key, value in wanted.items()})


def signed_terms(text: str) -> set[tuple[int, tuple[str, ...]]]:
    """Terms of a sum with their signs, in any order."""
    parts = text.replace("- ", "+ -").split(" + ")
    return {
        (-1 if part.startswith("-") else 1, tuple(sorted(part.lstrip("+- ").split("*")))) for part in parts
    }


def test_known_initial_values_keep_the_generators_that_keep_them() -> None:
    document = {
        "states": ["x1", "x2"],
        "parameters": ["t1", "t2", "t3", "t4"],
        "inputs": ["u"],
        "equations": {"x1": "t1*x1**2 + t2*x1*x2 + u", "x2": "t3*x1**2 + t4*x1*x2"},
        "outputs": {"y": "x1"},
    }
    found = analyse(document | {"known_initial_values": {"x1": 0, "x2": 0}})
    assert found.certified
    assert found.generators == [{"t2": "t2", "t3": "-t3", "x2": "-x2"}]
    known = analyse(document | {"known_initial_values": {"x1": 0, "x2": 1}})
    assert known.null_dimension == 0


def test_an_unknown_input_that_compensates_is_certified_by_inversion() -> None:
    document = {
        "states": ["x", "z"],
        "parameters": ["a", "b"],
        "unknown_inputs": ["w"],
        "equations": {"x": "a*x + b*z + w", "z": "x - a*z"},
        "outputs": {"y": "x"},
    }
    found = analyse(document)
    assert found.rank == 2
    assert found.proof.name in ("INVERSION", "GENERATORS")
    assert found.inverted is not None
    assert found.inverted.compensated == ("a", "b", "z")


def test_a_bearing_with_an_unknown_acceleration_leaves_three_directions() -> None:
    document = {
        "states": ["rx", "ry", "vx", "vy"],
        "unknown_inputs": ["ax", "ay"],
        "equations": {"rx": "vx", "ry": "vy", "vx": "ax", "vy": "ay"},
        "outputs": {"y": "rx/ry"},
    }
    found = analyse(document)
    assert found.rank == 3
    assert len(found.generators) == 3


def test_a_special_point_on_an_invariant_manifold_is_certified_without_generators() -> None:
    document = {"states": ["x", "v"], "parameters": ["k"], "equations": {"x": "v", "v": "-k*x"}}
    found = analyse(document | {"outputs": {"y": "x**2"}}, at={"x": 0, "v": 0})
    assert found.proof.name == "MANIFOLD"
    assert found.rank == 0


def test_a_direction_without_a_closed_form_is_said_to_be_one() -> None:
    found = analyse(
        {
            "states": ["x"],
            "parameters": ["a", "b"],
            "equations": {"x": "-(a + exp(b))*x"},
            "outputs": {"y": "x"},
        }
    )
    assert "1 direction for which no generator was found up to degree 2." in str(found)


def test_an_unknown_input_is_certified_and_has_its_generator() -> None:
    found = analyse(CASES["what is seen through an unknown force leaves the mass"][0])
    assert found.proof.name == "INVERSION"
    assert found.null_dimension == len(found.generators) == 1


def test_a_quadratic_generator_is_found() -> None:
    document = {
        "states": ["x"],
        "parameters": ["k", "s", "t"],
        "equations": {"x": "-k*x**2"},
        "outputs": {"y": "s*x/(t*x + 1)"},
    }
    found = analyse(document)
    assert found.null_dimension == len(found.generators) == 2
    assert [each.kind for each in found.symmetries] == ["scaling", "polynomial"]


LONG_CONSTANTS: dict[str, tuple[dict[str, Any], str]] = {
    "a compass with a declination in degrees": (
        {
            "states": ["psi"],
            "parameters": ["declination"],
            "inputs": ["w"],
            "equations": {"psi": "w"},
            "outputs": {"compass": "psi + 0.0174532925*declination"},
        },
        "declination -> declination + 400000000 ε, psi -> psi - 6981317 ε",
    ),
    "two accelerations": (
        {
            "states": ["x", "v"],
            "parameters": ["a", "b"],
            "equations": {"x": "v", "v": "-9.80665*a - 1.234567e-5*b"},
            "outputs": {"y": "x"},
        },
        "a -> a + 1234567 ε, b -> b - 980665000000 ε",
    ),
    "a constant of fifteen digits": (
        {
            "states": ["x"],
            "parameters": ["a"],
            "equations": {"x": "1"},
            "outputs": {"y": "3.14159265358979*x + a"},
        },
        "a -> a + 314159265358979 ε, x -> x - 100000000000000 ε",
    ),
    "a bias beside a tilt": (
        {
            "states": ["v"],
            "parameters": ["b", "s"],
            "inputs": ["f"],
            "equations": {"v": "f - b - 9.80665*s"},
            "outputs": {"y": "v"},
        },
        "b -> b + 196133 ε, s -> s - 20000 ε",
    ),
    "known initial values": (
        {
            "states": ["x", "z"],
            "parameters": ["a", "b", "c"],
            "equations": {"x": "z", "z": "-1.234567*x"},
            "outputs": {"y": "x + a"},
            "known_initial_values": {"x": "9.87654321*b + 1.234567*c"},
        },
        "b -> b - 123456700/987654321 ε, c -> c + ε",
    ),
}


@pytest.mark.parametrize("name", LONG_CONSTANTS)
def test_constants_of_many_digits_come_back_in_generators(name: str) -> None:
    document, expected = LONG_CONSTANTS[name]
    (generator,) = analyse(document).symmetries
    assert str(generator) == expected


def test_a_coefficient_that_is_no_fraction_is_in_no_generator() -> None:
    # What leaves the output alone is a -> a + e ε, b -> b - ε with e = exp(1).
    document = {
        "states": [],
        "parameters": ["a", "b"],
        "inputs": ["u"],
        "equations": {},
        "outputs": {"y": "exp(u)*a + exp(u + 1)*b"},
    }
    found = analyse(document)
    assert found.null_dimension == 1
    assert not found.symmetries


def test_a_rounded_root_is_not_taken_for_a_fraction_of_a_generator() -> None:
    document = {
        "states": ["x"],
        "parameters": ["a", "b"],
        "equations": {"x": "1"},
        "outputs": {"y": "x/sqrt(3) + a*b"},
    }
    found = analyse(document)
    assert [str(each) for each in found.symmetries] == ["a -> e^ε a, b -> e^-ε b"]
    assert "1 direction for which no generator was found up to degree 2." in str(found)


@pytest.mark.parametrize(
    "rate", ["a*b*cos(x + pi/4)", "a*b*cos(x + pi/6) + x*sqrt(3)", "a*b*exp(x*sqrt(2))", "a*b*sqrt(2*x)"]
)
def test_generators_are_found_where_numbers_have_roots(rate: str) -> None:
    found = analyse(
        {"states": ["x"], "parameters": ["a", "b"], "equations": {"x": rate}, "outputs": {"y": "x"}}
    )
    assert [str(each) for each in found.symmetries] == ["a -> e^ε a, b -> e^-ε b"]


def test_a_rotation_about_a_known_field_is_found_for_a_spinning_magnetometer() -> None:
    """Most equations of a point are empty here: a field of the attitude moves no rate of the body."""
    attitude = ("x", "y", "z", "w")
    found = analyse(
        {
            "states": [*attitude, "w1", "w2", "w3"],
            "parameters": ["J1", "J2", "J3", "b1", "b2", "b3"],
            "known_constants": ["B1", "B2", "B3"],
            "unit_vectors": [[*attitude]],
            "equations": {
                "x": "(w*w1 - z*w2 + y*w3)/2",
                "y": "(z*w1 + w*w2 - x*w3)/2",
                "z": "(-y*w1 + x*w2 + w*w3)/2",
                "w": "-(x*w1 + y*w2 + z*w3)/2",
                "w1": "(J2 - J3)*w2*w3/J1",
                "w2": "(J3 - J1)*w3*w1/J2",
                "w3": "(J1 - J2)*w1*w2/J3",
            },
            "outputs": {
                "m1": "(1 - 2*(y**2 + z**2))*B1 + 2*(x*y + z*w)*B2 + 2*(x*z - y*w)*B3 + b1",
                "m2": "2*(x*y - z*w)*B1 + (1 - 2*(x**2 + z**2))*B2 + 2*(y*z + x*w)*B3 + b2",
                "m3": "2*(x*z + y*w)*B1 + 2*(y*z - x*w)*B2 + (1 - 2*(x**2 + y**2))*B3 + b3",
            },
        }
    )
    assert (found.rank, found.dimension) == (10, 12)
    turns = [each for each in found.generators if set(each) == set(attitude)]
    assert turns == [
        {
            "x": "B1*w + B2*z - B3*y",
            "y": "-B1*z + B2*w + B3*x",
            "z": "B1*y - B2*x + B3*w",
            "w": "-B1*x - B2*y - B3*z",
        }
    ]
