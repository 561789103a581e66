"""Probabilities of score tests where the model is right: known limits, and what is drawn."""

import numpy as np
import pytest
from scipy.stats import chi2, f

from spinfilters.verdict.model_errors.noise_components import gain_tail, weighted_chi_square_tail
from spinfilters.verdict.model_errors.score_tests import _p_value


@pytest.mark.parametrize("value", [0.5, 5.0, 30.0, 90.0])
def test_equal_weights_are_chi_squared(value: float) -> None:
    found = weighted_chi_square_tail(np.full(5, 2.0), 2 * value, np.inf)
    assert found == pytest.approx(chi2.sf(value, 5), rel=0.03)


@pytest.mark.parametrize("ratio", [0.5, 2.0, 6.0])
def test_equal_weights_over_an_estimated_level_are_distributed_as_fisher_says(ratio: float) -> None:
    found = weighted_chi_square_tail(np.ones(6), 6 * ratio, 25.0)
    assert found == pytest.approx(f.sf(ratio, 6, 25), rel=0.03)


def test_unlike_weights_agree_with_draws() -> None:
    weights = np.array([5.0, 1.0, 0.5, 0.1, 0.0])
    drawn = np.random.default_rng(1).standard_normal((200_000, 5)) ** 2 @ weights
    for value in (6.0, 20.0, 45.0):
        expected = float(np.mean(drawn > value))
        assert weighted_chi_square_tail(weights, value, np.inf) == pytest.approx(expected, rel=0.12)


def test_nothing_is_certain() -> None:
    assert weighted_chi_square_tail(np.zeros(3), 1.0, np.inf) == 1.0
    assert weighted_chi_square_tail(np.ones(3), 0.0, 10.0) == 1.0


def test_a_gain_over_known_noise_is_chi_squared_and_less_telling_over_few_degrees_of_freedom() -> None:
    assert gain_tail(20.0, 3, np.inf) == pytest.approx(chi2.sf(20.0, 3))
    assert gain_tail(20.0, 3, 1e6) == pytest.approx(chi2.sf(20.0, 3), rel=1e-3)
    assert gain_tail(20.0, 3, 12.0) > 4 * gain_tail(20.0, 3, 120.0)


def test_gains_of_regressions_are_significant_as_often_as_they_should_be() -> None:
    generator, n, m = np.random.default_rng(2), 20, 3
    left = generator.standard_normal((4000, n)) ** 2
    gains = n * np.log(left.sum(axis=1) / left[:, m:].sum(axis=1))
    share = np.mean([gain_tail(gain, m, n) < 0.05 for gain in gains])
    assert share == pytest.approx(0.05, abs=0.012)


def test_errors_by_epoch_of_right_models_are_found_no_more_often_than_their_probability_says() -> None:
    generator = np.random.default_rng(3)
    values = np.logspace(-4, 2, 60)
    drawn = generator.standard_normal((250, 60)) * np.sqrt(values)
    found = np.array([_p_value(values, along, np.inf) for along in drawn])
    assert np.mean(found < 0.05) < 0.09
    assert found.min() > 1e-4
    assert _p_value(values, 6 * np.sqrt(values), np.inf) < 1e-9
