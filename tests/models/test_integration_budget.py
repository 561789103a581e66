"""The integrator's budget: a step that it cannot resolve ends at once, and does not make others expensive."""

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.rotation_integrator import IntegrationError
from spinfilters.models.state_layout import FULL_BLOCKS, ROTATION_BLOCKS, StateLayout
from tests.models.process_samples import random_point

PROCESS = TorqueFreeProcess(StateLayout(FULL_BLOCKS), ProcessNoise(), tolerance=1e-8)
POINT = random_point(PROCESS.layout, 1.2, np.random.default_rng(1))


@pytest.mark.parametrize("dt", [1e4, 1e6, 1e300])
def test_a_step_that_no_budget_resolves_is_refused(dt: float) -> None:
    for advance in (PROCESS.step, PROCESS.linearise):
        with pytest.raises(IntegrationError, match="16384 substeps"):
            advance(POINT, dt)


def test_a_tolerance_below_rounding_is_refused_rather_than_sought() -> None:
    process = TorqueFreeProcess(StateLayout(ROTATION_BLOCKS), ProcessNoise(), tolerance=1e-300)
    with pytest.raises(IntegrationError, match="1e-300"):
        process.step(random_point(process.layout, 1.0, np.random.default_rng(2)), 0.1)


def test_steps_side_by_side_beyond_the_budget_are_not_finite_and_the_others_as_without_them() -> None:
    points, dt = np.tile(POINT, (4, 1)), np.array([0.5, 0.5, 1e6, 0.5])
    found = PROCESS.linearise_steps(points, points, dt)
    alone = PROCESS.linearise_steps(points[:2], points[:2], dt[:2])
    for part, expected in zip(found, alone, strict=True):
        assert np.isnan(part[2]).all()
        np.testing.assert_array_equal(part[[0, 1]], expected)
        np.testing.assert_array_equal(part[3], expected[0])


def test_a_long_turn_among_short_ones_is_as_by_itself() -> None:
    points, dt = np.tile(POINT, (4, 1)), np.array([0.5, 0.5, 30.0, 0.5])
    found = PROCESS.linearise_steps(points, points, dt)
    alone = PROCESS.linearise_steps(points[2:3], points[2:3], dt[2:3])
    for part, expected in zip(found, alone, strict=True):
        np.testing.assert_array_equal(part[2:3], expected)


def test_a_motion_that_is_too_much_to_integrate_is_refused_before_it_begins() -> None:
    time, rates = np.arange(5.0), np.tile([0.3, 1.0, 0.2], (5, 1))
    PROCESS.require_steps(time, rates)
    with pytest.raises(InputError, match=r"turns .* times from t = 2 s to 1000000 s"):
        PROCESS.require_steps(np.array([0.0, 1.0, 2.0, 1e6]), rates[:4])
    with pytest.raises(InputError, match="cut the recording"):
        PROCESS.require_steps(np.arange(200) * 100.0, np.tile([0.3, 1.0, 0.2], (200, 1)))


@pytest.mark.parametrize("rate", [1e160, 1e305, 1.5e308])
def test_a_rate_whose_square_is_beyond_all_numbers_is_refused_without_a_warning(rate: float) -> None:
    fast, slice_w = POINT.copy(), PROCESS.layout.mean_slice("w")
    fast[slice_w] = [rate, 0.0, rate / 2]
    for advance in (PROCESS.step, PROCESS.linearise):
        with pytest.raises(IntegrationError, match="turns the body"):
            advance(fast, 0.5)
    with pytest.raises(IntegrationError, match="turns the body"):
        PROCESS.step(np.stack([POINT, fast]), 0.5)
    assert np.isnan(PROCESS.linearise_steps(fast[None], fast[None], np.array([0.5]))[0]).all()
    with pytest.raises(InputError, match="too far to be followed"):
        PROCESS.require_steps(np.arange(3.0), np.tile(fast[slice_w], (3, 1)))
