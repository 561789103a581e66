"""Noise identified from the data: the score is the likelihood's slope, and levels come out within their deviations."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from spinfilters.filters.noise_levels import ComponentRows
from spinfilters.inference.identification import STAGE, Identified, WorkingSolutions, identify
from spinfilters.inference.noise_model import NoiseModel, residuals_of
from spinfilters.inference.setup import Setup
from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.models.process import ProcessNoise
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_map
from spinfilters.smoother.linear_system import SchurSystem
from spinfilters.smoother.motion_factors import NOISE_FLOOR
from spinfilters.smoother.problem import Problem, problem_of

STATED = {
    "stereo-tracks": {"pixel_std": 2.0},
    "pose": {"pose_position_std": 0.02, "pose_rotation_std": 0.03},
    "gyro": {"gyro_noise_std": 0.006, "gyro_scale_std": 0.0},
}
TRUE = {"pixel_std": 1.0, "pose_position_std": 0.005, "pose_rotation_std": 0.01, "gyro_noise_std": 0.002}


def silent(dataset: Dataset) -> Dataset:
    """The data set without anything that it says of noise."""
    streams = tuple(replace(stream, covariance=None) for stream in dataset.log.streams)
    options = replace(dataset.options, force_psd=None, torque_psd=None, sensor_noise={})
    return replace(dataset, log=MeasurementLog(streams), options=options)


@cache
def case(kind: str, seed: int, noise: ProcessNoise, epochs: int = 60) -> tuple[NoiseModel, Setup]:
    """The first epochs of a simulation with these disturbances, of noise stated too large."""
    dataset = simulate(
        Scenario.simplified(kind=kind, rate_rpm=RICH_RPM, seed=seed, epochs=epochs, interval=0.5, noise=noise)
    )
    dataset = silent(without_map(dataset) if kind == "stereo-tracks" else dataset)
    settings = Settings()
    process = replace(settings.process, force_psd=1e-6, torque_psd=1e-6)
    settings = replace(settings, process=process, sensors=replace(settings.sensors, **STATED[kind]))
    setup = prepare(dataset, settings)
    start, count = setup.initial, len(setup.initial.mean)
    ids = start.ids
    problem = problem_of(setup.process, setup.timeline[:count], ids, start.prior, 2)
    components = {
        "stereo-tracks": (ComponentRows("pixel_std", 2.0, landmarks=True),),
        "pose": (
            ComponentRows("pose_position_std", 0.02, {0: (0, 1, 2)}),
            ComponentRows("pose_rotation_std", 0.03, {0: (3, 4, 5)}),
        ),
        "gyro": (ComponentRows("gyro_noise_std", 0.006, {0: (0, 1, 2)}),),
    }
    densities = ("force_psd", "torque_psd") if setup.process.layout.translates else ("torque_psd",)
    return NoiseModel(problem, components[kind], densities), setup


def first_point(setup: Setup) -> tuple[np.ndarray, np.ndarray]:
    """Trajectory and landmarks of an initialisation."""
    return setup.initial.mean, setup.initial.points


def identified(model: NoiseModel, setup: Setup) -> Identified:
    """What is identified from an initialisation."""
    found = identify(model, *first_point(setup))
    assert found is not None
    return found


def minus_twice_log_likelihood(problem: Problem, trajectory: np.ndarray, points: np.ndarray) -> float:
    """Laplace's, of the linearised problem, up to the measurements' own determinants."""
    here = problem.at(trajectory, points, STAGE.loss)
    normal = problem.normal(here, STAGE)
    solution, fit = normal.solution, normal.eliminated
    assert isinstance(solution, SchurSystem)
    logarithms = [
        np.diag(solution.information_sqrt),
        np.diagonal(solution.tridiagonal.information_sqrts, axis1=1, axis2=2),
    ]
    if fit is not None:
        logarithms.append(np.diagonal(fit.information_sqrt[fit.is_constrained], axis1=1, axis2=2))
    determinant = 2 * sum(float(np.log(part).sum()) for part in logarithms)
    noise = problem.motion.process.linearise_steps(trajectory[:-1], trajectory[1:], problem.motion.dt)[2]
    G = noise[:, problem.ordering.moving]
    Q = G @ np.swapaxes(G, 1, 2) + NOISE_FLOOR**2 * np.eye(G.shape[1])
    return (
        here.cost(normal.used, STAGE)
        - normal.predicted_reduction
        + determinant
        + float(np.linalg.slogdet(Q)[1].sum())
    )


def values_of(model: NoiseModel, which: int, count: int) -> int:
    """Scalar measurements of a component."""
    if which >= len(model.components):
        return 0
    each = model.components[which]
    if each.landmarks:
        return count
    return sum(len(rows) * len(model.problem.motion.sensors[k].values) for k, rows in each.sensors.items())


@pytest.mark.parametrize("kind", list(STATED))
def test_the_score_is_the_slope_of_the_marginal_likelihood(kind: str) -> None:
    model, setup = case(kind, 0, ProcessNoise(1e-6, 1e-5), epochs=40)
    trajectory, points = first_point(setup)
    size = len(model.components) + len(model.densities)
    theta = np.full(size, -0.7)
    problem = model.scaled(theta)
    here = problem.at(trajectory, points, STAGE.loss)
    normal = problem.normal(here, STAGE)
    residuals = residuals_of(problem, here, normal, model.components, model.densities)
    count = 0 if normal.used is None else 3 * int(np.count_nonzero(normal.used))
    for k in range(size):
        step = 1e-4 * np.eye(size)[k]
        slope = [
            minus_twice_log_likelihood(model.scaled(theta + sign * step), trajectory, points)
            for sign in (1, -1)
        ]
        numerical = (slope[0] - slope[1]) / 2e-4 + values_of(model, k, count)
        exact = residuals.redundancy[k] - residuals.squares[k]
        assert numerical == pytest.approx(exact, rel=1e-4, abs=1e-3)


@pytest.mark.parametrize("kind", list(STATED))
def test_the_average_information_is_that_of_the_dense_problem(kind: str) -> None:
    model, setup = case(kind, 0, ProcessNoise(1e-6, 1e-5), epochs=40)
    here = model.problem.at(*first_point(setup), STAGE.loss)
    normal = model.problem.normal(here, STAGE)
    residuals = residuals_of(model.problem, here, normal, model.components, model.densities)
    information = WorkingSolutions(model.problem, here, normal, residuals.sources).information
    assert np.linalg.eigvalsh(information).min() > 0
    total = sum(one.dot(other) for one in residuals.sources for other in residuals.sources)
    # the residuals of the solution are orthogonal to what states explain, save for those of the prior and of the noise floor
    assert 2 * information.sum() == pytest.approx(total, rel=0.02)


@pytest.mark.parametrize(
    ("kind", "noise"),
    [
        ("stereo-tracks", ProcessNoise(1e-8, 2e-5)),
        ("stereo-tracks", ProcessNoise(1e-5, 1e-8)),
        ("pose", ProcessNoise(1e-6, 1e-6)),
        ("pose", ProcessNoise(1e-5, 1e-5)),
        ("gyro", ProcessNoise(1e-6, 1e-5)),
        ("gyro", ProcessNoise(1e-6, 1e-7)),
    ],
)
def test_levels_are_found_within_three_deviations_from_defaults_that_are_far_off(
    kind: str, noise: ProcessNoise
) -> None:
    for seed in range(2):
        found = identified(*case(kind, seed, noise))
        assert found.converged
        for each in found.components:
            true = TRUE.get(each.name) or getattr(noise, each.name)
            away = np.log(each.value / true) * (1 if each.name.endswith("psd") else 2)
            if each.told:
                assert abs(away) < 3 * each.log_std, (each, true)
            assert each.upper > true * np.exp(-1.0 * each.log_std), (each, true)


def test_identification_does_not_depend_on_what_was_stated() -> None:
    model, setup = case("pose", 1, ProcessNoise(1e-6, 1e-6))
    other = replace(model, problem=model.scaled(np.array([1.0, -2.0, 0.5, 3.0])))
    values = [[each.value for each in identified(each, setup).components[2:]] for each in (model, other)]
    np.testing.assert_allclose(values[0], values[1], rtol=0.05)


def test_a_disturbance_that_cannot_be_seen_is_bounded_and_not_zero() -> None:
    found = identified(*case("pose", 2, ProcessNoise(1e-12, 1e-12)))
    for each in found.components[2:]:
        assert not each.told
        assert 0 < each.value < 1e-6


def test_a_density_far_below_what_the_data_see_rises_to_what_they_bound() -> None:
    """It had no information there, and its first step passed for settled: the filter of a throw began over-confident."""
    model, setup = case("pose", 2, ProcessNoise(1e-12, 1e-12))
    count = len(model.components)
    levels = []
    for below in (0.0, -12.0):
        found = identify(model, *first_point(setup), np.r_[np.zeros(count), below, below])
        assert found is not None
        assert found.converged
        levels.append([np.log(each.value) for each in found.components[count:]])
    np.testing.assert_allclose(levels[1], levels[0], atol=1.0)


def test_a_level_that_nothing_is_seen_of_stops_at_its_smallest() -> None:
    """Of measurements without noise, whose residuals are rounding."""
    model, setup = case("gyro", 0, ProcessNoise(1e-6, 1e-12))
    exact = replace(model, components=(replace(model.components[0], smallest=0.05),))
    found = identify(exact, *first_point(setup))
    assert found is not None
    assert found.converged
    assert found.components[0].value == pytest.approx(0.05)


@pytest.mark.parametrize("kind", list(STATED))
def test_states_move_with_a_level_as_the_working_solutions_say(kind: str) -> None:
    model, setup = case(kind, 0, ProcessNoise(1e-6, 1e-5), epochs=40)
    size, step = len(model.components) + len(model.densities), 1e-4
    problem = model.scaled(np.zeros(size))
    here = problem.at(*first_point(setup), STAGE.loss)
    normal = problem.normal(here, STAGE)
    residuals = residuals_of(problem, here, normal, model.components, model.densities)
    found = WorkingSolutions(problem, here, normal, residuals.sources).errors
    for k, expected in enumerate(found):
        ends = [solution_errors(model.scaled(sign * step * np.eye(size)[k]), setup) for sign in (1, -1)]
        moved = (ends[1] - ends[0]) / (2 * step)
        np.testing.assert_allclose(moved, expected, atol=1e-3 * np.abs(expected).max())


def solution_errors(problem: Problem, setup: Setup) -> np.ndarray:
    """Of the linear problem about the initialisation."""
    normal = problem.normal(problem.at(*first_point(setup), STAGE.loss), STAGE)
    assert isinstance(normal.solution, SchurSystem)
    return normal.solution.errors


def test_covariances_widen_by_the_sensitivity_and_what_is_not_known_of_the_levels() -> None:
    found = identified(*case("pose", 1, ProcessNoise(1e-6, 1e-5)))
    factors = np.tile(1e-3 * np.eye(found.sensitivity.shape[2]), (found.sensitivity.shape[1], 1, 1))
    wide = found.widened(factors)
    added = np.einsum("ckn,cd,dkm->knm", found.sensitivity, found.covariance, found.sensitivity)
    np.testing.assert_allclose(wide @ wide.swapaxes(1, 2), factors @ factors + added, rtol=1e-6, atol=1e-12)


def test_a_gyro_s_noise_beside_larger_torque_does_not_drift_to_nothing() -> None:
    model, setup = case("gyro", 0, ProcessNoise(1e-6, 5e-5))
    noise, torque = identified(model, setup).components
    assert noise.upper > 0.002
    assert noise.value > 2e-4
    assert abs(np.log(torque.value / 5e-5)) < 3 * torque.log_std
