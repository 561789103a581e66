"""The start: inertia in closed form from exact motion, and convergence from every kind of data."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.special import chdtri

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.errors import InputError
from spinfilters.core.mass_distribution import inertia_matrix
from spinfilters.core.robust_losses import LeastSquares
from spinfilters.evaluation.consistency import true_states
from spinfilters.filters.timeline import SensorNoise, build_timeline
from spinfilters.inference.initial_estimate import InitialEstimate, guessed_trajectory, initialise
from spinfilters.io.dataset import Dataset
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.sensor import MotionSamples, pose_samples
from spinfilters.models.state_blocks import DRAG
from spinfilters.models.state_layout import ROTATION_BLOCKS, StateLayout
from spinfilters.settings.run_settings import InitialisationOptions
from spinfilters.simulation.scenario import Scenario, simulate
from spinfilters.smoother.batch_smoother import AnnealedSchedule
from spinfilters.smoother.closed_form import InitialMotion, fit_momentum, initial_motion, initial_state
from spinfilters.smoother.problem import Stage, problem_of, with_common_constants
from spinfilters.smoother.solver import ConstantSchedule, SolverOptions, solve
from tests.filters.filter_samples import FULL, PROCESS, START, embedded, started

ROTATION = StateLayout(ROTATION_BLOCKS)
DRAGGED = StateLayout((*ROTATION_BLOCKS, "d"))
TUMBLING = (3.0, 10.0, 4.0)
"""rpm: far from every principal axis, so that half a minute tells the whole inertia."""


def _exact_motion(layout: StateLayout, seed: int, drag: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Times and points of a random body that tumbles without noise."""
    generator = np.random.default_rng(seed)
    process = TorqueFreeProcess(layout, ProcessNoise(), tolerance=1e-12)
    x = layout.retract(layout.origin(), 0.4 * generator.standard_normal(layout.error_dim))
    x[layout.mean_slice("w")] = generator.uniform(0.5, 1.5, 3) * generator.choice([-1, 1], 3)
    if "d" in layout.blocks:
        x[layout.mean_slice("d")] = drag
    points = [x]
    for _ in range(59):
        points.append(process.step(points[-1], 0.3))
    return 0.3 * np.arange(60), np.array(points)


def _scaled(J: np.ndarray) -> np.ndarray:
    return 2 * J / np.trace(J)


@pytest.mark.parametrize("seed", range(8))
def test_conserved_momentum_gives_the_inertia_of_any_body(seed: int) -> None:
    time, points = _exact_motion(ROTATION, seed)
    rotations = matrix_from_quaternion(points[:, ROTATION.mean_slice("a")])
    fit = fit_momentum(rotations, points[:, ROTATION.mean_slice("w")], time, None)
    expected = _scaled(inertia_matrix(points[0, ROTATION.mean_slice("s")]))
    np.testing.assert_allclose(fit.inertia, expected, atol=1e-7)
    assert fit.residual < 1e-7
    assert fit.drag == 0.0


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("drag", [0.0, 0.01, 0.05])
def test_a_momentum_that_decays_gives_inertia_and_drag(seed: int, drag: float) -> None:
    time, points = _exact_motion(DRAGGED, seed, drag)
    rotations = matrix_from_quaternion(points[:, DRAGGED.mean_slice("a")])
    fit = fit_momentum(rotations, points[:, DRAGGED.mean_slice("w")], time, DRAG)
    assert fit.drag == pytest.approx(drag, abs=1e-3)
    expected = _scaled(inertia_matrix(points[0, DRAGGED.mean_slice("s")]))
    np.testing.assert_allclose(fit.inertia, expected, atol=0.02)


def test_the_closed_form_finds_centre_of_mass_and_velocity_of_an_exact_motion() -> None:
    process = TorqueFreeProcess(FULL, ProcessNoise(), tolerance=1e-12)
    points = [embedded(0).truth[0]]
    for _ in range(40):
        points.append(process.step(points[-1], 0.5))
    truth = np.array(points)
    blocks = (truth[:, FULL.mean_slice(block)] for block in ("a", "w", "t"))
    x, residual = initial_state(FULL, InitialMotion(0.5 * np.arange(41), *blocks))
    for block in ("t", "v", "c"):
        np.testing.assert_allclose(x[FULL.mean_slice(block)], truth[0, FULL.mean_slice(block)], atol=1e-9)
    assert residual < 1e-7  # the root of j'Gj, which rounding leaves at some 1e-16


def _poses(dataset: Dataset) -> MotionSamples:
    return pose_samples(dataset.log.stream("pose"))


