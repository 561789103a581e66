"""Quantiles and probabilities of scalar mixtures of Gaussians."""

import numpy as np
import pytest
from scipy.special import ndtri

from spinfilters.models.state_mixture import mixture_probability, mixture_quantiles

LEVELS = np.array([0.025, 0.5, 0.975])


def test_one_component_is_a_gaussian() -> None:
    found = mixture_quantiles(LEVELS, np.array([3.0]), np.array([0.1]), np.ones(1))
    assert found == pytest.approx(3.0 + 0.1 * ndtri(LEVELS), abs=1e-9)


def test_probability_of_a_quantile_is_its_level() -> None:
    values, std, weights = np.array([-1.0, 0.5, 4.0]), np.array([0.1, 1.0, 0.01]), np.array([0.2, 0.5, 0.3])
    at = mixture_quantiles(LEVELS, values, std, weights)
    assert mixture_probability(at, values, std, weights) == pytest.approx(LEVELS, abs=1e-9)


def test_components_of_no_width_are_weighted_points() -> None:
    found = mixture_quantiles(
        np.array([0.3, 0.7]), np.arange(4.0), np.zeros(4), np.array([0.2, 0.2, 0.2, 0.4])
    )
    assert found == pytest.approx([1.0, 3.0], abs=1e-9)
