"""Models in discrete time, with known courses and of several experiments have the rank that elimination by hand gives."""

from typing import Any

import numpy as np
import pytest

from observability import analyse, bound
from spinfilters.core.errors import InputError

STEP: dict[str, Any] = {
    "time": "discrete",
    "states": ["x", "v"],
    "parameters": ["a", "b"],
    "equations": {"x": "x + v", "v": "v - a*b*x"},
    "outputs": {"y": "x"},
}
PUSHED: dict[str, Any] = {
    "states": ["x", "v"],
    "parameters": ["k", "m"],
    "inputs": ["F"],
    "equations": {"x": "v", "v": "(F - k*x)/m"},
    "outputs": {"y": "x"},
}


def test_steps_show_what_derivatives_show() -> None:
    found = analyse(STEP)
    assert (found.rank, found.dimension) == (3, 4)
    assert found.unobservable == ("a", "b")
    assert found.certified
    assert "reached by step 2" in str(found)
    assert "the first step that adds nothing is the last" in str(found)


def test_a_pause_of_a_step_that_forgets_certifies_nothing() -> None:
    forgets = STEP | {"states": ["x"], "equations": {"x": "a*b"}}
    found = analyse(forgets)
    assert found.rank == 2
    assert not found.certified
    assert "in discrete time" in str(found)


def test_functions_and_inputs_have_exact_values_at_every_step() -> None:
    turn = {
        "time": "discrete",
        "states": ["angle", "rate"],
        "inputs": ["u"],
        "parameters": ["g"],
        "equations": {"angle": "angle + rate", "rate": "rate + g*u"},
        "outputs": {"c": "cos(angle)", "s": "sin(angle)"},
    }
    assert analyse(turn).unobservable == ()


def test_outputs_at_different_rates_meet_before_the_rank_is_certain() -> None:
    slow = STEP | {"parameters": ["a"], "equations": {"x": "x + v", "v": "v - a*x"}, "every": {"y": 3}}
    found = analyse(slow)
    assert found.rank == 3
    # Every second sample of an alternating state: the sign never shows, whatever comes.
    flip = {
        "time": "discrete",
        "states": ["x"],
        "parameters": ["c"],
        "equations": {"x": "c - x"},
        "outputs": {"y": "x"},
    }
    assert analyse(flip).rank == 2
    seldom = analyse(flip | {"every": {"y": 2}})
    assert (seldom.rank, seldom.unobservable, seldom.certified) == (1, ("c",), True)


def test_an_unknown_input_of_every_step_is_found_or_not() -> None:
    pushed = {
        "time": "discrete",
        "states": ["x"],
        "unknown_inputs": ["w"],
        "equations": {"x": "x + w"},
        "outputs": {"y": "x"},
    }
    assert analyse(pushed).unobservable == ()
    hidden = pushed | {"parameters": ["a"], "equations": {"x": "a*x + w"}}
    assert analyse(hidden).unobservable == ("a", "w")


def test_a_known_course_is_less_than_a_generic_input() -> None:
    assert analyse(PUSHED).unobservable == ()
    at_rest = analyse(PUSHED | {"courses": {"F": 0}})
    assert at_rest.unobservable == ("k", "m")
    assert at_rest.certified
    waving = analyse(PUSHED | {"courses": {"F": "sin(2*t)"}})
    assert waving.unobservable == ()
    assert waving.observable["t"]
    assert analyse(PUSHED | {"courses": {"F": "from flight.csv"}}).dimension == 4


def test_two_experiments_determine_what_one_does_not() -> None:
    mixture = {
        "states": ["x"],
        "parameters": ["a", "b"],
        "known_constants": ["c"],
        "inputs": ["u"],
        "equations": {"x": "-(a + b*u)*x"},
        "outputs": {"y": "c*x"},
    }
    one = analyse(mixture | {"courses": {"u": 1}})
    assert one.unobservable == ("a", "b")
    both = analyse(mixture | {"experiments": {"low": {"courses": {"u": 0}}, "high": {"courses": {"u": 1}}}})
    assert both.unobservable == ()
    assert "x_low" in both.observable


def test_the_bound_of_discrete_steps_is_their_kalman_filter() -> None:
    plain = {
        "time": "discrete",
        "states": ["x", "v"],
        "equations": {"x": "x + v", "v": "0.9*v"},
        "outputs": {"y": "x"},
    }
    found = bound(plain, {"x": 0, "v": 1}, {"y": 0.5}, range(20), {"x": 2, "v": 1}, {"v": 0.04})
    step, row, covariance = np.array([[1, 1], [0, 0.9]]), np.array([[1.0, 0.0]]), np.diag([4.0, 1.0])
    for k in range(20):
        if k:
            covariance = step @ covariance @ step.T + np.diag([0, 0.04])
        gain = covariance @ row.T / (row @ covariance @ row.T + 0.25)
        covariance = covariance - gain @ row @ covariance
    np.testing.assert_allclose(found.covariances[-1], covariance, rtol=1e-9)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"time": "sometimes"}, "time is 'sometimes'"),
        ({"every": {"z": 2}}, "every names 'z', which is no output"),
        ({"every": {"y": 0}}, "every of y is 0"),
        ({"every": {"y": 2.5}}, "give a whole number"),
        ({"equations": {"x": "abs(x)", "v": "v"}}, "abs, min and max in discrete time"),
        ({"experiments": {}}, "give a table by the name of each experiment"),
        ({"experiments": {"a b": {}}}, "is no name"),
        ({"experiments": {"a": {"outputs": {}}}}, "'outputs' is unknown"),
        ({"courses": {"u": 1}}, "courses names 'u', which is no input"),
    ],
)
def test_what_is_wrong_is_named(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        analyse(STEP | changes)


def test_the_answer_says_that_generators_are_of_continuous_time() -> None:
    model = {
        "states": ["x"],
        "parameters": ["a", "b"],
        "equations": {"x": "a*b*x"},
        "outputs": {"y": "x"},
        "time": "discrete",
    }
    text = str(analyse(model))
    assert (
        "1 direction, shown by the unknowns that move: generators and null vectors are not computed" in text
    )
    assert "no generator was found" not in text
