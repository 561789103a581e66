"""NEES of samples from a belief keeps to its chi-square band, and a wrong covariance leaves it."""

from dataclasses import replace

import numpy as np
import pytest
from filterpy.stats import NEES

from spinfilters.core.errors import InputError
from spinfilters.core.linear_algebra import normalised_square
from spinfilters.evaluation.consistency import (
    chi_square_band,
    knows_state,
    nis_ratio,
    normalised_errors,
    true_states,
)
from spinfilters.evaluation.estimated_motion import trajectory_of
from spinfilters.filters.normalised_squares import normalised_squares
from spinfilters.models.state_blocks import BLOCKS
from spinfilters.models.state_layout import ROTATION_BLOCKS, StateLayout
from tests.evaluation.estimate_samples import (
    FULL,
    consistent_history,
    history_of,
    sample_factor,
    sample_truth,
)

COUNT = 300
TRUTH = sample_truth(np.random.default_rng(0), COUNT)
HISTORY = consistent_history(TRUTH, np.random.default_rng(1))


def test_nees_of_samples_from_the_belief_lies_in_the_band_as_a_whole_and_by_block() -> None:
    nees = normalised_errors(HISTORY, TRUTH)
    low, high = chi_square_band(nees.dof, COUNT, 0.999)
    assert low < nees.total.mean() < high
    for block, values in nees.blocks.items():
        low, high = chi_square_band(BLOCKS[block].dimension, COUNT, 0.999)
        assert low < values.mean() < high, block


@pytest.mark.parametrize("scale", [np.sqrt(2.0), np.sqrt(0.5)])
def test_nees_leaves_the_band_when_the_covariance_is_doubled_or_halved(scale: float) -> None:
    nees = normalised_errors(replace(HISTORY, factor=scale * HISTORY.factor), TRUTH)
    low, high = chi_square_band(nees.dof, COUNT, 0.999)
    assert not low < nees.total.mean() < high
    assert nees.total.mean() == pytest.approx(nees.dof / scale**2, rel=0.06)


def test_nees_is_that_of_filterpy_wherever_its_inverse_can_be_trusted() -> None:
    generator = np.random.default_rng(2)
    error, factor = generator.standard_normal((20, 6)), sample_factor(generator, 6, 1.0)
    factors = np.tile(factor, (20, 1, 1))
    expected = NEES(error, np.zeros((20, 6)), factors @ np.swapaxes(factors, 1, 2))
    np.testing.assert_allclose(normalised_square(error, factors), expected, rtol=1e-8)


def test_nees_of_a_block_uses_its_marginal_covariance() -> None:
    generator = np.random.default_rng(3)
    factor = sample_factor(generator, 8, 1.0)[np.newaxis]
    error = generator.standard_normal((1, 3))
    P = (factor @ np.swapaxes(factor, 1, 2))[0, 2:5, 2:5]
    expected = error[0] @ np.linalg.solve(P, error[0])
    np.testing.assert_allclose(normalised_square(error, factor[:, 2:5]), expected, rtol=1e-9)


def test_an_error_in_a_direction_of_no_variance_is_infinitely_unlikely() -> None:
    factors = np.array([np.diag([1.0, 0.0, 2.0]), np.eye(3)])
    np.testing.assert_array_equal(normalised_square(np.ones((2, 3)), factors), [np.inf, 3.0])


def test_variances_of_any_unit_are_handled() -> None:
    factors = np.diag([1e-9, 1.0, 1e6])[np.newaxis]
    np.testing.assert_allclose(normalised_square(np.array([[1e-9, 2.0, 1e6]]), factors), 6.0)


def test_squares_of_parts_are_those_of_each_part() -> None:
    rng, parts = np.random.default_rng(5), [slice(0, 7), slice(2, 5), slice(3, 7)]
    error, factor = rng.standard_normal((13, 7)), rng.standard_normal((13, 7, 9))
    factor[3, 4], factor[5, 1], factor[7, :, :7] = 0.0, 0.0, np.tril(factor[7, :, :7])
    factor *= 10.0 ** rng.uniform(-3, 3, (13, 7, 1))
    expected = np.stack([normalised_square(error[:, part], factor[:, part]) for part in parts], axis=1)
    np.testing.assert_allclose(normalised_squares(error, factor, parts), expected, rtol=1e-9)


def test_the_band_is_that_of_the_chi_square_table() -> None:
    low, high = chi_square_band(10, 1)
    assert (low, high) == pytest.approx((3.24697, 20.48318), rel=1e-5)
    low, high = chi_square_band(10, 10**6)
    assert (low, high) == pytest.approx((10.0, 10.0), rel=2e-3)
    low, high = chi_square_band(np.array([1, 10]), 1)
    assert low[0] == pytest.approx(0.000982, rel=1e-3)
    assert high[1] == pytest.approx(20.48318, rel=1e-5)


def test_true_states_reproduce_the_truth_through_the_trajectory() -> None:
    states = true_states(TRUTH, FULL)
    trajectory = trajectory_of(history_of(states, np.tile(np.eye(FULL.error_dim), (COUNT, 1, 1))))
    np.testing.assert_allclose(trajectory.position, TRUTH.center_of_mass, atol=1e-14)
    np.testing.assert_allclose(trajectory.rate_i, TRUTH.rate_i, atol=1e-14)
    np.testing.assert_allclose(trajectory.velocity, TRUTH.velocity, atol=0)


def test_a_truth_that_does_not_tell_the_body_gives_no_state() -> None:
    bodiless = replace(TRUTH, principal_moments=None)
    assert not knows_state(bodiless, FULL)
    assert knows_state(replace(TRUTH, center_of_mass_g=None), StateLayout(ROTATION_BLOCKS))
    assert not knows_state(TRUTH, StateLayout((*ROTATION_BLOCKS, "d")))
    with pytest.raises(InputError, match="principal_moments"):
        true_states(bodiless, FULL)


def test_the_ratio_of_nis_counts_measurements_not_epochs() -> None:
    history = replace(HISTORY, nis=np.arange(COUNT, dtype=float), dof=np.full(COUNT, 3))
    assert nis_ratio(history) == pytest.approx((COUNT - 1) / 2 / 3)
    assert nis_ratio(replace(HISTORY, dof=np.zeros(COUNT, dtype=int))) is None
