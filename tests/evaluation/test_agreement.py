"""The NEES that a filter is expected to have, with the smoother of the same measurements for the truth."""

from dataclasses import replace

import numpy as np
import pytest

from spinfilters.evaluation.consistency import WHOLE, expected_nees
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout
from tests.evaluation.estimate_samples import history_of, sample_point

LAYOUT = StateLayout(FULL_BLOCKS)
N = LAYOUT.error_dim
FACTOR = np.linalg.cholesky(0.01 * np.eye(N) + 0.002)
SMOOTHER = history_of(
    np.array([sample_point(np.random.default_rng(seed), LAYOUT) for seed in range(6)]),
    np.tile(FACTOR, (6, 1, 1)),
)


def test_a_filter_that_says_what_the_smoother_says_is_consistent() -> None:
    np.testing.assert_allclose(expected_nees(SMOOTHER, SMOOTHER)[WHOLE], 1.0, rtol=1e-9)


def test_a_filter_that_states_half_the_deviation_has_four_times_the_square() -> None:
    half = replace(SMOOTHER, factor=SMOOTHER.factor / 2)
    np.testing.assert_allclose(expected_nees(half, SMOOTHER)[WHOLE], 4.0, rtol=1e-9)


def test_a_mean_that_is_away_adds_its_squared_length() -> None:
    error = np.zeros(N)
    error[LAYOUT.slice("v")] = FACTOR[LAYOUT.slice("v")] @ (3.0 * np.eye(N)[LAYOUT.slice("v").start])
    away = replace(SMOOTHER, mean=LAYOUT.retract(SMOOTHER.mean, np.tile(error, (6, 1))))
    length = np.sum(np.linalg.solve(FACTOR, error) ** 2)
    np.testing.assert_allclose(expected_nees(away, SMOOTHER)[WHOLE], 1 + length / N, rtol=1e-6)


def test_a_thin_direction_that_turns_with_the_estimate_is_no_error() -> None:
    """One belief about the mass distribution, told about two estimates."""
    rng, part = np.random.default_rng(3), LAYOUT.slice("s")
    thin, error = FACTOR.copy(), np.zeros(N)
    axes = np.linalg.qr(rng.normal(size=(5, 5)))[0]
    thin[part], error[part] = 0.0, axes @ [0.2, 1e-3, -1e-3, 1e-3, 1e-3]
    thin[part, part] = axes * [0.1, 1e-3, 1e-3, 1e-3, 1e-3]
    moved, about = LAYOUT.retract(SMOOTHER.mean[0], error), LAYOUT.reset_jacobian(error) @ thin
    filtered, smoothed = history_of(SMOOTHER.mean[:1], thin[None]), history_of(moved[None], about[None])
    drawn = LAYOUT.retract(np.tile(moved, (2000, 1)), rng.normal(size=(2000, N)) @ about.T)
    errors = np.linalg.solve(thin, LAYOUT.local(np.tile(SMOOTHER.mean[0], (2000, 1)), drawn).T)
    np.testing.assert_allclose(
        expected_nees(filtered, smoothed)[WHOLE], np.square(errors).sum() / N / 2000, rtol=0.1
    )


def test_only_own_finite_epochs_that_both_have_are_compared() -> None:
    mean = SMOOTHER.mean.copy()
    mean[3] = np.nan
    broken = replace(SMOOTHER, mean=mean, initialisation=2)
    assert len(expected_nees(broken, SMOOTHER)[WHOLE]) == 3


@pytest.mark.parametrize("row", [0, N - 1])
def test_a_singular_covariance_is_never_consistent(row: int) -> None:
    factor = SMOOTHER.factor.copy()
    factor[:, row] = 0.0
    assert np.isinf(expected_nees(replace(SMOOTHER, factor=factor), SMOOTHER)[WHOLE]).all()


@pytest.mark.parametrize("far", [1e3, 1e60, 1e200])
def test_a_filter_too_far_away_for_a_number_is_never_consistent(far: float) -> None:
    mean = SMOOTHER.mean.copy()
    mean[:, LAYOUT.mean_slice("s")] = far
    with np.errstate(all="ignore"):
        found = expected_nees(replace(SMOOTHER, mean=mean), SMOOTHER)
    assert all((nees > 100).all() for nees in found.values())
