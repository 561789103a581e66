"""The prior of a smoother's first state."""

import numpy as np
import pytest

from spinfilters.models.state_layout import Gaussian, StateLayout
from spinfilters.smoother.priors import FirstStatePrior

LAYOUT = StateLayout(("a", "w", "s"))
STD = np.geomspace(1e-3, 1e2, LAYOUT.error_dim)


def test_errors_are_whitened_as_by_the_same_gaussian() -> None:
    mean, rows = LAYOUT.origin(), np.random.default_rng(1).normal(size=(LAYOUT.error_dim, 4))
    prior = FirstStatePrior(mean, STD)
    found = prior.whitened(rows)
    np.testing.assert_allclose(found, Gaussian(LAYOUT, mean, prior.factor).whitened(rows), rtol=1e-14)
    np.testing.assert_allclose(prior.factor @ found, rows, rtol=1e-14)


def test_no_error_is_whitened_where_a_standard_deviation_is_zero() -> None:
    prior = FirstStatePrior(LAYOUT.origin(), np.where(np.arange(len(STD)) == 2, 0.0, STD))
    with pytest.raises(np.linalg.LinAlgError, match="zero"):
        prior.whitened(np.ones((len(STD), 1)))
