"""Moving the frame g changes no observation and no motion, and its directions are exactly those."""

import numpy as np
import pytest

from spinfilters.models.camera_landmarks import StereoLandmark, camera_parameters
from spinfilters.models.gauge import gauge_directions, gauge_of_points
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_blocks import BLOCKS
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout

LAYOUT = StateLayout(FULL_BLOCKS)
CALIBRATION = np.array([466.7, 466.7, 320.0, 240.0, 0.09])


def state(seed):
    generator = np.random.default_rng(seed)
    x = LAYOUT.retract(LAYOUT.origin(), 0.5 * generator.standard_normal(20))
    x[2] += 3.0
    return x


@pytest.mark.parametrize("seed", range(4))
def test_the_motion_carries_gauge_directions_into_gauge_directions(seed):
    process = TorqueFreeProcess(LAYOUT, ProcessNoise(), 1e-12)
    x = state(seed)
    after, transition, _ = process.linearise(x, 0.7)
    np.testing.assert_allclose(
        transition @ gauge_directions(LAYOUT, x), gauge_directions(LAYOUT, after), atol=1e-10
    )


@pytest.mark.parametrize("seed", range(4))
def test_every_block_moves_with_g_so_that_the_motion_stays_the_same(seed):
    layout = StateLayout(tuple(BLOCKS))
    process, generator = TorqueFreeProcess(layout, ProcessNoise(), 1e-12), np.random.default_rng(seed)
    x = layout.retract(layout.origin(), 0.5 * generator.standard_normal(layout.error_dim))
    after, transition, _ = process.linearise(x, 0.3)
    np.testing.assert_allclose(
        transition @ gauge_directions(layout, x), gauge_directions(layout, after), atol=1e-9
    )


def test_the_bias_of_a_gyro_turns_with_g_as_the_rate_does():
    layout = StateLayout(tuple(BLOCKS))
    x = layout.origin()
    x[layout.mean_slice("w")] = x[layout.mean_slice("b")] = [0.1, -0.2, 0.3]
    directions = gauge_directions(layout, x)
    np.testing.assert_allclose(directions[layout.slice("b")], directions[layout.slice("w")], atol=1e-15)
    assert np.abs(directions[layout.slice("b")]).max() > 0.1


@pytest.mark.parametrize("seed", range(4))
def test_no_observation_sees_a_gauge_direction(seed):
    sensor, x = StereoLandmark(LAYOUT), state(seed)
    points = 0.2 * np.random.default_rng(seed).standard_normal((5, 3))
    at = sensor.linearise_landmarks(x, camera_parameters(points, CALIBRATION, 1.0), np.zeros((5, 3)))
    seen = at.jacobian @ gauge_directions(LAYOUT, x)[sensor.columns]
    seen = seen + at.by_landmark @ gauge_of_points(points).reshape(-1, 3, 6)
    assert np.abs(seen).max() < 1e-10 * np.abs(at.jacobian).max()
    assert np.abs(at.jacobian @ gauge_directions(LAYOUT, x)[sensor.columns]).max() > 1  # alone they are seen
