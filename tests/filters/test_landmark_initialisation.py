"""The start with landmarks: exact on exact data, its covariance that of the dense problem, honest over seeds, and robust."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from jaxtyping import Float
from scipy.special import chdtri

from spinfilters.core.errors import InputError
from spinfilters.filters.estimator import LandmarkBelief, Measurement
from spinfilters.filters.shared_modes import LandmarkOptions
from spinfilters.filters.timeline import Epoch
from spinfilters.inference.initial_estimate import (
    InitialEstimate,
    SmoothingOptions,
    initialise,
    smooth_first_epochs,
)
from spinfilters.io.sensor_tables import KnownMap
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.sensor import MotionSamples
from spinfilters.models.sensors.pose import Pose, pose_parameters
from spinfilters.models.state_layout import ROTATION_BLOCKS, StateLayout
from spinfilters.settings.run_settings import InitialisationOptions
from spinfilters.simulation.scenario import Scenario
from spinfilters.smoother.priors import FirstStatePrior
from spinfilters.smoother.problem import InitialGuess
from tests.smoother.smoothing_samples import LAYOUT, PROCESS, Sample
from tests.smoother.smoothing_samples import sample as recorded

TUMBLING = (4.0, 9.0, 3.0)
STD = np.repeat([1e-6, 1.0, 1.0, 1.5], [6, 6, 3, 5])
MOVING = 12


def _prior(sample: Sample) -> FirstStatePrior:
    return FirstStatePrior(sample.truth[0], STD)


def _true(sample: Sample) -> InitialGuess:
    return InitialGuess(sample.truth, sample.known.ids, sample.known.points)


def _smoothed(sample: Sample, trial: InitialGuess, iterations: int = 30) -> InitialEstimate:
    return smooth_first_epochs(PROCESS, sample.epochs, trial, _prior(sample), SmoothingOptions(iterations))


EXACT = Scenario.simplified(
    rate_rpm=TUMBLING, epochs=12, landmarks=150, pixel_std=1e-9, noise=ProcessNoise(0.0, 0.0)
)


def test_exact_data_from_the_true_start_give_zero_error() -> None:
    sample = recorded(EXACT)
    found = _smoothed(sample, _true(sample))
    assert found.converged
    np.testing.assert_allclose(LAYOUT.local(found.mean, sample.truth), 0.0, atol=1e-7)
    known = sample.known.points[np.searchsorted(sample.known.ids, found.ids)]
    np.testing.assert_allclose(found.points, known, atol=1e-7)
    assert found.cost < 1e-9
    assert found.rejected == 0


def test_exact_data_from_a_start_that_is_off_give_the_truth() -> None:
    sample = recorded(EXACT)
    generator = np.random.default_rng(0)
    away = np.repeat([1e-12, 0.1, 0.3, 0.01, 0.7], [6, 3, 3, 3, 5]) * generator.standard_normal(
        (len(sample.truth), 20)
    )
    away[1:, :6] = 0.01 * generator.standard_normal((len(sample.truth) - 1, 6))
    points = sample.known.points + 0.003 * generator.standard_normal(sample.known.points.shape)
    trial = InitialGuess(LAYOUT.retract(sample.truth, away), sample.known.ids, points)
    found = _smoothed(sample, trial)
    assert found.converged
    whitened = np.linalg.solve(found.factor[-1], LAYOUT.local(found.mean[-1], sample.truth[-1]))
    assert np.abs(whitened).max() < 0.01


SMALL = Scenario.simplified(rate_rpm=TUMBLING, epochs=5, landmarks=40, noise=ProcessNoise(0.0, 0.0))


@cache
def _small() -> Sample:
    """Five epochs without disturbance, so that linear models at the truth are exact, and a measured pose in one of them."""
    sample = recorded(SMALL)
    pose = Measurement(Pose(LAYOUT), sample.truth[2:3, :7].copy(), pose_parameters(1e-4 * np.eye(6)[None]))
    epochs = list(sample.epochs)
    epochs[2] = Epoch(epochs[2].time, (*epochs[2].measurements, pose))
    return replace(sample, epochs=tuple(epochs))


@cache
def _dense_covariance() -> tuple[Float[np.ndarray, "N N"], np.ndarray]:
    """Covariance of (moving errors by epoch, constants, landmarks) by finite differences, and the landmarks' ids."""
    sample = _small()
    ids = _linearised().ids
    size = MOVING * len(sample.epochs) + 8 + 3 * len(ids)
    h = 1e-6
    columns = [_residuals(h * e, ids) - _residuals(-h * e, ids) for e in np.eye(size)]
    J = np.stack(columns, axis=1) / (2 * h)
    return np.linalg.inv(J.T @ J), ids


