"""A belief carried ahead covers what really happens, and no longer does when its covariance is halved."""

from functools import cache

import numpy as np
import pytest
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.core.linear_algebra import normalised_square
from spinfilters.evaluation.consistency import chi_square_band
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.measurement_prediction import predict_ahead
from spinfilters.models.state_layout import Gaussian
from tests.filters.filter_samples import FULL, PROCESS, START, embedded, started

SEEDS, STEPS, INTERVAL = 20, 40, 0.5
DRAWS, SHORT = 400, 12
AHEAD = INTERVAL * np.arange(1, STEPS + 1)
SURE = np.repeat([1e-3, 2e-3, 1e-3, 2e-3, 1e-3, 5e-3], [3, 3, 3, 3, 3, 5])
"""Standard deviations of a state that the motion's linear model holds for."""


def belief() -> Gaussian:
    """A sure belief about the first state of the known-map example."""
    return Gaussian(FULL, embedded(0).truth[0], np.diag(SURE))


@cache
def from_the_middle() -> Float[np.ndarray, "r k"]:
    """NEES of predictions from the end of the start, 30 s into recordings of 57 s, to the epochs after it."""
    rows = []
    for seed in range(SEEDS):
        prediction = predict_ahead(PROCESS, started(seed).belief, AHEAD)
        truth = embedded(seed).truth[START.epochs : START.epochs + STEPS]
        rows.append(normalised_square(FULL.local(prediction.mean, truth), prediction.factor))
    return np.array(rows)


@cache
def of_drawn_motions() -> Float[np.ndarray, " r"]:
    """NEES, 6 s ahead, of motions that begin where the belief may be and are disturbed as the process says."""
    generator = np.random.default_rng(0)
    first, prediction = belief(), predict_ahead(PROCESS, belief(), AHEAD[:SHORT])
    errors = generator.standard_normal((DRAWS, FULL.error_dim)) @ first.factor.T
    states = FULL.retract(np.tile(first.mean, (DRAWS, 1)), errors)
    for _ in range(SHORT):
        moved = PROCESS.step(states, INTERVAL)
        _, _, noise = PROCESS.linearise_steps(states, moved, np.full(DRAWS, INTERVAL))
        drawn = noise @ generator.standard_normal((DRAWS, noise.shape[2], 1))
        states = FULL.retract(moved, drawn[..., 0])
    last = prediction.belief(-1)
    means, factors = np.tile(last.mean, (DRAWS, 1)), np.tile(last.factor, (DRAWS, 1, 1))
    return normalised_square(FULL.local(means, states), factors)


def test_predictions_from_the_middle_of_recordings_cover_the_truth() -> None:
    low, high = chi_square_band(FULL.error_dim, SEEDS)
    nees = from_the_middle()
    assert low < nees.mean() < high
    assert low < nees[:, -1].mean() < high


def test_predictions_of_half_the_covariance_do_not_cover_the_truth() -> None:
    high = chi_square_band(FULL.error_dim, SEEDS)[1]
    halved = 2 * from_the_middle()
    assert halved.mean() > high
    assert halved[:, -1].mean() > high


def test_predictions_are_as_wide_as_motions_drawn_from_the_process() -> None:
    low, high = chi_square_band(FULL.error_dim, DRAWS, 0.99)
    nees = of_drawn_motions()
    assert low < nees.mean() < high
    assert 2 * nees.mean() > high


def test_a_prediction_is_what_a_filter_says_that_gets_no_measurement() -> None:
    ekf = MultiplicativeEkf(PROCESS)
    ekf.start(belief())
    prediction = predict_ahead(PROCESS, belief(), AHEAD[:SHORT])
    for k in range(SHORT):
        ekf.predict(INTERVAL)
        np.testing.assert_allclose(prediction.mean[k], ekf.belief.mean, rtol=0, atol=1e-12)
        np.testing.assert_allclose(
            prediction.belief(k).covariance, ekf.belief.covariance, rtol=1e-9, atol=1e-15
        )


def test_steps_need_not_be_equal_and_their_number_hardly_matters() -> None:
    coarse = predict_ahead(PROCESS, belief(), np.array([0.7, 3.0]))
    fine = predict_ahead(PROCESS, belief(), np.linspace(0.0, 3.0, 31)[1:])
    np.testing.assert_allclose(coarse.mean[-1], fine.mean[-1], atol=1e-7)
    np.testing.assert_allclose(coarse.belief(-1).std, fine.belief(-1).std, rtol=0.02)


@pytest.mark.parametrize("ahead", [[], [0.0], [-1.0], [1.0, 1.0], [2.0, 1.0], [np.nan], [np.inf]], ids=str)
def test_times_that_are_not_ahead_and_increasing_are_refused(ahead: list[float]) -> None:
    with pytest.raises(InputError, match="ahead"):
        predict_ahead(PROCESS, belief(), np.array(ahead))
