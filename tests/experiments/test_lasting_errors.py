"""Mixtures for errors that last: their deviations and weights, and the score of a mixture."""

import numpy as np
import pytest
from scipy.stats import norm

from experiments.lasting_errors import mixture_of, score
from spinfilters.verdict.model_errors.correlated_errors import CorrelatedErrors


def _explained(probability: float, white: float, lasting: float, widened: float) -> CorrelatedErrors:
    variances = np.array([[white], [lasting], [widened]])
    return CorrelatedErrors({}, {}, {}, 1.0, probability, 0.0, 1.0, np.ones((1, 1, 1)), variances, 0.0)


def test_without_an_explanation_the_mixture_is_the_stated_gaussian() -> None:
    weights, std = mixture_of(0.3, (), 0)
    assert (weights.tolist(), std.tolist()) == ([1.0], [0.3])


def test_a_mixture_has_the_odds_of_its_explanation_and_keeps_what_else_is_stated() -> None:
    weights, std = mixture_of(np.sqrt(9.0 + 0.25), (_explained(0.2, 1.0, 4.0, 9.0),), 0)
    assert weights[0] == pytest.approx(0.8)
    assert weights.sum() == pytest.approx(1.0)
    assert std == pytest.approx(np.sqrt([1.25, 4.25, 4.25, 4.25]))


@pytest.mark.parametrize("weights", [[1.0], [0.5, 0.5]])
def test_the_score_of_equal_gaussians_is_that_of_one(weights: list[float]) -> None:
    error, s = 0.7, 0.4
    z = error / s
    one = s * (z * (2 * norm.cdf(z) - 1) + 2 * norm.pdf(z) - 1 / np.sqrt(np.pi))
    assert score(error, np.array(weights), np.full(len(weights), s)) == pytest.approx(one)
