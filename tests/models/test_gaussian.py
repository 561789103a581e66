"""Beliefs: covariance and factor, and what is refused."""

import numpy as np
import pytest

from spinfilters.core.errors import InputError, ShapeError
from spinfilters.models.state_layout import ROTATION_BLOCKS, Gaussian, StateLayout

LAYOUT = StateLayout(ROTATION_BLOCKS)
MEAN = LAYOUT.origin()


def _covariance() -> np.ndarray:
    root = np.random.default_rng(0).standard_normal((11, 11))
    return root @ root.T


def test_a_covariance_comes_back_from_its_factor() -> None:
    P = _covariance()
    belief = Gaussian.from_covariance(LAYOUT, MEAN, P)
    np.testing.assert_allclose(belief.covariance, P, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(belief.std, np.sqrt(np.diag(P)), rtol=1e-12)


def test_standard_deviations_may_span_thirty_orders_of_magnitude() -> None:
    scale = np.logspace(-15, 15, 11)
    P = _covariance() + 20 * np.eye(11)
    belief = Gaussian.from_covariance(LAYOUT, MEAN, P * np.outer(scale, scale))
    np.testing.assert_allclose(
        belief.factor @ belief.factor.T / np.outer(scale, scale), P, rtol=1e-12, atol=1e-12
    )


@pytest.mark.parametrize("variance", [0.0, -1.0, np.nan, np.inf])
def test_a_variance_that_is_not_positive_is_refused(variance: float) -> None:
    P = np.eye(11)
    P[3, 3] = variance
    with np.errstate(invalid="ignore"), pytest.raises(InputError, match="variance"):
        Gaussian.from_covariance(LAYOUT, MEAN, P)


def test_an_indefinite_covariance_is_refused_and_not_repaired() -> None:
    P = np.eye(11)
    P[0, 1] = P[1, 0] = 1.0 + 1e-9
    with pytest.raises(InputError, match="not positive definite"):
        Gaussian.from_covariance(LAYOUT, MEAN, P)


def test_a_mean_or_factor_of_another_layout_is_refused() -> None:
    with pytest.raises(ShapeError, match="mean of shape"):
        Gaussian(LAYOUT, np.zeros(11), np.eye(11))
    with pytest.raises(ShapeError, match="factor of shape"):
        Gaussian(LAYOUT, MEAN, np.eye(12))
