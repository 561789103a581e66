"""Sizes of errors of the models."""

import numpy as np
import pytest

from spinfilters.verdict.model_errors.score_tests import ErrorSize


@pytest.mark.parametrize(
    ("information", "prior", "told"),
    [(8e-6, 0.0, True), (8e-6, 4e-5, True), (8e-6, 1.2e-4, False), (2e-6, 0.0, False)],
)
def test_a_size_is_told_that_data_tell_better_than_what_is_plausible(
    information: float, prior: float, told: bool
) -> None:
    size = ErrorSize.of(np.array([[information]]), np.array([1e-4]), np.array([prior]))
    assert (size is not None) == told
    if size is not None:
        assert size.value[0] == pytest.approx(1e-4 / information)
        assert size.probable[0] == pytest.approx(1e-4 / (information + prior))


def test_only_directions_that_are_told_count() -> None:
    size = ErrorSize.of(np.diag([0.5, 1e-8]), np.array([1.0, 1.0]), np.zeros(2))
    assert size is not None
    assert size.dof == 1
    np.testing.assert_allclose(size.value, [2.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(("information", "told"), [(7.8e-6, False), (7.8e-3, True)])
def test_what_states_follow_nearly_has_no_size_far_beyond_what_is_plausible(
    information: float, told: bool
) -> None:
    away = -5600.0  # of a baseline, 26 times what is plausible of it
    size = ErrorSize.of(np.array([[information]]), np.array([away * information]), np.array([2.1e-5]))
    assert (size is not None) == told
