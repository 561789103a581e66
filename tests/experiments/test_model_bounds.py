"""The study of bounds of systems of the user's: its intervals and its smaller noise."""

import numpy as np
import pytest

from experiments.model_bounds import compared, experiments, ratio_interval, with_noise
from observability.model_bound import bound_of


def test_the_interval_of_a_ratio_holds_the_true_one_in_95_percent_of_studies() -> None:
    runs, random = 200, np.random.default_rng(0)
    ratios = np.sqrt((random.standard_normal((4000, runs)) ** 2).mean(axis=1))
    held = np.array([low < 1 < high for low, high in (ratio_interval(float(each), runs) for each in ratios)])
    assert abs(held.mean() - 0.95) < 4 * np.sqrt(0.95 * 0.05 / len(ratios))


def test_every_bound_is_proportional_to_the_noise() -> None:
    for own in experiments():
        less = bound_of(with_noise(own, 0.1)).final
        for name, bound in bound_of(own).final.items():
            assert less[name] == pytest.approx(0.1 * bound, rel=1e-4), (own.model.name, name)


def test_a_ratio_of_few_runs_stands_beside_its_wide_interval() -> None:
    decay = next(own for own in experiments() if "decay" in own.model.name)
    lines, off = compared(decay, "decay", 50, 0)
    low, high = (float(lines[0].split()[k]) for k in (-3, -1))
    assert low < 1 - 0.1 < 1 + 0.1 < high
    assert off < 4 / np.sqrt(2 * 50)
