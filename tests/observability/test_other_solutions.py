"""Other values of the unknowns with the same outputs are found, and none where there are none."""

import pytest

from observability import analyse

TWO_DECAYS = {
    "states": ["a", "b"],
    "parameters": ["p", "q"],
    "equations": {"a": "-p*a", "b": "-q*b"},
    "outputs": {"y": "a + b"},
}


def test_two_decays_can_be_exchanged() -> None:
    found = analyse(TWO_DECAYS).isolated_solutions
    (other,) = found.real
    point = found.point
    assert other == pytest.approx({"p": point["q"], "q": point["p"], "a": point["b"], "b": point["a"]})
    assert found.chance_missed < 0.01
    assert "the outputs are those of" in found.sentences[0]


def test_the_root_of_a_square_has_two_signs() -> None:
    found = analyse(
        {"states": ["x"], "parameters": ["k"], "equations": {"x": "-k**2*x"}, "outputs": {"y": "x"}}
    ).isolated_solutions
    assert found.ambiguous == ("k",)
    assert found.real[0]["k"] == pytest.approx(-found.point["k"])


def test_complex_solutions_are_counted_and_not_given_as_values() -> None:
    found = analyse(
        {"states": ["x"], "parameters": ["k"], "equations": {"x": "-k**3*x"}, "outputs": {"y": "x"}}
    ).isolated_solutions
    assert found.real == ()
    assert "2 further solutions are complex." in found.sentences


def test_a_model_of_one_solution_has_no_other() -> None:
    found = analyse(
        {"states": ["x"], "parameters": ["k"], "equations": {"x": "-k*x"}, "outputs": {"y": "x"}}
    ).isolated_solutions
    assert found.found == ()
    assert found.chance_missed < 0.01


def test_what_is_not_observable_is_searched_in_the_smallest_model() -> None:
    found = analyse(
        {"states": ["x"], "parameters": ["k", "m"], "equations": {"x": "-k**2*x/m**2"}, "outputs": {"y": "x"}}
    ).isolated_solutions
    assert found.ambiguous in (("k",), ("m",))


def test_what_is_no_quotient_is_not_searched() -> None:
    document = {"states": ["x"], "parameters": ["k"], "equations": {"x": "-exp(k)*x"}, "outputs": {"y": "x"}}
    found = analyse(document).isolated_solutions
    assert found.sentences == ["Local only: other isolated solutions were not searched for."]
