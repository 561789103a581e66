"""Differences of two estimates in deviations of one of them."""

import numpy as np
import pytest

from spinfilters.verdict.judge import QuantityDifference


@pytest.mark.parametrize(
    ("std", "largest"),
    [((1.0, 2.0), 3.0), ((0.0, 2.0), 1.5), ((np.nan, 2.0), np.inf), ((1.0, np.nan), np.inf)],
)
def test_a_deviation_that_is_no_number_bounds_no_difference(std: tuple[float, float], largest: float) -> None:
    found = QuantityDifference(np.full((1, 2), 3.0), np.array([std]), np.ones((1, 2)))
    assert found.largest == largest
