"""Parametrisations of principal moments: there and back, their constraints, and which values are no body."""

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.core.inertia_charts import (
    aghili_constraint,
    aghili_parameters,
    box_of_equal_inertia,
    is_body,
    lichter_direction,
    moments_from_aghili,
    moments_from_lichter,
    moments_from_log_ratios,
)

SECOND = np.random.default_rng(5).uniform(0.05, 1.0, (50, 3))
MOMENTS = SECOND.sum(axis=1, keepdims=True) - SECOND


def test_aghilis_parameters_keep_their_constraint_and_give_the_moments_back() -> None:
    p = aghili_parameters(MOMENTS)
    np.testing.assert_allclose(aghili_constraint(p), 0.0, atol=1e-12)
    np.testing.assert_allclose(p[:, 0], -(p[:, 1] + p[:, 2]) / (1 + p[:, 1] * p[:, 2]), atol=1e-12)
    assert (np.abs(p) < 1).all()
    np.testing.assert_allclose(moments_from_aghili(p), MOMENTS / MOMENTS[:, :1], rtol=1e-12)


def test_lichters_quaternion_gives_the_moments_whose_direction_it_turns_to() -> None:
    z = lichter_direction(MOMENTS)
    half = np.sqrt((1 + z[:, 2]) / 2)  # the shortest turn from (0, 0, 1) to z
    q = np.column_stack([-z[:, 1] / (2 * half), z[:, 0] / (2 * half), np.zeros(len(z)), half])
    found = moments_from_lichter(q)
    np.testing.assert_allclose(found / found[:, :1], MOMENTS / MOMENTS[:, :1], rtol=1e-9)
    assert moments_from_lichter(np.array([0.0, 0.0, 1.0, 0.0]))[2] == 0.0


def test_a_uniform_box_has_its_own_edges() -> None:
    edges = np.array([[0.3, 0.5, 1.0], [1.0, 0.2, 0.2]])
    squares = edges**2
    moments = squares.sum(axis=1, keepdims=True) - squares
    np.testing.assert_allclose(box_of_equal_inertia(7.0 * moments), edges, rtol=1e-12)
    assert 5e-4 < box_of_equal_inertia(np.array([0.5, 0.5, 1.0]))[2] < 2e-3


def test_ratios_admit_impossible_bodies() -> None:
    assert is_body(MOMENTS).all()
    assert is_body(moments_from_log_ratios(np.array([0.0517, 0.0971])))
    assert not is_body(moments_from_log_ratios(np.array([1.0, 1.0])))
    assert not is_body(moments_from_aghili(np.array([0.0, 1.5, 0.2])))


@pytest.mark.parametrize("moments", [[1.0, 0.0, 1.0], [1.0, np.nan, 1.0], [-1.0, 1.0, 1.0]])
def test_moments_that_are_none_are_refused(moments: list[float]) -> None:
    with pytest.raises(InputError, match="positive and finite"):
        aghili_parameters(np.array(moments))
