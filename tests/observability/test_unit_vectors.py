"""States of norm 1, such as quaternions, are one unknown less, and a built-in body is a model with some."""

from typing import Any

import casadi as ca
import numpy as np
import pytest

from observability import analyse
from observability.body_model import model_of_system
from observability.canonical_motions import CANONICAL_MOTIONS, point_of
from observability.certificate import certify
from observability.coordinates import Chart
from observability.exact_numbers import PrimeField, residue
from observability.model_analysis import analysis_of
from observability.model_rank import unit_residues
from spinfilters.core.attitude_expressions import quaternion_rate
from spinfilters.core.errors import InputError
from tests.observability.analyser_samples import CHARTS, TUMBLE, stereo_system

POINTER = {
    "states": ["x", "y", "z"],
    "parameters": ["a", "b"],
    "equations": {"x": "-a*y", "y": "a*x - b*z", "z": "b*y"},
    "outputs": {"x": "x", "y": "y"},
    "unit_vectors": [["x", "y", "z"]],
}


def test_a_component_that_is_not_measured_follows_from_the_norm() -> None:
    resting = POINTER | {"parameters": [], "equations": {"x": "0", "y": "0", "z": "0"}}
    found = analyse(resting)
    assert (found.rank, found.dimension, found.unobservable, found.certified) == (2, 2, (), True)
    free = analyse(resting | {"unit_vectors": []})
    assert (free.rank, free.dimension, free.unobservable) == (2, 3, ("z",))


def test_expressions_may_name_a_quaternion() -> None:
    q, w = ca.SX.sym("q", 4), ca.SX.sym("w", 3)
    f = ca.vertcat(quaternion_rate(q, w), ca.SX.zeros(3))
    found = analyse(f, [w], [q, w], unit_vectors=[q])
    assert (found.rank, found.dimension, found.certified) == (3, 6, True)
    assert len(found.generators) == 3


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"unit_vectors": [["x", "y"]]}, "changes its norm along the motion"),
        ({"unit_vectors": [["x", "a"]]}, "is no group of states"),
        ({"unit_vectors": [["x"]]}, "is no group of states"),
        ({"unit_vectors": "x"}, "give a list of lists"),
        ({"point": {"x": 1, "y": 1, "z": 0}}, "a norm other than 1 at the point"),
        ({"point": {"x": 1}}, "a norm other than 1 at the point"),
    ],
)
def test_what_is_no_unit_vector_is_refused(change: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        analyse(POINTER | change)


def test_the_branch_at_a_drawn_unit_vector_is_named() -> None:
    found = analyse(POINTER | {"outputs": {"r": "max(x, 0)"}})
    assert found.branches == ["x > 0"]
    assert analyse(POINTER | {"outputs": {"r": "max(x - 2, y - 5)"}}).branches == ["x - 2 > y - 5"]


def test_drawn_vectors_have_norm_one() -> None:
    field = PrimeField()
    drawn = np.random.default_rng(0).integers(1, field.order, (4, 5), dtype=np.uint64)
    q = unit_residues(drawn, field.prime)
    assert all(sum(int(each) ** 2 for each in column) % field.prime == 1 for column in q.T)


def test_a_null_space_in_rationals_is_at_a_point_on_the_sphere() -> None:
    found = analyse(POINTER | {"outputs": {"x": "x"}}).null_vectors
    assert found is not None
    assert sum(found.point[name] ** 2 for name in "xyz") == 1
    assert residue(found.point["z"], 7919) >= 0


@pytest.mark.parametrize("chart", CHARTS, ids=lambda chart: chart.name)
def test_a_body_in_general_position_is_a_model_like_any_other(chart: Chart) -> None:
    system = stereo_system(chart, 3)
    found = analysis_of(model_of_system(system))
    known = certify(system, point_of(chart, TUMBLE))
    assert (found.rank, found.dimension) == (known.rank, known.dimension)


@pytest.mark.parametrize("motion", CANONICAL_MOTIONS[::3], ids=lambda motion: motion.name)
def test_a_body_at_a_special_motion_has_the_rank_of_its_certificate(motion: Any) -> None:
    system, point = stereo_system(CHARTS[1], 1), point_of(CHARTS[1], motion)
    found = analysis_of(model_of_system(system, point))
    assert found.rank == certify(system, point).rank


@pytest.mark.parametrize(
    ("outputs", "how"), [(["w1"], "Determined of them"), (["w1", "q1*q3 + q2*q4"], "Known")]
)
def test_the_norm_of_an_unobservable_quaternion_is_told(outputs: list[str], how: str) -> None:
    found = analyse(
        {
            "states": ["q1", "q2", "q3", "q4", "w1"],
            "unit_vectors": [["q1", "q2", "q3", "q4"]],
            "equations": {
                "q1": "w1*q4/2",
                "q2": "w1*q3/2",
                "q3": "-w1*q2/2",
                "q4": "-w1*q1/2",
                "w1": 0,
            },
            "outputs": {f"y{k}": text for k, text in enumerate(outputs)},
        }
    )
    (line,) = [each for each in found.sentences if "the norm 1" in each or "q1**2 + q2**2 + q3**2" in each]
    assert line.startswith(how)
