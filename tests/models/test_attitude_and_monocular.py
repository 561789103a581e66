"""The attitude sensor and the single camera keep the contract of sensors and agree with the ones they are parts of."""

import numpy as np
import pytest

from spinfilters.core.cameras import NEAREST_DEPTH
from spinfilters.models.camera_landmarks import MonocularLandmark, StereoLandmark, camera_parameters
from spinfilters.models.sensors.attitude import Attitude, attitude_parameters
from spinfilters.models.state_layout import FULL_BLOCKS, ROTATION_BLOCKS, StateLayout
from tests.models.sensor_contract import check_sensor_contract

FULL, POSE_ONLY = StateLayout(FULL_BLOCKS), StateLayout(("t", "a"))
CALIBRATION = np.array([466.7, 470.0, 320.0, 240.0])


def _point(layout: StateLayout, seed: int) -> np.ndarray:
    x = layout.retract(layout.origin(), 0.3 * np.random.default_rng(seed).standard_normal(layout.error_dim))
    if "t" in layout.blocks:
        x[layout.mean_slice("t")] = [0.02, -0.03, 0.6]
    return x


@pytest.mark.parametrize(
    "layout", [StateLayout(ROTATION_BLOCKS), FULL, POSE_ONLY], ids=lambda layout: "".join(layout.blocks)
)
@pytest.mark.parametrize("seed", [0, 1])
def test_an_attitude_keeps_the_contract(layout: StateLayout, seed: int) -> None:
    roots = 0.01 * np.random.default_rng(1).standard_normal((5, 3, 3))
    parameters = attitude_parameters(roots @ np.swapaxes(roots, 1, 2) + 1e-5 * np.eye(3))
    check_sensor_contract(Attitude(layout), _point(layout, seed), parameters)


@pytest.mark.parametrize("layout", [FULL, POSE_ONLY], ids=lambda layout: "".join(layout.blocks))
@pytest.mark.parametrize("seed", [0, 1])
def test_a_single_camera_keeps_the_contract(layout: StateLayout, seed: int) -> None:
    points = 0.1 * np.random.default_rng(2).uniform(-1, 1, (5, 3))
    check_sensor_contract(
        MonocularLandmark(layout), _point(layout, seed), camera_parameters(points, CALIBRATION, 0.8)
    )


def test_a_single_camera_is_the_left_one_of_the_stereo_pair() -> None:
    x, points = _point(FULL, 3), 0.1 * np.random.default_rng(2).uniform(-1, 1, (5, 3))
    left = MonocularLandmark(FULL).predict(x, camera_parameters(points, CALIBRATION, 1.0))
    pair = StereoLandmark(FULL).predict(x, camera_parameters(points, np.append(CALIBRATION, 0.09), 1.0))
    np.testing.assert_array_equal(left, pair[:, :2])


@pytest.mark.parametrize(("depth", "valid"), [(2 * NEAREST_DEPTH, True), (0.0, False), (-0.5, False)])
def test_a_landmark_behind_the_single_camera_is_not_valid_and_stays_finite(depth: float, valid: bool) -> None:
    parameters = camera_parameters(np.array([[0.1, 0.2, depth]]), CALIBRATION, 1.0)
    about = MonocularLandmark(POSE_ONLY).linearise(POSE_ONLY.origin(), parameters, np.zeros((1, 2)))
    assert about.valid[0] == valid
    assert np.isfinite(about.jacobian).all()
