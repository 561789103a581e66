"""Memory that the evaluation of a long gyro recording takes."""

import tracemalloc
from collections.abc import Callable

import numpy as np
import pytest

from spinfilters.core.attitude_conversions import multiply, quaternion_from_rotation_vector, rotate
from spinfilters.evaluation.consistency import true_states
from spinfilters.evaluation.epoch_spans import own_span, second_half
from spinfilters.evaluation.estimator_evaluation import Evaluation, evaluate
from spinfilters.evaluation.stated_errors import stated_errors
from spinfilters.evaluation.trajectory_errors import Alignment
from spinfilters.models.state_layout import ROTATION_BLOCKS, StateLayout
from tests.evaluation.estimate_samples import history_of, sample_truth

LAYOUT = StateLayout(ROTATION_BLOCKS)
EPOCHS = 40_000
STRETCH_BYTES = 3e6
"""Room for what is computed in stretches of epochs."""
NUMBER = 8.0
"""Bytes of a double."""


@pytest.fixture(scope="module")
def gyro() -> Evaluation:
    """An estimate of rotation alone whose frame i is turned against that of its truth."""
    truth = sample_truth(np.random.default_rng(3), EPOCHS)
    turn = quaternion_from_rotation_vector(np.array([0.3, -1.1, 0.4]))
    mean = true_states(truth, LAYOUT)
    mean[:, LAYOUT.mean_slice("a")] = multiply(turn, truth.q_ig)
    factor = np.broadcast_to(1e-6 * np.eye(LAYOUT.error_dim), (EPOCHS, LAYOUT.error_dim, LAYOUT.error_dim))
    return evaluate(history_of(mean, factor, LAYOUT), truth, Alignment.FIRST_FRAME)


def test_errors_are_those_in_the_turned_frame(gyro: Evaluation) -> None:
    assert gyro.errors is not None
    assert gyro.truth is not None
    turned = gyro.truth_in_own_frames
    assert turned is not None
    np.testing.assert_allclose(gyro.errors.attitude, 0.0, atol=1e-12)
    turn = quaternion_from_rotation_vector(np.array([0.3, -1.1, 0.4]))
    np.testing.assert_allclose(turned.rate_i, rotate(turn, gyro.truth.rate_i), atol=1e-12)
    rows = np.array([7, 11])
    some = gyro.truth_in_own_frames_at(rows)
    assert some is not None
    np.testing.assert_array_equal(some.q_ig, turned.q_ig[rows])
    np.testing.assert_array_equal(some.rate_i, turned.rate_i[rows])


@pytest.mark.parametrize(
    ("of", "numbers"),
    [
        pytest.param(stated_errors, 12, id="the last epoch alone"),
        pytest.param(lambda each: own_span(each).errors, 1, id="own epochs"),
        pytest.param(lambda each: second_half(each).errors, 1, id="second half"),
        pytest.param(lambda each: each.rotation_nees, 12, id="NEES of rotation"),
    ],
)
def test_evaluation_takes_few_numbers_of_an_epoch(
    gyro: Evaluation, of: Callable[[Evaluation], object], numbers: float
) -> None:
    of(gyro)  # what is made once
    gyro.__dict__.pop("rotation_nees", None)
    tracemalloc.start()
    try:
        of(gyro)
        assert tracemalloc.get_traced_memory()[1] < numbers * NUMBER * EPOCHS + STRETCH_BYTES
    finally:
        tracemalloc.stop()
