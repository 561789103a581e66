"""The bound of any system equals a Kalman filter's covariance, Monte Carlo runs and the empirical Gramian."""

from typing import Any

import numpy as np
import pytest

from observability import bound, empirical_information, gain_table
from spinfilters.core.errors import InputError

SPRING: dict[str, Any] = {
    "states": ["x", "v"],
    "equations": {"x": "v", "v": "-4*x - 0.5*v"},
    "outputs": {"y": "x", "s": "v"},
}
DECAY: dict[str, Any] = {
    "states": ["x"],
    "parameters": ["k"],
    "equations": {"x": "-k*x"},
    "outputs": {"y": "x"},
}
TIMES = np.linspace(0, 3, 31)


def test_the_bound_of_a_linear_system_is_the_covariance_of_its_kalman_filter() -> None:
    found = bound(
        SPRING, {"x": 1, "v": 0}, {"y": 0.1}, TIMES, priors={"x": 2.0, "v": 3.0}, process_noise={"v": 0.3}
    )
    slope, step = np.array([[0, 1], [-4, -0.5]]), 1e-4
    covariance, row = np.diag([4.0, 9.0]), np.array([[1.0, 0.0]])
    for k in range(len(TIMES)):
        if k:
            for _ in range(round((TIMES[1] - TIMES[0]) / step)):
                covariance = covariance + step * (
                    slope @ covariance + covariance @ slope.T + np.diag([0, 0.3])
                )
        gain = covariance @ row.T / (row @ covariance @ row.T + 0.01)
        covariance = covariance - gain @ row @ covariance
    np.testing.assert_allclose(found.covariances[-1], covariance, rtol=3e-3)


def test_2000_least_squares_fits_of_a_nonlinear_system_scatter_as_the_bound_says() -> None:
    generator = np.random.default_rng(7)
    measured = 2 * np.exp(-0.7 * TIMES) + 0.02 * generator.standard_normal((2000, len(TIMES)))
    x, k = np.full(2000, 2.0), np.full(2000, 0.7)
    for _ in range(8):
        model = x[:, None] * np.exp(-k[:, None] * TIMES)
        slopes = np.stack([model / x[:, None], -TIMES * model], axis=2)
        normal = slopes.transpose(0, 2, 1) @ slopes
        step = np.linalg.solve(normal, slopes.transpose(0, 2, 1) @ (measured - model)[..., None])[..., 0]
        x, k = x + step[:, 0], k + step[:, 1]
    found = bound(DECAY, {"x": 2, "k": 0.7}, {"y": 0.02}, TIMES)
    last = x * np.exp(-k * TIMES[-1])
    assert np.std(k) == pytest.approx(found.final["k"], rel=0.03)
    assert np.std(last) == pytest.approx(found.final["x"], rel=0.03)


def test_the_empirical_gramian_is_the_information_about_the_start() -> None:
    found = bound(DECAY, {"x": 2, "k": 0.7}, {"y": 0.02}, TIMES)
    start = empirical_information(found)
    np.testing.assert_allclose(start, found.roots[-1].T @ found.roots[-1], rtol=1e-5)


def test_states_that_die_out_do_not_hide_parameters() -> None:
    motor = {
        "states": ["i", "w"],
        "parameters": ["K", "b"],
        "inputs": ["u"],
        "equations": {"i": "(u - i - K*w)/0.005", "w": "(K*i - b*w)/1e-4"},
        "outputs": {"speed": "w"},
    }
    values = {"i": 0, "w": 0, "K": 0.05, "b": 1e-4}
    found = bound(
        motor, values, {"speed": 0.5}, np.linspace(0, 2, 401), inputs={"u": lambda t: 12 + 4 * np.sin(20 * t)}
    )
    assert found.prior_only == []
    assert found.final["K"] < 1e-3 < 0.05
    assert found.final["b"] < 1e-5


