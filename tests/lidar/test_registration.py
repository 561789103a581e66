"""A registered cloud is where it was moved to, within the deviations of its information."""

import numpy as np
import pytest

from spinfilters.core.attitude_conversions import matrix_from_rotation_vector
from spinfilters.lidar.registration import cloud_of, distinct_rows, registered
from spinfilters.lidar.scan_pose import rotation_vector

EYE = np.array([-3.0, 0.0, 0.0])
ROTATION, TRANSLATION = (
    matrix_from_rotation_vector(np.array([0.05, -0.04, 0.06])),
    np.array([0.03, -0.02, 0.01]),
)
STD = 5e-4


def surface(seed: int) -> np.ndarray:
    """Points of a bumpy height field before the lidar, m, with noise."""
    generator = np.random.default_rng(seed)
    y, z = generator.uniform(-1, 1, (2, 4000))
    x = 0.15 * np.sin(3 * y + 1) * np.cos(2.5 * z) + 0.2 * y**2 + 0.1 * z**2
    return np.column_stack([x, y, z]) + STD * generator.standard_normal((4000, 3))


def registration_error() -> tuple[np.ndarray, np.ndarray]:
    """Rotation and translation errors of a cloud that was moved, and the information they should have."""
    target = cloud_of(surface(0), EYE, 3000)
    moved = (surface(1) - TRANSLATION) @ ROTATION
    source = cloud_of(moved, (EYE - TRANSLATION) @ ROTATION, 3000)
    found = registered(source, target, np.eye(3), np.zeros(3), 0.3)
    turned = rotation_vector(found.rotation @ ROTATION.T)
    return np.concatenate([turned, found.translation - TRANSLATION]), found.information


def test_a_registration_is_as_far_off_as_it_says() -> None:
    error, information = registration_error()
    assert np.linalg.norm(error[:3]) < 1e-3
    assert error @ information @ error < 30.0  # six degrees of freedom


def test_clouds_without_noise_keep_their_neighbours() -> None:
    def exact(offset: float) -> np.ndarray:
        y, z = (axis.ravel() for axis in np.meshgrid(*2 * [np.linspace(-1, 1, 45) + offset]))
        return np.column_stack([0.15 * np.sin(3 * y + 1) * np.cos(2.5 * z) + 0.2 * y**2 + 0.1 * z**2, y, z])

    target = cloud_of(exact(0.0), EYE, 3000)
    source = cloud_of((exact(0.02) - TRANSLATION) @ ROTATION, (EYE - TRANSLATION) @ ROTATION, 3000)
    found = registered(source, target, np.eye(3), np.zeros(3), 0.3)
    assert found.overlap > 0.8
    assert np.linalg.norm(rotation_vector(found.rotation @ ROTATION.T)) < 1e-3


@pytest.mark.parametrize("largest", [2, 10**12])
def test_distinct_rows_are_those_of_numpy(largest: int) -> None:
    rows = np.random.default_rng(0).integers(-largest, largest, (200, 3))
    rows = np.concatenate([rows, rows[::7]])
    for some in (rows, rows[:1], rows[:0]):
        found, number = distinct_rows(some)
        expected, same = np.unique(some, axis=0, return_inverse=True)
        np.testing.assert_array_equal(found, expected)
        np.testing.assert_array_equal(number, same.reshape(-1))
