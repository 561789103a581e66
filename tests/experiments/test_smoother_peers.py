"""The peers of the smoother's benchmark solve the same problem: their rows are ours, and so is their optimum."""

from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from experiments.benchmarks.ceres_peer import ceres_batch, ceres_library
from experiments.benchmarks.gtsam_chart import constants_key, gtsam, pose_key, rates_key
from experiments.benchmarks.gtsam_graph import MotionFactors, whole_graph
from experiments.benchmarks.gtsam_incremental import fixed_lag, isam2, resolved_every_frame
from experiments.benchmarks.gtsam_peer import chart_of, dogleg, levenberg_marquardt, linear_times
from experiments.benchmarks.motion_rows import MOVING, POSE, prior_rows, step_rows
from experiments.benchmarks.scipy_peer import WhitenedProblem, scipy_least_squares
from experiments.benchmarks.smoother_workload import Workload, simulated_workload, whitened_cost
from experiments.benchmarks.stacked_errors import StackedErrors
from spinfilters.inference.initial_estimate import SmoothingOptions, smooth_first_epochs
from spinfilters.simulation.scenario import RICH_RPM, Scenario

NO_GATE = 1e3
"""Standard deviations: the peers believe every observation."""
needs_gtsam = pytest.mark.skipif(gtsam is None, reason="the optional peer GTSAM is not installed")


@cache
def workload() -> Workload:
    """Eight frames of a rich motion with a few landmarks."""
    return simulated_workload(Scenario.simplified(rate_rpm=RICH_RPM, epochs=8, landmarks=60, seed=3))


@cache
def own_optimum() -> tuple[np.ndarray, np.ndarray]:
    """Trajectory and points of the project's batch smoother."""
    problem = workload()
    options = SmoothingOptions(gate=NO_GATE)
    found = smooth_first_epochs(problem.process, problem.timeline, problem.trial, problem.prior, options)
    assert found.converged
    assert np.array_equal(found.ids, problem.trial.ids)
    return found.mean, found.points


def displaced() -> tuple[np.ndarray, np.ndarray]:
    """A trajectory and points near the optimum, so that defects are not zero, with common constants."""
    generator = np.random.default_rng(0)
    trajectory, points = own_optimum()
    stacked = StackedErrors(workload().layout, len(trajectory))
    errors = stacked.errors(1e-4 * generator.standard_normal(stacked.size))
    moved = workload().layout.retract(trajectory, errors)
    return moved, points + 1e-4 * generator.standard_normal(points.shape)


def test_rows_of_the_motion_have_the_gram_matrices_of_the_project() -> None:
    problem, (trajectory, _) = workload(), displaced()
    motion = problem.problem().motion
    n = problem.layout.error_dim
    of_prior = prior_rows(problem.layout, trajectory[0], problem.prior)
    check_gram(motion.measurements(trajectory).epochs[0], of_prior, np.arange(n))
    here, there, constant = np.arange(MOVING), n + np.arange(MOVING), np.arange(MOVING, n)
    expected = motion.dynamics(trajectory).steps
    for k, (before, after) in enumerate(pairwise(problem.timeline)):
        found = step_rows(problem.process, trajectory[k], trajectory[k + 1], after.time - before.time)
        check_gram(expected[k], found, np.concatenate([here, there, constant]))


def check_gram(expected: np.ndarray, found: tuple[np.ndarray, np.ndarray], order: np.ndarray) -> None:
    """Of rows [J | -residual] with their columns in this order."""
    residual, by_error = found
    rows = np.column_stack([by_error[:, order], -residual])
    np.testing.assert_allclose(rows.T @ rows, expected, atol=1e-9 * np.abs(expected).max())


def test_scipy_reaches_the_cost_of_the_project() -> None:
    problem = workload()
    expected = whitened_cost(problem, *own_optimum())
    assert scipy_least_squares(problem).cost == pytest.approx(expected, abs=0.05)


def test_scipy_is_given_the_derivative_of_its_residuals() -> None:
    """But for the covariance's own dependence on the state and the bend of a chart over a defect, both of a defect's order."""
    problem, h = WhitenedProblem(workload()), 1e-7
    generator = np.random.default_rng(1)
    at, along = np.zeros((2, problem.size))
    at += 1e-4 * generator.standard_normal(problem.size)
    along += generator.standard_normal(problem.size)
    expected = problem.jacobian(at) @ along
    numeric = (problem.residuals(at + h * along) - problem.residuals(at - h * along)) / (2 * h)
    np.testing.assert_allclose(expected, numeric, atol=2e-3 * np.abs(numeric).max())


