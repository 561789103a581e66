"""The backward pass: on a linear model it is the smoother, on a motion it lies between filter and smoother."""

from dataclasses import replace

import numpy as np
import pytest

from spinfilters.core.robust_losses import LeastSquares
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.history import EPOCH_ARRAYS, EstimateHistory
from spinfilters.filters.outlier_rejection import RobustOptions
from spinfilters.filters.rauch_tung_striebel import smooth_backwards
from spinfilters.filters.timeline import Epoch, run
from spinfilters.models.state_layout import Gaussian
from spinfilters.smoother.batch_smoother import smooth_recording
from spinfilters.smoother.priors import FirstStatePrior
from tests.filters.filter_samples import PROCESS, START, embedded, nees, run_on
from tests.filters.linear_samples import LAYOUT, LinearProcess, N, linear_sensor

UNGATED = RobustOptions(gate_probability=1.0)
CONSTANT = LAYOUT.slice("c").start


def _filtered(estimator: MultiplicativeEkf, epochs: tuple[Epoch, ...]) -> EstimateHistory:
    """After every epoch, the first one at the time of the prior."""
    return run(estimator, epochs[0].time, epochs)


@pytest.mark.parametrize("seed", [3, 8])
def test_on_a_linear_model_it_is_the_smoother_to_nine_digits(seed: int) -> None:
    generator = np.random.default_rng(seed)
    A, noise = 0.3 * generator.standard_normal((N, N)), np.zeros((N, 7))
    A[CONSTANT:] = 0.0
    noise[:CONSTANT] = 0.2 * generator.standard_normal((CONSTANT, 7))
    process, sensor = LinearProcess(A, noise), linear_sensor(3, generator)
    time = np.cumsum(0.05 + 0.3 * generator.random(40))
    epochs = tuple(
        Epoch(float(t), (sensor.measurement(generator.standard_normal((1 + k % 2, 3))),))
        for k, t in enumerate(time)
    )
    prior = FirstStatePrior(generator.standard_normal(N), 0.5 + generator.random(N))
    estimator = MultiplicativeEkf(process, robust=UNGATED)
    estimator.start(Gaussian(LAYOUT, prior.mean, prior.factor))
    filtered = _filtered(estimator, epochs)
    backwards = smooth_backwards(process, filtered)
    batch = smooth_recording(process, epochs, filtered.mean, prior, LeastSquares())
    np.testing.assert_allclose(backwards.mean, batch.mean, rtol=1e-9, atol=1e-9)
    covariance = batch.factor @ np.swapaxes(batch.factor, 1, 2)
    np.testing.assert_allclose(backwards.covariance, covariance, rtol=1e-9, atol=1e-9)


def test_on_a_motion_it_is_consistent_and_narrower_than_the_filter() -> None:
    filtered = run_on(MultiplicativeEkf(PROCESS), 1)
    smoothed = smooth_backwards(PROCESS, filtered)
    assert (smoothed.std <= filtered.std * (1 + 1e-9)).all(axis=1).mean() > 0.9
    middle = slice(0, len(filtered.time) // 2)
    assert nees(smoothed, 1)[middle].mean() / smoothed.layout.error_dim < 2.0
    error = [
        np.square(smoothed.layout.local(each.mean, _truth(filtered))[middle, 3:6]).sum()
        for each in (filtered, smoothed)
    ]
    assert error[1] < 0.7 * error[0]


def _truth(history: EstimateHistory) -> np.ndarray:
    return embedded(1).truth[START.epochs :][: len(history.mean)]


def test_one_epoch_stays_as_it_is() -> None:
    filtered = run_on(MultiplicativeEkf(PROCESS), 1)
    one = replace(filtered, **{name: getattr(filtered, name)[:1] for name in EPOCH_ARRAYS})
    assert smooth_backwards(PROCESS, one) is one
