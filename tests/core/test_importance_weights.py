"""Pareto-smoothed importance weights: the shape of a known tail, and averages of a known target."""

import numpy as np
import pytest

from spinfilters.core.posterior_sampling import LARGEST_SHAPE, generalised_pareto, smoothed_weights


@pytest.mark.parametrize("shape", [-0.2, 0.1, 0.5, 0.9])
def test_the_shape_of_a_pareto_tail_is_found(shape: float) -> None:
    u = np.random.default_rng(1).random(4000)
    scale, found = generalised_pareto(np.sort(2.0 * np.expm1(-shape * np.log1p(-u)) / shape))
    assert found == pytest.approx(shape, abs=0.06)
    assert scale == pytest.approx(2.0, rel=0.08)


def test_a_proposal_of_half_the_width_is_named_and_one_of_twice_the_width_is_not() -> None:
    generator = np.random.default_rng(2)
    z = generator.standard_normal((2000, 5))

    def ratios(width: float) -> np.ndarray:
        return -0.5 * np.square(width * z).sum(axis=1) + 0.5 * np.square(z).sum(axis=1)

    assert smoothed_weights(ratios(2.0)).shape < 0.3
    wide = smoothed_weights(ratios(2.0))
    x = 2.0 * z
    np.testing.assert_allclose(wide.weights @ np.square(x), 1.0, atol=0.25)
    assert smoothed_weights(np.square(z).sum(axis=1)).shape > LARGEST_SHAPE


def test_equal_weights_stay_equal_and_no_weight_says_so() -> None:
    equal = smoothed_weights(np.zeros(100))
    np.testing.assert_allclose(equal.weights, 0.01)
    assert equal.effective == pytest.approx(100)
    assert equal.shape < LARGEST_SHAPE
    assert smoothed_weights(np.full(100, -np.inf)).shape == np.inf
