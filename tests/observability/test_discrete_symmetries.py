"""Mirrored and exchanged unknowns are found as isolated other solutions, and nothing else is claimed."""

from typing import Any

from observability import analyse

EULER: dict[str, Any] = {
    "states": ["w1", "w2", "w3"],
    "parameters": ["J1", "J2", "J3"],
    "equations": {"w1": "(J2 - J3)*w2*w3/J1", "w2": "(J3 - J1)*w3*w1/J2", "w3": "(J1 - J2)*w1*w2/J3"},
}


def test_one_rate_of_three_leaves_mirrored_and_exchanged_axes() -> None:
    found = analyse(EULER | {"outputs": {"y": "w3"}}).other_solutions
    texts = [str(each) for each in found.found]
    assert found.complete
    assert texts[0] == "w1 -> -w1, w2 -> -w2"
    assert any("J1 -> J2, J2 -> J1" in each for each in texts)


def test_three_rates_leave_none() -> None:
    found = analyse(EULER | {"outputs": {"y1": "w1", "y2": "w2", "y3": "w3"}})
    assert found.other_solutions.found == ()
    assert "Local, except for mirrored and exchanged unknowns" in str(found)


def test_a_square_hides_a_sign_and_two_rates_their_order() -> None:
    squared = {"states": ["x"], "parameters": ["k"], "equations": {"x": "-k*x + 1"}, "outputs": {"y": "x"}}
    assert analyse(squared).other_solutions.found == ()
    hidden = analyse(squared | {"equations": {"x": "-k**2*x + 1"}})
    assert [str(each) for each in hidden.other_solutions.found] == ["k -> -k"]
    two = {
        "states": ["a", "b"],
        "parameters": ["k", "l"],
        "equations": {"a": "-k*a", "b": "-l*b"},
        "outputs": {"y": "a + b"},
    }
    assert [str(each) for each in analyse(two).other_solutions.found] == ["a -> b, b -> a, k -> l, l -> k"]


def test_a_scaling_by_minus_one_is_no_isolated_solution() -> None:
    gain = {"states": ["x"], "parameters": ["c"], "equations": {"x": "-x"}, "outputs": {"y": "c*x"}}
    assert analyse(gain).other_solutions.found == ()


def test_functions_that_cannot_be_tried_are_said_to_be_local_only() -> None:
    wave = {"states": ["x"], "parameters": ["k"], "equations": {"x": "sin(k*x)"}, "outputs": {"y": "x"}}
    assert "Local only: isolated other solutions are not looked for." in str(analyse(wave))


def test_a_map_within_a_family_of_solutions_is_no_isolated_solution() -> None:
    exchanged = analyse(
        {
            "states": ["x", "z"],
            "parameters": ["a"],
            "equations": {"x": "-a*x", "z": "-a*z"},
            "outputs": {"y": "x + z"},
        }
    )
    assert not exchanged.other_solutions.found
    assert "isolated:" not in str(exchanged)


def test_a_map_that_no_known_generator_reaches_is_not_called_isolated() -> None:
    turned = analyse(
        {
            "states": ["x", "y"],
            "parameters": ["k"],
            "equations": {"x": "-k*y", "y": "k*x"},
            "outputs": {"r": "x**2 + y**2"},
        }
    )
    assert [each.sentence for each in turned.other_solutions.found] == ["Another solution: x -> -x, k -> -k."]


def test_a_map_that_changes_what_all_generators_keep_is_isolated() -> None:
    product = analyse(
        {
            "states": ["x"],
            "parameters": ["a", "b"],
            "equations": {"x": "0"},
            "outputs": {"y": "(a*b)**2", "z": "x"},
        }
    )
    assert [each.sentence for each in product.other_solutions.found] == [
        "Another solution, isolated: a -> -a."
    ]