def _surprise(report: InitialEstimate, truth: np.ndarray) -> float:
    """Squared error in the covariance over what 999 of 1000 runs stay below; residuals are of the noise's size."""
    assert report.fit == pytest.approx(1.0, abs=5 / np.sqrt(report.dof))
    error = report.layout.local(report.belief.mean, truth)
    whitened = np.linalg.solve(report.belief.factor, error)
    return float(whitened @ whitened) / chdtri(len(error), 1e-3)


@pytest.mark.parametrize("seed", range(3))
def test_a_start_from_stereo_converges_to_the_truth(seed: int) -> None:
    report = started(seed)
    assert report.converged
    assert _surprise(report, embedded(seed).truth[START.epochs - 1]) < 1


@pytest.mark.parametrize("seed", range(3))
def test_a_start_from_poses_converges_to_the_truth(seed: int) -> None:
    dataset = simulate(Scenario.simplified(kind="pose", rate_rpm=TUMBLING, seed=seed))
    assert dataset.truth is not None
    timeline = build_timeline(dataset.log, FULL, SensorNoise())
    report = initialise(PROCESS, timeline, _poses(dataset), START)
    assert report.converged
    assert _surprise(report, true_states(dataset.truth, FULL)[START.epochs - 1]) < 1


@pytest.mark.parametrize("seed", range(3))
def test_a_start_from_a_gyro_converges_to_the_truth(seed: int) -> None:
    scenario = Scenario.simplified(kind="gyro", rate_rpm=TUMBLING, interval=0.1, epochs=120, seed=seed)
    dataset = simulate(scenario)
    assert dataset.truth is not None
    process = TorqueFreeProcess(ROTATION, ProcessNoise())
    timeline = build_timeline(dataset.log, ROTATION, SensorNoise(gyro_noise_std=scenario.gyro_std))
    gyro = dataset.log.stream("gyro")
    report = initialise(process, timeline, MotionSamples(gyro.time, rates=gyro.values), START)
    assert report.converged
    assert _surprise(report, true_states(dataset.truth, ROTATION)[START.epochs - 1]) < 1


@pytest.mark.parametrize("seed", [1, 2])
def test_a_start_that_hardly_tells_the_body_ends_in_the_likeliest_of_its_optima(seed: int) -> None:
    dataset = simulate(Scenario.simplified(kind="pose", seed=seed))
    timeline = build_timeline(dataset.log, FULL, SensorNoise())
    options = InitialisationOptions(epochs=60)
    evidence = initial_motion(_poses(dataset), 60)
    report = initialise(PROCESS, timeline, _poses(dataset), options)
    assert report.converged
    first = initial_state(FULL, evidence)[0]
    trajectory = guessed_trajectory(FULL, timeline[:60], first, evidence)
    problem = problem_of(PROCESS, timeline[:60], np.zeros(0, dtype=int), report.prior, 2)
    others = []
    for schedule in (ConstantSchedule(), AnnealedSchedule(problem, 40)):
        here = problem.at(with_common_constants(FULL, trajectory), np.zeros((0, 3)))
        others.append(solve(problem, here, SolverOptions(), schedule).point.cost(None, Stage(LeastSquares())))
    assert max(others) - min(others) > 1  # this case has two
    assert report.cost <= min(others) + 0.02  # within what a settled iteration leaves open


def _still(count: int) -> InitialMotion:
    return InitialMotion(
        np.arange(float(count)), np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)), np.zeros((count, 3))
    )


def _too_short() -> None:
    embedded_evidence = _still(3)
    initial_state(ROTATION, embedded_evidence)


def _not_turning() -> None:
    initial_state(ROTATION, _still(20))


def _too_few_poses() -> None:
    initial_motion(_poses(simulate(Scenario.simplified(kind="pose", epochs=3))), 60)


def _too_slow_a_camera() -> None:
    initial_motion(_poses(simulate(Scenario.simplified(kind="pose", interval=2.8, epochs=20))), 60)


@pytest.mark.parametrize(
    ("attempt", "complaint"),
    [
        (_too_short, "at least 4 epochs"),
        (_not_turning, "does not rotate"),
        (_too_few_poses, "at least 4 epochs"),
        (_too_slow_a_camera, "faster frame rate"),
    ],
)
def test_a_start_without_enough_motion_says_so(attempt: Callable[[], None], complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        attempt()


@pytest.mark.parametrize("name", ["epochs", "duration", "mass_std", "drag_std"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_an_option_that_is_not_positive_is_refused(name: str, value: float) -> None:
    with pytest.raises(InputError, match=f"initialisation.{name}"):
        InitialisationOptions(**{name: value})  # pyright: ignore[reportArgumentType]
