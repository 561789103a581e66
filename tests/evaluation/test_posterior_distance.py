"""Distance of a stated Gaussian from a sampled posterior."""

import numpy as np
import pytest
from scipy.special import ndtr

from spinfilters.evaluation.stated_errors import QuantityMixture


def test_the_probability_outside_is_one_whatever_sums_round_to() -> None:
    weights = np.random.default_rng(1).dirichlet(np.ones(800))
    mixture = QuantityMixture(np.zeros((800, 3)), np.ones((800, 3)), weights)
    outside = mixture.outside(np.array([-20.0, -2.0, 9.0]), np.array([20.0, 1.0, 10.0]))
    assert outside[0] == 0.0
    assert outside[1] == pytest.approx(ndtr(-2.0) + ndtr(-1.0))
    assert 1.0 - 1e-12 < outside[2] <= 1.0
