"""On a linear model every estimator, filterpy's included, is the textbook's Kalman filter."""

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from spinfilters.filters.baselines import FilterpyEkf, FilterpyUkf
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import Estimator, ProcessModel
from spinfilters.filters.filter import MultiplicativeFilter
from spinfilters.filters.outlier_rejection import RobustOptions
from spinfilters.filters.ukf import MultiplicativeUkf
from spinfilters.models.state_layout import Gaussian
from tests.filters.linear_samples import (
    LinearProcess,
    N,
    linear_belief,
    linear_process,
    linear_sensor,
    log_density,
)

UNGATED = RobustOptions(gate_probability=1.0)
"""The values here are drawn from no model: a gate would rightly refuse them."""
ESTIMATORS = (
    partial(MultiplicativeEkf, robust=UNGATED),
    partial(MultiplicativeUkf, robust=UNGATED),
    FilterpyEkf,
    FilterpyUkf,
)
Build = Callable[[ProcessModel], Estimator]


def _textbook(process: LinearProcess, belief: Gaussian) -> KalmanFilter:
    kalman = KalmanFilter(dim_x=N, dim_z=1)
    kalman.x, kalman.P = belief.mean.copy(), belief.covariance
    kalman.F, kalman.Q = process.transition(0.1), 0.1 * process.noise @ process.noise.T
    return kalman


@pytest.mark.parametrize("build", ESTIMATORS)
@pytest.mark.parametrize(("size", "count"), [(1, 1), (2, 1), (3, 5)])
def test_mean_covariance_and_likelihood_are_those_of_the_textbook_over_fifty_steps(
    build: Build, size: int, count: int
) -> None:
    generator = np.random.default_rng(size)
    process, belief = linear_process(generator), linear_belief(generator)
    sensor = linear_sensor(size, generator)
    estimator, kalman = build(process), _textbook(process, belief)
    estimator.start(belief)
    H, R = np.tile(sensor.H, (count, 1)), np.kron(np.eye(count), sensor.noise @ sensor.noise.T)
    tolerance = (
        1e-10 if isinstance(estimator, MultiplicativeFilter) else 1e-8
    )  # filterpy's UKF subtracts K S K'
    for _ in range(50):
        values = 3 * generator.standard_normal((count, size))
        estimator.predict(0.1)
        kalman.predict()
        report = estimator.update(sensor.measurement(values))
        kalman.update(values.reshape(-1), R=R, H=H)
        np.testing.assert_allclose(estimator.belief.mean, kalman.x, rtol=tolerance, atol=tolerance)
        np.testing.assert_allclose(estimator.belief.covariance, kalman.P, rtol=tolerance, atol=tolerance)
        assert (report.accepted, report.rejected, report.dof) == (count, 0, count * size)
        assert report.nis == pytest.approx(kalman.y @ np.linalg.solve(kalman.S, kalman.y), rel=1e-8)
        expected = log_density(kalman.y, kalman.S)
        assert report.log_likelihood == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("build", ESTIMATORS)
def test_two_sensors_at_one_stamp_may_come_in_either_order(build: Build) -> None:
    generator = np.random.default_rng(4)
    process, belief = linear_process(generator), linear_belief(generator)
    pair = [
        linear_sensor(size, generator).measurement(generator.standard_normal((2, size))) for size in (2, 3)
    ]
    ends, likelihoods = [], []
    for order in (pair, pair[::-1]):
        estimator = build(process)
        estimator.start(belief)
        estimator.predict(0.1)
        likelihoods.append(sum(estimator.update(measurement).log_likelihood for measurement in order))
        ends.append(estimator.belief)
    np.testing.assert_allclose(ends[0].mean, ends[1].mean, atol=1e-11)
    np.testing.assert_allclose(ends[0].covariance, ends[1].covariance, atol=1e-11)
    assert likelihoods[0] == pytest.approx(likelihoods[1], rel=1e-10)


@pytest.mark.parametrize("build", ESTIMATORS)
def test_values_given_together_or_one_after_the_other_come_to_the_same(build: Build) -> None:
    generator = np.random.default_rng(5)
    process, belief = linear_process(generator), linear_belief(generator)
    sensor, values = linear_sensor(2, generator), generator.standard_normal((6, 2))
    smallest_batch, apart = build(process), build(process)
    smallest_batch.start(belief)
    apart.start(belief)
    whole = smallest_batch.update(sensor.measurement(values))
    parts = [apart.update(sensor.measurement(row[np.newaxis])) for row in values]
    np.testing.assert_allclose(smallest_batch.belief.mean, apart.belief.mean, atol=1e-11)
    np.testing.assert_allclose(smallest_batch.belief.covariance, apart.belief.covariance, atol=1e-11)
    assert whole.log_likelihood == pytest.approx(sum(p.log_likelihood for p in parts), rel=1e-10)
