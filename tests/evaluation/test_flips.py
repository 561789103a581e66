"""A flip is a reversal of the axis of rotation, not every rate that crosses zero."""

from dataclasses import replace

import numpy as np
import pytest

from spinfilters.core.torque_free import torque_free_motion
from spinfilters.evaluation.estimated_motion import count_flips, knows_intermediate_axis
from spinfilters.models.body import body_estimate
from spinfilters.models.state_layout import Gaussian
from tests.evaluation.estimate_samples import FULL, sample_factor, sample_point

MOMENTS = np.array([0.6, 0.85, 1.0])


def rates(start: list[float], moments: np.ndarray = MOMENTS, seconds: float = 60.0) -> np.ndarray:
    return torque_free_motion(moments, np.array(start), np.arange(0.0, seconds, 0.05)).rate


def test_a_spin_about_the_intermediate_axis_flips_once_a_half_period() -> None:
    rate = rates([0.02, 3.0, 0.01])
    rate = rate[: 1 + np.flatnonzero(np.abs(rate[:, 1]) > 2.99)[-1]]  # ends on a plateau
    crossings = int(np.count_nonzero(np.diff(np.sign(rate[:, 1]))))
    assert crossings > 2
    assert count_flips(rate) == crossings


@pytest.mark.parametrize("start", [[3.0, 1.0, 0.0], [0.0, 1.0, 3.0], [0.1, 0.2, 3.0]])
def test_a_nutation_about_another_axis_crosses_zero_and_is_no_flip(start: list[float]) -> None:
    rate = rates(start)
    assert np.count_nonzero(np.diff(np.sign(rate[:, 1]))) > 2
    assert count_flips(rate) == 0


def test_a_reversal_that_is_not_complete_is_none() -> None:
    rate = rates([0.02, 3.0, 0.01])
    crossing = int(np.flatnonzero(np.diff(np.sign(rate[:, 1])))[0])
    assert count_flips(rate[: crossing + 2]) == 0


@pytest.mark.parametrize(
    ("moments", "std", "known"),
    [
        ((0.6, 0.85, 1.0), 0.01, True),
        ((0.6, 0.99, 1.0), 0.01, False),
        ((0.84, 0.85, 1.0), 0.01, False),
        ((0.6, 1.0, 1.0), 0.0, False),
        ((0.6, 0.85, 1.0), np.nan, False),
    ],
)
def test_of_moments_that_may_be_equal_no_axis_is_the_intermediate_one(
    moments: tuple[float, float, float], std: float, known: bool
) -> None:
    generator = np.random.default_rng(0)
    factor = sample_factor(generator, FULL.error_dim, 1e-3)
    body = body_estimate(Gaussian(FULL, sample_point(generator), factor))
    covariance = np.diag([std**2, std**2, 0.0])
    body = replace(body, principal_moments=np.array(moments), principal_moments_cov=covariance)
    assert knows_intermediate_axis(body) is known
