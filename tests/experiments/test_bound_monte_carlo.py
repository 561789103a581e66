"""The Monte Carlo of the bound on a few runs."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.bound_monte_carlo import (
    LAYOUT,
    bound_at_truth,
    monte_carlo,
    prior_deviations,
    ratio,
    ratio_table,
    recorded,
    smoothed_errors,
)
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate

SCENARIO = Scenario.simplified(rate_rpm=RICH_RPM, epochs=40, landmarks=60)


def test_the_smoother_scatters_by_the_bound_in_a_few_runs() -> None:
    squares = monte_carlo(SCENARIO, range(12))
    for block, values in squares.items():
        root, error = ratio(values)
        assert abs(root - 1) < max(4 * error, 0.1), block
    assert ratio_table(squares, "12 runs").row_count == len(LAYOUT.blocks)


def test_a_smoother_that_is_told_half_the_noise_scatters_by_more_than_its_bound() -> None:
    squares = []
    for seed in range(8):
        scenario = replace(SCENARIO, seed=seed)
        recording = recorded(simulate(scenario), replace(scenario, pixel_std=0.5))
        errors = smoothed_errors(recording, recording.states[0])[1:] / bound_at_truth(recording)[1:]
        squares.append(np.square(errors[:, LAYOUT.slice("a")]).mean())
    assert ratio(np.array(squares))[0] > 1.2


def test_no_error_is_made_where_nothing_is_wrong() -> None:
    """The prior's mean at the truth, and pixels as the truth predicts them but for their noise: the first pose is exact."""
    recording = recorded(simulate(SCENARIO), SCENARIO)
    errors = smoothed_errors(recording, recording.states[0])
    assert np.abs(errors[0, :6]).max() < 1e-7
    assert prior_deviations().shape == (LAYOUT.error_dim,)


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_the_ratio_is_a_root_of_means_with_its_standard_error(scale: float) -> None:
    draws = np.random.default_rng(0).standard_normal((4000, 1)) ** 2 * scale**2
    root, error = ratio(draws.mean(axis=1))
    assert abs(root - scale) < 4 * error
    assert error == pytest.approx(scale / np.sqrt(2 * 4000), rel=0.1)
