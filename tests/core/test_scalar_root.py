"""Roots of functions of one number, as SciPy finds them."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from spinfilters.verdict.model_errors.noise_components import root_between


@pytest.mark.parametrize("seed", range(20))
def test_root_is_that_of_scipy_to_the_last_bit(seed: int) -> None:
    rng = np.random.default_rng(seed)
    weights, value = rng.exponential(size=6), float(rng.uniform(0.1, 10.0))

    def slope(t: float) -> float:
        return float((weights / (1 - 2 * t * weights)).sum()) - value

    def steep(x: float) -> float:
        return math.expm1(x * value) - float(weights[0])

    high = 0.5 / float(weights.max()) * (1 - 1e-12)
    for function, low, end in ((slope, -1e4, high), (steep, -3.0, 9.0)):
        assert root_between(function, low, end) == brentq(function, low, end)


def test_end_of_the_interval_may_be_the_root() -> None:
    assert root_between(lambda x: x - 2.0, 2.0, 3.0) == 2.0
    assert root_between(lambda x: x - 3.0, 2.0, 3.0) == 3.0


def test_equal_signs_at_both_ends_are_refused_with_the_values() -> None:
    with pytest.raises(ArithmeticError, match="no two signs: 1 at -1 and 4 at 2"):
        root_between(lambda x: x * x, -1.0, 2.0)


def test_values_that_are_no_numbers_are_numerical_trouble() -> None:
    with pytest.raises(ArithmeticError, match=r"the value at .* is not a number"):
        root_between(lambda x: x if abs(x) == 1.0 else math.nan, -1.0, 1.0)