def test_a_direction_that_only_a_prior_holds_is_named() -> None:
    document = {
        "states": ["x"],
        "parameters": ["a", "b"],
        "equations": {"x": "a + b"},
        "outputs": {"y": "x"},
    }
    found = bound(document, {"x": 0, "a": 1, "b": 1}, {"y": 0.01}, TIMES, priors={"a": 1, "b": 1})
    (direction,) = found.prior_only
    assert direction["a"] == pytest.approx(-direction["b"], rel=1e-3)
    free = bound(document, {"x": 0, "a": 1, "b": 1}, {"y": 0.01}, TIMES)
    assert np.isinf(free.final["a"])
    assert free.final["x"] < 0.01
    assert "a                    not determined" in str(free)


def test_the_gain_table_says_what_a_sensor_and_a_manoeuvre_add() -> None:
    found = bound(SPRING, {"x": 1, "v": 0}, {"y": 0.1, "s": 1e-3}, TIMES)
    table = gain_table(found)
    assert table["s"]["v"] > 10
    assert table["y"]["v"] < 1.1
    pushed = {
        "states": ["v"],
        "parameters": ["m"],
        "inputs": ["F"],
        "equations": {"v": "F/m"},
        "outputs": {"y": "v"},
    }
    still = bound(pushed, {"v": 0, "m": 2}, {"y": 0.1}, TIMES, inputs={"F": 0.1}, priors={"m": 1})
    gain = gain_table(still, {"push": {"F": lambda t: 5 * np.cos(t)}})
    assert gain["push"]["m"] > 5


def test_a_manoeuvre_that_loses_an_unknown_has_no_gain_for_it() -> None:
    driven = {
        "states": ["x"],
        "parameters": ["a"],
        "inputs": ["u"],
        "equations": {"x": "a*u"},
        "outputs": {"y": "x"},
    }
    found = bound(driven, {"x": 1, "a": 0.5}, {"y": 0.1}, TIMES, inputs={"u": 1})
    table = gain_table(found, {"off": {"u": 0}, "weak": {"u": 0.5}})
    assert table["off"]["a"] == 0.0
    assert table["off"]["x"] > 1.5
    assert table["weak"]["a"] == pytest.approx(0.5)


@pytest.mark.parametrize("recorded", [{}, {"x": lambda t: np.cos(2 * t)}])
@pytest.mark.parametrize("time", ["continuous", "discrete"])
def test_steps_taken_together_are_single_steps(recorded: dict[str, Any], time: str) -> None:
    model = {
        "states": ["x", "v"],
        "parameters": ["k"],
        "inputs": ["F"],
        "equations": {"x": "x + 0.01*v", "v": "0.9*v - 0.1*k*sin(x) + F"},
        "outputs": {"y": "x*v"},
        "time": time,
    }
    values, times = {"x": 1.0, "v": 0.5, "k": 4.0}, np.linspace(0, 1, 601)
    noise, inputs = {"v": 0.1}, {"F": np.cos}
    own = bound(
        model, values, {"y": 0.1}, times, process_noise=noise, inputs=inputs, trajectory=recorded
    ).experiment
    z, course = own.start(), own.course
    for k in range(1, len(times)):
        z, transition, entered = own.step(z, float(times[k - 1]), float(times[k]))
        if recorded:
            z = np.array([np.cos(2 * times[k]), *z[1:]])
        np.testing.assert_allclose(course.values[k], z, rtol=1e-9)
        np.testing.assert_allclose(course.transitions[k - 1], transition, rtol=1e-9, atol=1e-12)
        entry = course.entries[k - 1]
        np.testing.assert_allclose(entry @ entry.T, entered, rtol=1e-7, atol=1e-12)
    if not recorded:
        several = own.simulated(np.stack([own.start(), own.start()]))
        np.testing.assert_allclose(several[1], course.values[:, 0] * course.values[:, 1] / 0.1, rtol=1e-9)


def test_a_mode_that_becomes_fast_takes_more_steps() -> None:
    drawn = {
        "states": ["x"],
        "inputs": ["u"],
        "equations": {"x": "u*(1 - x)"},
        "outputs": {"y": "x"},
    }
    found = bound(drawn, {"x": 3}, {"y": 0.1}, np.linspace(0, 1, 11), inputs={"u": lambda t: 1 + 1000 * t})
    assert found.experiment.course.values[-1, 0] == pytest.approx(1.0, abs=1e-6)
    assert found.final["x"] < 1e-6


