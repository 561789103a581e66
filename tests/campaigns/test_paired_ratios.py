"""Ratios of estimators on the same recordings."""

import numpy as np
import pytest

from spinfilters.campaigns.statistics import geometric_ratio, reference_of


def test_the_difficulty_of_a_recording_cancels_in_a_ratio() -> None:
    generator = np.random.default_rng(0)
    difficulty, noise = np.exp(2 * generator.standard_normal(400)), 0.1 * generator.standard_normal(400)
    found = geometric_ratio(0.8 * difficulty * np.exp(noise), difficulty)
    assert found.low < 0.8 < found.high
    assert found.high / found.low < 1.03
    inverse = geometric_ratio(difficulty, 0.8 * difficulty * np.exp(noise))
    assert inverse.value == pytest.approx(1 / found.value)


def test_pairs_without_a_number_are_left_out_and_two_have_no_interval() -> None:
    found = geometric_ratio(np.array([2.0, np.nan, 2.0, 0.0]), np.array([1.0, 1.0, 1.0, 1.0]))
    assert (found.value, found.count) == (pytest.approx(2.0), 2)
    assert np.isnan(found.low)


def test_the_smoother_is_the_reference_where_there_is_one() -> None:
    assert reference_of(["mekf", "smoother", "ukf"]) == "smoother"
    assert reference_of(["ukf", "mekf"]) == "mekf"
    assert reference_of(["ukf"]) is None
