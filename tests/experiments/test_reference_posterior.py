"""The long chain that judges the sampled posterior: draws of whole motions, and their exact density."""

import numpy as np
import pytest

from experiments.reference_posterior import ExactSampler, integrated_draw
from spinfilters.campaigns.calibration_draws import drawn_scenario
from spinfilters.inference.smoother_run import smoothed_problem
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import simulate
from spinfilters.smoother.problem import Problem

FEW = 12
"""Samples, each of which solves the motion."""


@pytest.fixture(scope="module")
def solved() -> tuple[Problem, np.ndarray]:
    """Problem of a gyro's recording, and its solution."""
    setup = prepare(simulate(drawn_scenario("gyro", 1)), Settings())
    problem, smoothed = smoothed_problem(setup, Settings())
    return problem, smoothed.mean


def test_a_draw_without_errors_is_the_trajectory(solved: tuple[Problem, np.ndarray]) -> None:
    problem, mean = solved
    drawn = integrated_draw(problem, mean, np.zeros((len(mean), problem.layout.error_dim)))
    np.testing.assert_allclose(drawn, mean, atol=1e-6)


def test_the_exact_density_of_a_gyros_motion_is_laplaces(solved: tuple[Problem, np.ndarray]) -> None:
    problem, mean = solved
    sampler = ExactSampler(problem, 1)
    node = sampler.node(mean)
    assert node is not None
    sampler.corrections.clear()
    assert sampler.sample([node], FEW, 1) is not None
    assert len(sampler.corrections) == FEW
    assert np.std(sampler.corrections) < 0.2