def test_one_unknown_alone_has_a_bound() -> None:
    place = {"states": ["x"], "equations": {"x": 0}, "outputs": {"y": "x"}}
    assert bound(place, {"x": 1}, {"y": 0.2}, [0, 1, 2, 3]).final == {"x": pytest.approx(0.1)}
    step = place | {"time": "discrete", "equations": {"x": "x"}}
    assert bound(step, {"x": 1}, {"y": 0.2}, [0, 1, 2, 3]).final == {"x": pytest.approx(0.1)}


def test_an_output_at_a_lower_rate_says_less() -> None:
    often = bound(DECAY, {"x": 2, "k": 0.7}, {"y": 0.02}, TIMES)
    seldom = bound(DECAY, {"x": 2, "k": 0.7}, {"y": 0.02}, TIMES, every={"y": 10})
    assert seldom.final["k"] > 2 * often.final["k"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"values": {"x": 1}}, "values has no 'k'"),
        ({"noise": {"z": 1}}, "noise names 'z'"),
        ({"noise": {"y": 0}}, "noise of y is 0"),
        ({"noise": {}}, "nothing is measured"),
        ({"times": [1, 0]}, "times have to increase"),
        ({"times": "abc"}, "times is 'abc'; give times in s"),
        ({"times": 3.0}, "times is 3.0; give"),
        ({"noise": {"y": "1"}}, "noise is {'y': '1'}; give standard deviations by output"),
        ({"noise": None}, "noise is None; give"),
        ({"values": [1]}, "values is .1.; give numbers by name"),
        ({"values": {"x": 2, "k": "one"}}, "values is .*'one'.*; give numbers by name"),
        ({"every": {"y": "2"}}, "every is {'y': '2'}; give whole numbers"),
        ({"every": {"y": 1.5}}, "every of y is 1.5; give a whole number from 1"),
        ({"trajectory": {"x": [1]}}, "trajectory of x has 1 values for 31 times; give one for each time"),
        ({"trajectory": 3}, "trajectory is 3; give functions of time"),
        ({"after": "x"}, "after is 'x'; give what bound returned"),
    ],
)
def test_wrong_input_is_one_line_with_the_cure(changes: dict[str, Any], words: str) -> None:
    given = {"values": {"x": 2, "k": 0.7}, "noise": {"y": 0.02}, "times": TIMES} | changes
    with pytest.raises(InputError, match=words):
        bound(DECAY, **given)


def _stop(time: float) -> float:
    raise ValueError("no such time")


@pytest.mark.parametrize(
    ("course", "words"),
    [
        ([1, 2], "inputs of u has 2 values for 31 times; give one for each time"),
        ([1], "inputs of u has 1 values for 31 times"),
        ([[1, 2]], "inputs of u has 2 values for 31 times"),
        ("sin(t)", r"inputs of u is 'sin\(t\)'; give a function of time"),
        ([float("nan")] * 31, "inputs of u has values that are not finite"),
        (_stop, "the course of u stops at t = 0 with ValueError: no such time; let it return a number"),
        (lambda time: None, "the course of u stops at t = 0 with TypeError"),
        (lambda time: np.inf, "the course of u is inf at t = 0; change it"),
    ],
)
def test_a_wrong_input_is_one_line_with_the_cure(course: Any, words: str) -> None:
    driven = {"states": ["x"], "parameters": ["k"], "inputs": ["u"], "equations": {"x": "k*u"}}
    with pytest.raises(InputError, match=words) as caught:
        bound(driven | {"outputs": {"y": "x"}}, {"x": 1, "k": 1}, {"y": 1}, TIMES, inputs={"u": course})
    assert "\n" not in str(caught.value)


def test_wrong_gain_tables_are_one_line_with_the_cure() -> None:
    found = bound(DECAY, {"x": 2, "k": 0.7}, {"y": 0.02}, TIMES)
    wrong: list[tuple[Any, str]] = [
        (("x",), "found is 'x'; give what bound returned"),
        ((found, [1]), "manoeuvres is .1.; give inputs by manoeuvre"),
        ((found, {"a": 1}), "manoeuvres of a is 1; give"),
    ]
    for given, words in wrong:
        with pytest.raises(InputError, match=words):
            gain_table(*given)
