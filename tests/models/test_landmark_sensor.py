"""A sensor that sees landmarks: its derivative by them, and its inverse."""

import numpy as np
import pytest

from spinfilters.models.camera_landmarks import StereoLandmark, camera_parameters
from spinfilters.models.state_layout import StateLayout

LAYOUT = StateLayout(("t", "a"))
SENSOR = StereoLandmark(LAYOUT)
CALIBRATION = np.array([466.7, 460.0, 320.0, 240.0, 0.09])
STEP = 1e-6


@pytest.fixture
def scene():
    generator = np.random.default_rng(5)
    x = LAYOUT.retract(np.array([0.02, -0.01, 0.7, 0, 0, 0, 1.0]), generator.standard_normal(6) * 0.3)
    return x, camera_parameters(0.1 * generator.standard_normal((6, 3)), CALIBRATION, 1.3)


def test_derivative_by_the_landmark_is_the_finite_difference(scene):
    x, parameters = scene
    measured = SENSOR.predict(x, parameters)
    by_landmark = SENSOR.linearise_landmarks(x, parameters, measured).by_landmark
    for k in range(3):
        there, back = parameters.copy(), parameters.copy()
        there[:, k] += STEP
        back[:, k] -= STEP
        slope = (SENSOR.predict(x, there) - SENSOR.predict(x, back)) / (2 * STEP)
        np.testing.assert_allclose(1.3 * by_landmark[:, :, k], slope, atol=1e-4)


def test_a_new_landmark_is_where_the_observation_says_and_moves_as_its_derivative_says(scene):
    x, parameters = scene
    measured = SENSOR.predict(x, parameters)
    found = SENSOR.new_landmarks(x, parameters, measured)
    np.testing.assert_allclose(found.points, parameters[:, :3], atol=1e-12)
    assert found.determined.all()
    for k in range(6):
        d = STEP * np.eye(6)[k]
        ahead = SENSOR.new_landmarks(LAYOUT.retract(x, d), parameters, measured).points
        behind = SENSOR.new_landmarks(LAYOUT.retract(x, -d), parameters, measured).points
        np.testing.assert_allclose(found.jacobian[:, :, k], (ahead - behind) / (2 * STEP), atol=1e-8)


def test_the_noise_of_a_new_landmark_is_that_of_its_pixels(scene):
    x, parameters = scene
    measured = SENSOR.predict(x, parameters)
    root = SENSOR.new_landmarks(x, parameters, measured).root
    by_landmark = SENSOR.linearise_landmarks(x, parameters, measured).by_landmark
    seen = by_landmark @ root
    np.testing.assert_allclose(seen @ seen.transpose(0, 2, 1), np.tile(np.eye(3), (6, 1, 1)), atol=1e-9)
    assert not np.triu(root, 1).any()


def test_a_landmark_at_infinity_is_not_determined(scene):
    x, parameters = scene
    far = np.array([[300.0, 200.0, 299.0], [300.0, 200.0, 301.0], [300.0, 200.0, 200.0]])
    found = SENSOR.new_landmarks(x, parameters[:3], far)
    assert found.determined.tolist() == [False, False, True]
    assert np.isfinite(found.points).all()
