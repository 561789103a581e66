"""Means of densities against integrals over their posteriors."""

import numpy as np
import pytest
from scipy.special import gamma

from spinfilters.filters.noise_levels import raised_logarithm


@pytest.mark.parametrize("count", [15, 60, 240])
def test_a_density_that_squares_tell_is_raised_to_its_mean(count: int) -> None:
    theta = np.linspace(-3, 6, 20_001)
    log_posterior = 0.5 * theta - 0.5 * count * (theta + np.exp(-theta))  # flat in the standard deviation
    weight = np.exp(log_posterior - log_posterior.max())
    mean = float(np.sum(weight * np.exp(theta)) / np.sum(weight))
    likeliest = theta[np.argmax(weight)]
    assert np.log(mean) - likeliest == pytest.approx(raised_logarithm(2 / count), rel=0.25)


def test_a_density_that_other_noise_hides_is_lowered_to_its_mean() -> None:
    """Of a normal likelihood at zero and deviation 1: p(x = sqrt(theta)) in proportion to exp(-x^4 / 2), largest ln theta p at
    theta = 1 / sqrt(2), with the information 1 there."""
    mean = np.sqrt(2) * gamma(3 / 4) / gamma(1 / 4)
    assert raised_logarithm(1.0, 0.01) == pytest.approx(np.log(mean * np.sqrt(2)), abs=0.02)


@pytest.mark.parametrize("share", [0.01, 0.5, 1.0])
@pytest.mark.parametrize("variance", [1e-12, 1e-3, 0.4, 1.9, 2.0, 1e3, np.inf])
def test_a_mean_is_moderate_whatever_tells_the_density(variance: float, share: float) -> None:
    assert abs(raised_logarithm(variance, share)) < 1.0


def test_a_density_known_exactly_is_its_mean() -> None:
    assert raised_logarithm(1e-6) == pytest.approx(0.0, abs=1e-5)