@needs_gtsam
def test_factors_of_gtsam_have_the_cost_of_the_project() -> None:
    problem, (trajectory, points) = workload(), displaced()
    chart = chart_of(problem)
    graph = whole_graph(problem, MotionFactors(problem, chart))
    cost = 2 * graph.error(chart.values(trajectory, points))
    assert cost == pytest.approx(whitened_cost(problem, trajectory, points), rel=1e-9)


@needs_gtsam
def test_factors_of_gtsam_have_the_derivatives_of_their_residuals() -> None:
    """At a motion that obeys its dynamics, where whitening is differentiated by nobody."""
    problem = workload()
    chart = chart_of(problem)
    factors = MotionFactors(problem, chart)
    trajectory, _ = own_optimum()
    trajectory = trajectory.copy()
    for k, (here, there) in enumerate(pairwise(problem.timeline)):
        trajectory[k + 1] = problem.process.step(trajectory[k], there.time - here.time)
    values = chart.values(trajectory, np.zeros((0, 3)))
    keys = [pose_key(2), rates_key(2), pose_key(3), rates_key(3), constants_key()]
    check_derivatives(factors.step(2), values, keys)
    check_derivatives(factors.prior(), values, [pose_key(0), rates_key(0), constants_key()])


def check_derivatives(factor: Any, values: Any, keys: list[int]) -> None:
    """Of a factor with unit noise, against differences along every tangent direction of every variable."""
    analytic, h = factor.linearize(values).jacobian()[0], 1e-6
    sizes = [8 if key == constants_key() else 6 for key in keys]
    columns = []
    for key, size in zip(keys, sizes, strict=True):
        for direction in h * np.eye(size):
            ends = []
            for sign in (1.0, -1.0):
                step = gtsam.VectorValues()
                step.insert(key, sign * direction)
                ends.append(factor.unwhitenedError(values.retract(step)))
            columns.append((ends[0] - ends[1]) / (2 * h))
    numeric = np.array(columns).T
    scale = np.abs(numeric).max(axis=1, keepdims=True)
    np.testing.assert_allclose(analytic / scale, numeric / scale, atol=2e-6)


@needs_gtsam
@pytest.mark.parametrize("peer", [levenberg_marquardt, dogleg, resolved_every_frame])
def test_batches_of_gtsam_reach_the_cost_of_the_project(peer: Any) -> None:
    problem = workload()
    result = peer(problem)
    assert result.cost == pytest.approx(whitened_cost(problem, *own_optimum()), abs=0.05)
    assert 0 < result.python < result.seconds


@needs_gtsam
def test_isam2_comes_near_the_optimum() -> None:
    problem, (trajectory, _) = workload(), own_optimum()
    found = isam2(problem, 1e-3)
    assert found.cost > whitened_cost(problem, *own_optimum()) - 0.05
    errors = problem.layout.local(trajectory, found.trajectory)
    np.testing.assert_allclose(errors[:, :POSE], 0.0, atol=0.02)


@needs_gtsam
def test_a_window_as_long_as_the_recording_is_isam2() -> None:
    problem = workload()
    whole, window = isam2(problem), fixed_lag(problem, len(problem.timeline))
    np.testing.assert_allclose(window.trajectory, whole.trajectory, atol=1e-6)


@needs_gtsam
def test_iterations_of_gtsam_are_timed_in_every_ordering() -> None:
    times = linear_times(workload(), (4, 8), repeats=1)
    assert [time.epochs for time in times] == [4, 4, 4, 8, 8, 8]
    assert all(0 < time.python < time.linearise < time.total for time in times)


@pytest.mark.skipif(ceres_library() is None, reason="the optional peer Ceres is not installed")
def test_ceres_ends_at_the_optimum_of_the_project() -> None:
    problem, (trajectory, points) = workload(), own_optimum()
    found = ceres_batch(problem)
    assert found.cost == pytest.approx(whitened_cost(problem, trajectory, points), rel=1e-4)
    assert np.abs(found.points - points).max() < 1e-3
