"""Whether a matrix is positive definite, and where its eigenvectors point, is the same on every processor."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.errors import InputError
from spinfilters.core.linear_algebra import (
    correlation_root,
    is_definite,
    which_definite,
    with_largest_positive,
)
from spinfilters.core.mass_distribution import from_inertia

SEEDS = st.integers(0, 1 << 32)


def rotation(seed: int) -> np.ndarray:
    """Any of them."""
    q = np.random.default_rng(seed).standard_normal(4)
    return matrix_from_quaternion(q / np.linalg.norm(q))


@given(SEEDS)
def test_a_plate_is_no_rigid_body_however_it_lies(seed: int) -> None:
    R = rotation(seed)
    with pytest.raises(InputError, match="triangle inequality"):
        from_inertia(R @ np.diag([2.0, 1.0, 1.0]) @ R.T)


@given(SEEDS)
def test_a_body_as_thin_as_a_sheet_of_paper_is_one(seed: int) -> None:
    R = rotation(seed)
    assert np.isfinite(from_inertia(R @ np.diag([2.0 - 1e-8, 1.0, 1.0]) @ R.T)).all()


@given(SEEDS)
def test_a_singular_covariance_is_not_definite_in_any_units(seed: int) -> None:
    generator = np.random.default_rng(seed)
    root, units = generator.standard_normal((6, 5)), 10.0 ** generator.uniform(-6, 6, 6)
    assert not is_definite((root @ root.T) * np.outer(units, units))
    assert is_definite((root @ root.T + 1e-6 * np.eye(6)) * np.outer(units, units))


@pytest.mark.parametrize("variance", [0.0, -1.0, np.nan, np.inf])
def test_a_variance_that_is_none_is_not_definite(variance: float) -> None:
    assert not is_definite(np.diag([1.0, variance]))


def test_the_root_is_that_of_the_correlations_one_by_one() -> None:
    P = np.array([[4.0, 1.0], [1.0, 9.0]])
    both = correlation_root(np.stack([P, 2 * P]))
    expected = np.linalg.cholesky(np.array([[1.0, 1 / 6], [1 / 6, 1.0]]))
    np.testing.assert_allclose(both, np.stack([expected, expected]), rtol=1e-15)
    assert not is_definite(np.stack([P, np.ones((2, 2))]))


@pytest.mark.parametrize("rounding", [-1e-15, 0.0, 1e-15])
def test_of_equally_large_components_the_first_is_made_positive(rounding: float) -> None:
    vector = np.array([-1.0, 1.0 + rounding, 0.5])
    np.testing.assert_array_equal(with_largest_positive(np.stack([vector, -vector])), [-vector, -vector])
    np.testing.assert_array_equal(with_largest_positive(np.array([0.1, -3.0])), [-0.1, 3.0])


def test_of_many_matrices_it_is_told_which_are_definite() -> None:
    P = np.array([[2.0, 0.3], [0.3, 1.0]])
    np.testing.assert_array_equal(which_definite(np.stack([P, np.ones((2, 2)), P])), [True, False, True])
    np.testing.assert_array_equal(which_definite(np.stack([P, 2 * P])), [True, True])
    assert which_definite(np.empty((0, 2, 2))).shape == (0,)
