"""Errors of measurements that are correlated in time, beside disturbances: their likelihood, and when they are found."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from smoothed_motions import motion_near

from spinfilters.inference.identified_noise import Unstated, noise_model
from spinfilters.inference.setup import Setup
from spinfilters.models.process import ProcessNoise
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.measurement_faults import with_gauss_markov_errors
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_map, without_noise
from spinfilters.verdict.model_errors.correlated_errors import (
    CorrelatedErrors,
    ExplainedErrors,
    correlated_errors,
    observation_correlation,
)
from spinfilters.verdict.model_errors.linear_rows import LinearRows
from spinfilters.verdict.model_errors.noise_likelihood import LikelyLevels, LinearMotion, curvature

WHOLE = Settings(process={"gravity": False}, initialisation={"share": 1.0})  # pyright: ignore[reportArgumentType]
STD = {"gyro": np.full(3, 0.005), "pose": np.repeat([0.005, 0.01], 3), "stereo-tracks": np.ones(3)}
EXACT = 1e-9
LEVELS = np.array([[0.3, -0.5, 0.2, np.log(1.7)], [-0.4, 0.8, -0.3, np.log(0.4)]])


@cache
def motion() -> LinearMotion:
    """A state of two numbers, measured in one component, once not at all."""
    generator = np.random.default_rng(3)
    K = 6
    step = np.tile([[1.0, 0.5], [0.0, 1.0]], (K - 1, 1, 1))
    return LinearMotion(
        *(np.full(K - 1, 0.5), step, generator.standard_normal((K - 1, 2))),
        (np.tile(np.diag([0.0, 0.7]), (K - 1, 1, 1)),),
        *(np.array([0.2, -0.1]), np.diag([4.0, 2.0])),
        *(
            np.tile([[1.0, 0.0]], (K, 1, 1)) * (np.arange(K) != 2)[:, None, None],
            generator.standard_normal((K, 1)),
        ),
        *((np.arange(K) != 2)[:, None], ((0,),)),
    )


def dense_log_likelihood(levels: np.ndarray) -> float:
    """Of all values at once, from their covariance."""
    m, (white, lasting, density), tau = motion(), np.exp(levels[:3]), np.exp(levels[3])
    K, noise = len(m.values), np.zeros((len(m.values), 2, len(m.values), 2))
    mean, own = [m.mean], [m.covariance]
    for k in range(K - 1):
        mean.append(m.transition[k] @ mean[-1] + m.shift[k])
        own.append(m.transition[k] @ own[-1] @ m.transition[k].T + density * m.sources[0][k])
    for k in range(K):
        noise[k, :, k] = across = own[k]
        for j in range(k + 1, K):
            across = m.transition[j - 1] @ across
            noise[j, :, k], noise[k, :, j] = across, across.T
    away = 0.5 * np.abs(np.subtract.outer(np.arange(K), np.arange(K)))
    covariance = noise[:, 0, :, 0] + white * np.eye(K) + lasting * np.exp(-away / tau)
    seen = np.flatnonzero(m.measured[:, 0])
    values = m.values[seen, 0] - np.array(mean)[seen, 0]
    normal = multivariate_normal(np.zeros(len(seen)), covariance[np.ix_(seen, seen)])
    return float(normal.logpdf(values)) + len(seen) / 2 * float(np.log(2 * np.pi))


def test_innovations_have_the_likelihood_of_all_values_at_once() -> None:
    z = motion().values * motion().measured
    found = replace(motion(), values=z).innovations(LEVELS).log_likelihood
    assert found == pytest.approx([dense_log_likelihood(each) for each in LEVELS], rel=1e-10)


def test_information_is_that_expected_of_the_gradient() -> None:
    generator, m = np.random.default_rng(0), motion()
    h, at = 1e-4, LEVELS[0]
    rows = np.vstack([at, at + h * np.eye(4)])
    gradients = []
    for _ in range(300):
        x, u = (
            generator.multivariate_normal(m.mean, m.covariance),
            np.exp(at[1] / 2) * generator.standard_normal(),
        )
        z = np.zeros((6, 1))
        for k in range(6):
            if k:
                kept = np.exp(-0.5 / np.exp(at[3]))
                x = m.transition[k - 1] @ x + m.shift[k - 1]
                x[1] += np.sqrt(0.7 * np.exp(at[2])) * generator.standard_normal()
                u = kept * u + np.sqrt((1 - kept**2) * np.exp(at[1])) * generator.standard_normal()
            z[k] = (x[0] + u + np.exp(at[0] / 2) * generator.standard_normal()) * (k != 2)
        gradients.append(
            curvature(replace(m, values=z).innovations(rows), slice(None), np.full(4, h)).gradient
        )
    found = curvature(m.innovations(rows), slice(None), np.full(4, h)).information
    assert np.cov(np.array(gradients).T) == pytest.approx(found, abs=0.3 * np.abs(found).max())


@cache
def prepared(kind: str, correlation: float) -> Setup:
    """With an initialisation that is the smoother of the whole recording, at noise levels of its own."""
    scenario = Scenario.simplified(
        kind=kind,
        principal_moments=(1.0, 0.8, 0.55),
        rate_rpm=RICH_RPM,
        epochs=30 if kind == "stereo-tracks" else 60,
        pixel_std=EXACT,
        position_std=EXACT,
        rotation_std=EXACT,
        gyro_std=EXACT,
        landmarks=40,
        seed=1,
        noise=ProcessNoise(1e-6, 1e-6),
    )
    dataset = simulate(scenario)
    dataset = without_noise(without_map(dataset) if dataset.known_map is not None else dataset)
    return prepare(with_gauss_markov_errors(dataset, STD[kind], correlation, np.random.default_rng(1)), WHOLE)


@cache
def solved(kind: str, correlation: float) -> LinearRows:
    """About the most probable motion."""
    setup = prepared(kind, correlation)
    return motion_near(setup, setup.initial.mean).rows


def found(kind: str, correlation: float) -> CorrelatedErrors | None:
    """Errors that last and would do most."""
    setup, rows = prepared(kind, correlation), solved(kind, correlation)
    model = noise_model(rows.problem, setup.noise, Unstated.of_all(setup.log, setup.process.noise))
    assert model is not None
    return max(correlated_errors(rows, model), key=lambda each: each.expected_nees, default=None)


def explained(kind: str) -> ExplainedErrors:
    """Of white errors."""
    setup, rows = prepared(kind, 0.0), solved(kind, 0.0)
    model = noise_model(rows.problem, setup.noise, Unstated.of_all(setup.log, setup.process.noise))
    assert model is not None
    return ExplainedErrors(rows, model)


@pytest.mark.parametrize("kind", ["gyro", "pose"])
def test_errors_as_stated_have_the_covariance_as_stated(kind: str) -> None:
    errors = explained(kind)
    count = len(errors.model.components)
    levels = np.concatenate(
        [np.zeros(count), np.full(count, -40.0), np.zeros(len(errors.model.densities) + 1)]
    )
    assert errors.relative(levels) == pytest.approx(
        np.tile(np.eye(errors.factors.shape[1]), (60, 1, 1)), abs=1e-5
    )
    assert errors.inflation(levels) == pytest.approx(1.0)


def test_covariances_widen_with_the_probability_of_other_errors_and_never_shrink() -> None:
    errors, information = explained("gyro"), np.diag([4.0, 4.0, 4.0])
    likely = LikelyLevels(np.array([-1.0, 2.0, -18.0, 1.0]), np.array([0, 1, 3]), 0.0)
    wider = [errors.widening(likely, information, p) for p in (3e-4, 0.01, 0.5)]
    sizes = [np.linalg.norm(each, ord=2, axis=(1, 2)) for each in wider]
    assert all(np.linalg.svd(each)[1].min() > 1 - 1e-9 for each in wider)
    assert np.all(sizes[0] <= sizes[1])
    assert np.all(sizes[1] < sizes[2])


def test_what_is_not_known_of_the_levels_widens_covariances() -> None:
    errors, likely = (
        explained("gyro"),
        LikelyLevels(np.array([-1.0, 2.0, -18.0, 1.0]), np.array([0, 1, 3]), 0.0),
    )
    sizes = [np.linalg.norm(errors.widening(likely, by * np.eye(3), 0.1)) for by in (100.0, 1.0)]
    assert sizes[0] < sizes[1]


def test_roots_of_the_last_errors_grow_with_what_is_not_known_of_the_levels() -> None:
    errors = explained("gyro")
    likely = LikelyLevels(np.array([-1.0, 2.0, -18.0, 1.0]), np.array([0, 1, 3]), 0.0)
    roots = errors.last_roots(likely, 4.0 * np.eye(3))
    sizes = np.square(roots).sum(axis=(1, 2))
    assert sizes[0] < sizes[1] < sizes[2]
    assert roots[1] @ roots[1].T == pytest.approx(errors.relative(likely.levels)[-1], rel=1e-9)


def test_correlated_errors_of_poses_are_told_from_disturbances() -> None:
    errors = found("pose", 0.9)
    assert errors is not None
    assert errors.probability > 0.99
    assert errors.inflation > 5
    assert errors.lasting["pose_position_std"] == pytest.approx(0.005, rel=0.5)


def test_white_errors_of_poses_are_no_correlated_ones() -> None:
    errors = found("pose", 0.0)
    assert errors is None or errors.expected_nees < 2


def test_correlated_errors_of_a_gyro_may_be_what_disturbances_seem_to_be() -> None:
    errors = found("gyro", 0.9)
    assert errors is not None
    assert errors.expected_nees > 9


def test_white_errors_of_a_gyro_are_no_correlated_ones() -> None:
    errors = found("gyro", 0.0)
    assert errors is None or errors.expected_nees < 9


@pytest.mark.parametrize(("correlation", "least", "most"), [(0.0, -0.2, 0.1), (0.9, 0.6, 0.95)])
def test_residuals_of_landmarks_are_as_correlated_as_their_errors(
    correlation: float, least: float, most: float
) -> None:
    seen = observation_correlation(solved("stereo-tracks", correlation))
    assert seen is not None
    assert least < seen.value < most
    assert (seen.score > 5) == (correlation > 0)
    assert correlated_errors(solved("stereo-tracks", correlation), None) == []  # pyright: ignore[reportArgumentType]


def test_poses_have_no_landmarks_whose_residuals_could_be_correlated() -> None:
    assert observation_correlation(solved("pose", 0.0)) is None
