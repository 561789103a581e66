"""An iterated update is the most probable state, counts its measurement once, and leaves what is linear alone."""

from functools import partial

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import Measurement
from spinfilters.filters.iterated_update import IteratedUpdate, IterationOptions
from spinfilters.filters.measurement_prediction import linear_rows
from spinfilters.filters.outlier_rejection import RobustOptions
from spinfilters.models.camera_landmarks import StereoLandmark, camera_parameters
from spinfilters.models.feature_tracks import RIG
from spinfilters.models.state_layout import Gaussian
from tests.filters.filter_samples import FULL, PROCESS, START, embedded, started
from tests.filters.linear_samples import linear_belief, linear_process, linear_sensor

STD = np.repeat([0.05, 0.5, 0.02, 0.2, 0.02, 0.3], [3, 3, 3, 3, 3, 5])
"""Of a start that knows the attitude to half a radian."""
PIXEL_STD = 0.3
UNGATED = RobustOptions(gate_probability=1.0)
PLAIN = IterationOptions(iterations=1)


def _transient(seed: int) -> tuple[np.ndarray, Gaussian, Measurement]:
    """True state, a belief with an error drawn from its covariance, and 40 precise stereo observations."""
    generator = np.random.default_rng(seed)
    x = FULL.origin()
    x[2] = 0.6
    belief = Gaussian(FULL, FULL.retract(x, STD * generator.standard_normal(20)), np.diag(STD))
    sensor = StereoLandmark(FULL)
    parameters = camera_parameters(0.1 * generator.standard_normal((40, 3)), RIG.calibration, PIXEL_STD)
    values = sensor.predict(x, parameters) + PIXEL_STD * generator.standard_normal((40, 3))
    return x, belief, Measurement(sensor, values, parameters)


def _nees(seed: int, iteration: IterationOptions) -> float:
    x, belief, measurement = _transient(seed)
    estimator = MultiplicativeEkf(PROCESS, UNGATED, iteration=iteration)
    estimator.start(belief)
    estimator.update(measurement)
    whitened = np.linalg.solve(estimator.belief.factor, FULL.local(estimator.belief.mean, x))
    return float(whitened @ whitened)


def test_from_half_a_radian_away_the_plain_update_is_inconsistent_and_the_iterated_one_is_not() -> None:
    plain, iterated = (
        np.median([_nees(seed, options) for seed in range(12)]) for options in (PLAIN, IterationOptions(8))
    )
    assert plain > 1000
    assert 12 < iterated < 30


def test_the_iterated_update_ends_where_the_objective_is_least() -> None:
    _, belief, measurement = _transient(3)
    rows = linear_rows(measurement, belief.mean)
    estimator = MultiplicativeEkf(PROCESS, UNGATED, iteration=IterationOptions(20, 1e-6))
    estimator.start(belief)
    report = estimator.update(measurement)
    update = IteratedUpdate(FULL, belief.mean, belief.factor, rows)
    y = np.linalg.solve(belief.factor, FULL.local(belief.mean, estimator.belief.mean))
    least = update.objective(y)
    assert report.nis == pytest.approx(least, rel=1e-6)
    for step in 1e-3 * np.eye(20):
        assert update.objective(y + step) > least
        assert update.objective(y - step) > least


def test_values_count_once_however_often_it_iterates() -> None:
    """The covariance stays that of one measurement: another iteration does not shrink it."""
    _, belief, measurement = _transient(1)
    ends = []
    for iterations in (10, 20):
        estimator = MultiplicativeEkf(PROCESS, UNGATED, iteration=IterationOptions(iterations, 1e-9))
        estimator.start(belief)
        estimator.update(measurement)
        ends.append(estimator.belief.std)
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-6)


def test_iterating_a_linear_update_changes_no_bit() -> None:
    ends = []
    for iteration in (PLAIN, IterationOptions(10, 1e-6)):
        generator = np.random.default_rng(1)
        estimator = MultiplicativeEkf(linear_process(generator), UNGATED, iteration=iteration)
        sensor = linear_sensor(3, generator)
        estimator.start(linear_belief(generator))
        for _ in range(5):
            estimator.predict(0.1)
            estimator.update(sensor.measurement(generator.standard_normal((5, 3))))
        ends.append(estimator.belief)
    np.testing.assert_array_equal(ends[0].mean, ends[1].mean)
    np.testing.assert_array_equal(ends[0].factor, ends[1].factor)


def test_in_steady_state_nothing_is_iterated() -> None:
    ends = []
    for iteration in (PLAIN, IterationOptions()):
        estimator = MultiplicativeEkf(PROCESS, iteration=iteration)
        estimator.start(started(0).belief)
        for epoch in embedded(0).timeline[START.epochs : START.epochs + 10]:
            estimator.predict(0.5)
            estimator.update(epoch.measurements[0])
        ends.append(estimator.belief.mean)
    np.testing.assert_array_equal(ends[0], ends[1])


@pytest.mark.parametrize(
    ("build", "text"),
    [
        (partial(IterationOptions, 0), "iterations is 0"),
        (partial(IterationOptions, 2, 0.0), "tolerance is 0.0"),
        (partial(IterationOptions, 2, np.nan), "tolerance"),
    ],
)
def test_an_iteration_option_out_of_range_is_refused(build: partial, text: str) -> None:
    with pytest.raises(InputError, match=text):
        build()
