"""Likelihood of noise levels of a solved problem."""

import numpy as np

from spinfilters.verdict.model_errors.hypotheses import gross_error_cost


def test_a_gross_error_costs_more_than_noise_and_less_than_as_noise() -> None:
    near, far = gross_error_cost(np.array([40.0, 1e6]), 6)
    assert 30 < near < 60
    assert near < far < 150
