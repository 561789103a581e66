"""Euler's equations seen by gyros, as in chapter 3 of Tweddle's thesis: null vectors, spins, torques, other solutions."""

from typing import Any

import pytest

from observability import analyse

BODY: dict[str, Any] = {"states": ["w1", "w2", "w3"], "parameters": ["J1", "J2", "J3"]}
FREE = {"w1": "(J2 - J3)*w2*w3/J1", "w2": "(J3 - J1)*w3*w1/J2", "w3": "(J1 - J2)*w1*w2/J3"}
TURNED = {axis: f"{rate} + T{axis[1]}/J{axis[1]}" for axis, rate in FREE.items()}
THREE = BODY | {"equations": FREE, "outputs": {"y1": "w1", "y2": "w2", "y3": "w3"}}
ONE = BODY | {"equations": FREE, "outputs": {"y1": "w1"}}
SCALE = {"J1": "J1/J3", "J2": "J2/J3", "J3": "1"}


def test_three_rates_leave_the_scale_of_the_moments() -> None:
    found = analyse(THREE)
    assert (found.rank, found.certified) == (5, True)
    assert found.symbolic_null_vectors == [SCALE]
    matrix = found.observability_matrix(2)
    assert matrix.rows[3].formula == "w2*w3*(J2 - J3)/J1"
    assert matrix.rows[3].gradient["J1"] == "w2*w3*(J3 - J2)/J1**2"


def test_one_rate_leaves_one_direction_more_with_mirrored_and_exchanged_axes() -> None:
    found = analyse(ONE)
    assert (found.rank, found.certified) == (4, True)
    assert found.observable["w1"]
    assert found.symbolic_null_vectors[0] == SCALE
    assert {str(each) for each in found.other_solutions.found} == {
        "w2 -> -w2, w3 -> -w3",
        "w2 -> -w3, w3 -> w2, J2 -> J3, J3 -> J2",
    }


@pytest.mark.parametrize(
    ("axis", "rank"), [({"w1": 1, "w2": 0, "w3": 0}, 1), ({"w1": 0, "w2": 1, "w3": 0}, 2)]
)
def test_a_spin_seen_by_one_rate_shows_no_moment(axis: dict[str, int], rank: int) -> None:
    found = analyse(ONE, at=axis)
    assert (found.rank, found.generic_rank, found.certified) == (rank, 4, True)
    assert not any(found.observable[name] for name in ("J1", "J2", "J3"))


def test_a_spin_seen_by_three_rates_shows_no_moment() -> None:
    found = analyse(THREE, at={"w1": 0, "w2": 0, "w3": 1})
    assert (found.rank, found.generic_rank, found.certified) == (3, 5, True)
    assert found.symbolic_null_vectors == [SCALE, {"J1": "1"}, {"J2": "1"}]


def test_a_free_torque_about_one_axis_leaves_what_no_torque_leaves() -> None:
    found = analyse(THREE | {"equations": FREE | {"w1": TURNED["w1"]}, "unknown_inputs": ["T1"]})
    assert (found.unobservable, found.certified) == (("J1", "J2", "J3", "T1"), True)
    assert found.symbolic_null_vectors == [SCALE]
    assert str(found.invariants) == "J2/J1, J3/J1"


def test_a_free_torque_about_all_axes_leaves_every_moment() -> None:
    found = analyse(THREE | {"equations": TURNED, "unknown_inputs": ["T1", "T2", "T3"]})
    assert (found.rank, found.dimension, found.certified) == (6, 9, True)
    assert found.generators == [{"J1": "J1"}, {"J2": "J2"}, {"J3": "J3"}]


def test_a_known_torque_shows_the_scale() -> None:
    found = analyse(THREE | {"equations": FREE | {"w1": TURNED["w1"]}, "inputs": ["T1"]})
    assert found.unobservable == ()