def _residuals(step: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """Everything whitened at the truth; landmarks that are not in ``ids`` say nothing."""
    sample, count = _small(), len(_small().epochs)
    moving, constant = step[: MOVING * count].reshape(count, MOVING), step[MOVING * count :][:8]
    errors = np.concatenate([moving, np.tile(constant, (count, 1))], axis=1)
    points = sample.known.points.copy()
    points[np.searchsorted(sample.known.ids, ids)] += step[MOVING * count + 8 :].reshape(-1, 3)
    x = LAYOUT.retract(sample.truth, errors)
    parts: list[np.ndarray] = [LAYOUT.local(sample.truth[0], x[0]) / STD]
    for k, epoch in enumerate(sample.epochs):
        parts += [_sensor_residual(m, x[k], ids, points) for m in epoch.measurements]
        if k + 1 < count:
            noise = PROCESS.linearise(sample.truth[k], 0.5)[2][:MOVING]
            defect = LAYOUT.local(PROCESS.step(x[k], 0.5), x[k + 1])[:MOVING]
            parts.append(np.linalg.solve(np.linalg.cholesky(noise @ noise.T), defect))
    return np.concatenate(parts)


def _sensor_residual(
    measurement: Measurement, x: np.ndarray, ids: np.ndarray, points: np.ndarray
) -> np.ndarray:
    if measurement.ids is None:
        return measurement.model.linearise(x, measurement.parameters, measurement.values).innovation.reshape(
            -1
        )
    keep = np.isin(measurement.ids, ids)
    parameters = measurement.parameters[keep].copy()
    parameters[:, :3] = points[measurement.ids[keep]]
    return (measurement.values[keep] - measurement.model.predict(x, parameters)).reshape(-1)


@cache
def _linearised() -> InitialEstimate:
    return _smoothed(_small(), _true(_small()), iterations=0)


def _scaled(P: np.ndarray, reference: np.ndarray) -> np.ndarray:
    std = np.sqrt(np.diag(reference))
    return P / std / std[:, None]


def test_a_linearisation_at_the_truth_has_the_covariance_of_the_dense_problem() -> None:
    dense, _ = _dense_covariance()
    found = _linearised()
    np.testing.assert_array_equal(found.mean, _small().truth)
    for k, factor in enumerate(found.factor):
        first = MOVING * len(found.mean)
        rows = np.r_[MOVING * k : MOVING * (k + 1), first : first + 8]
        expected = dense[np.ix_(rows, rows)]
        np.testing.assert_allclose(
            _scaled(factor @ factor.T, expected), _scaled(expected, expected), atol=2e-5
        )
        assert not np.triu(factor, 1).any()


def test_the_joint_belief_is_that_of_the_dense_problem() -> None:
    """Of the state exactly; of landmarks but for what modes that are left out share with the frame g."""
    dense, ids = _dense_covariance()
    count = len(_small().epochs)
    belief = _linearised().joint_belief(LandmarkOptions())
    assert isinstance(belief, LandmarkBelief)
    first = MOVING * count + 8
    factor = belief.joint_factor()
    state = np.arange(MOVING * (count - 1), first)
    expected = dense[np.ix_(state, state)]
    np.testing.assert_allclose(
        _scaled((factor @ factor.T)[:20, :20], expected), _scaled(expected, expected), atol=2e-5
    )
    std, found = np.sqrt(np.diag(dense)[first:]), np.sqrt(np.square(factor[20:]).sum(axis=1))
    np.testing.assert_allclose(found, std, rtol=0.2)
    np.testing.assert_array_equal(belief.ids, ids)
    np.testing.assert_array_equal(belief.points, _small().known.points[ids])


def test_with_enough_modes_landmarks_and_state_are_as_correlated_as_in_the_dense_problem() -> None:
    dense, _ = _dense_covariance()
    count = len(_small().epochs)
    belief = _linearised().joint_belief(LandmarkOptions(modes=60, explained=0.0))
    assert isinstance(belief, LandmarkBelief)
    factor = belief.joint_factor()
    rows = np.arange(MOVING * (count - 1), len(dense))
    expected = dense[np.ix_(rows, rows)]
    np.testing.assert_allclose(_scaled(factor @ factor.T, expected), _scaled(expected, expected), atol=2e-5)


def test_counts_are_of_the_observations_in_use() -> None:
    sample, found = _small(), _linearised()
    every = np.concatenate(
        [m.ids for epoch in sample.epochs for m in epoch.measurements if m.ids is not None]
    )
    used = np.concatenate(found.used)
    np.testing.assert_array_equal(found.counts, np.bincount(every[used], minlength=40)[found.ids])
    assert found.dof == 3 * used.sum() - 3 * len(found.ids) + 6


def _started(sample: Sample, seed: int) -> InitialEstimate:
    """A start from poses and a map that are wrong by as much as perception's, in the true frame g."""
    generator = np.random.default_rng(seed)
    poses = StateLayout(("t", "a"))
    off = np.repeat([0.003, 0.02], 3) * generator.standard_normal((len(sample.truth), 6))
    off[0] = 0.0
    seen = poses.retract(sample.truth[:, :7], off)
    rates = sample.truth[:, LAYOUT.mean_slice("w")] + 0.03 * generator.standard_normal((len(seen), 3))
    time = np.array([epoch.time for epoch in sample.epochs])
    points = sample.known.points + 0.005 * generator.standard_normal(sample.known.points.shape)
    options = InitialisationOptions(epochs=len(seen), share=1.0)
    known = KnownMap(sample.known.ids, points)
    samples = MotionSamples(time, seen[:, 3:], rates, seen[:, :3], known)
    return initialise(PROCESS, sample.epochs, samples, options)


def _nees(report: InitialEstimate, sample: Sample) -> float:
    error = LAYOUT.local(report.belief.mean, sample.truth[-1])
    return float(np.square(np.linalg.solve(report.belief.factor, error)).sum())


SEEDS = range(6)


def _runs(seeds: range, pixel_std: float = 1.0, wrong: float = 0.0) -> tuple[list[InitialEstimate], float]:
    scenarios = [
        Scenario.simplified(rate_rpm=TUMBLING, epochs=36, landmarks=300, seed=seed) for seed in seeds
    ]
    samples = [recorded(scenario, wrong, pixel_std) for scenario in scenarios]
    reports = [_started(sample, seed) for seed, sample in zip(seeds, samples, strict=True)]
    return reports, sum(_nees(report, sample) for report, sample in zip(reports, samples, strict=True))


BAND = chdtri(20 * len(SEEDS), 0.995), chdtri(20 * len(SEEDS), 0.005)


def test_the_covariance_is_honest_over_seeds() -> None:
    reports, total = _runs(SEEDS)
    assert BAND[0] < total < BAND[1]
    for report in reports:
        assert report.converged
        assert report.fit == pytest.approx(1.0, abs=5 / np.sqrt(2 * report.dof))
        assert report.rejected <= 2


def test_a_pixel_noise_that_is_half_the_true_one_shows() -> None:
    seeds = range(3)
    assert _runs(seeds, pixel_std=0.5)[1] > chdtri(20 * len(seeds), 0.005)


def test_a_start_with_a_third_of_the_ids_swapped_is_as_honest() -> None:
    reports, total = _runs(SEEDS, wrong=0.3)
    assert BAND[0] < total < BAND[1]
    for report in reports:
        assert report.converged
        assert report.rejected > 0.1 * sum(len(used) for used in report.used)
        assert report.fit == pytest.approx(1.0, abs=0.06)


def test_values_that_are_not_finite_are_reported_and_not_raised() -> None:
    sample = _small()
    trajectory = sample.truth.copy()
    trajectory[:, LAYOUT.mean_slice("w")] = np.nan
    found = _smoothed(sample, replace(_true(sample), trajectory=trajectory))
    assert not found.converged
    assert not np.isfinite(found.factor).any()


def _no_place() -> None:
    rotation = StateLayout(ROTATION_BLOCKS)
    process = TorqueFreeProcess(rotation, ProcessNoise())
    prior = FirstStatePrior(rotation.origin(), np.ones(rotation.error_dim))
    trial = InitialGuess(np.tile(rotation.origin(), (5, 1)), _small().known.ids, _small().known.points)
    smooth_first_epochs(process, _small().epochs, trial, prior, SmoothingOptions())


@pytest.mark.parametrize(
    ("attempt", "complaint"),
    [
        (lambda: _smoothed(_small(), replace(_true(_small()), ids=np.arange(40) + 10_000)), "seen twice"),
        (_no_place, "blocks t, a"),
    ],
)
def test_misuse_says_what_is_wrong(attempt: Callable[[], object], complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        attempt()
