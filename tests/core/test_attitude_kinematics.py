"""Every parametrisation agrees with every other, and its rate with differences of a motion whose rate is known."""

from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spinfilters.core import attitude_conversions as conversions
from spinfilters.core.attitude_kinematics import (
    PARAMETRISATIONS,
    body_rate,
    convert,
    inertial_acceleration,
    parameter_rate,
    rate_from_attitudes,
)
from spinfilters.core.errors import InputError, ShapeError
from spinfilters.core.torque_free import torque_free_motion

NAMES = [each.name for each in PARAMETRISATIONS]


def unit_rows(q: np.ndarray) -> np.ndarray:
    """Rows of norm one."""
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


ATTITUDES = unit_rows(np.random.default_rng(5).normal(size=(40, 4)))
RATES = np.random.default_rng(8).normal(size=(40, 3))


def moved(dt: float) -> np.ndarray:
    """Attitudes after dt seconds at the constant body rates."""
    return conversions.multiply(ATTITUDES, conversions.quaternion_from_rotation_vector(RATES * dt))


@pytest.mark.parametrize(("source", "target"), list(product(NAMES, NAMES)))
def test_there_and_back_is_the_same_attitude(source: str, target: str) -> None:
    given = convert(ATTITUDES, "quaternion", source)
    back = convert(convert(given, source, target), target, "quaternion")
    assert conversions.angle_between(back, ATTITUDES).max() < 1e-14


def test_numbers_are_those_of_an_independent_library() -> None:
    rotation = Rotation.from_quat(ATTITUDES)
    np.testing.assert_allclose(convert(ATTITUDES, "quaternion", "matrix"), rotation.as_matrix(), atol=1e-14)
    np.testing.assert_allclose(convert(ATTITUDES, "quaternion", "mrp"), rotation.as_mrp(), atol=1e-14)
    np.testing.assert_allclose(
        convert(ATTITUDES, "quaternion", "rotation-vector"), rotation.as_rotvec(), atol=1e-14
    )
    np.testing.assert_allclose(
        convert(ATTITUDES, "quaternion", "euler321"), rotation.as_euler("ZYX"), atol=1e-13
    )


@pytest.mark.parametrize("name", NAMES)
def test_the_rate_is_the_derivative_along_a_known_motion(name: str) -> None:
    h = 1e-3
    # signs of quaternions and the short way round change nowhere in these steps but in a few samples, which are left out
    steps = [convert(moved(k * h), "quaternion", name) for k in (-2, -1, 1, 2)]
    slope = (steps[0] - 8 * steps[1] + 8 * steps[2] - steps[3]) / (12 * h)
    found = parameter_rate(convert(ATTITUDES, "quaternion", name), RATES, name)
    scale = 1.0 + np.abs(slope)
    continuous = np.abs(steps[3] - steps[0]).reshape(40, -1).max(axis=-1) < 1.0
    assert continuous.sum() > 30
    assert (np.abs(found - slope) / scale)[continuous].max() < 1e-6


@pytest.mark.parametrize("name", NAMES)
def test_the_body_rate_comes_back_from_the_rate(name: str) -> None:
    numbers = convert(ATTITUDES, "quaternion", name)
    np.testing.assert_allclose(
        body_rate(numbers, parameter_rate(numbers, RATES, name), name), RATES, atol=1e-11
    )


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-6, 0.999e-3, 1.001e-3, 3.1])
def test_rotation_vectors_of_all_lengths_have_a_rate(angle: float) -> None:
    r = angle * np.array([0.6, 0.0, 0.8])
    w = np.array([0.3, -0.2, 0.5])
    mrp = convert(r, "rotation-vector", "mrp4")
    np.testing.assert_allclose(
        body_rate(r, parameter_rate(r, w, "rotation-vector"), "rotation-vector"), w, atol=1e-13
    )
    np.testing.assert_allclose(body_rate(mrp, parameter_rate(mrp, w, "mrp4"), "mrp4"), w, atol=1e-13)


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
@pytest.mark.parametrize("away", [0.0, 1e-15, 1e-12, 1e-9, 1e-6])
def test_gimbal_lock_keeps_the_attitude(pitch: float, away: float) -> None:
    yaw, roll = np.meshgrid(np.linspace(-3.1, 3.1, 9), np.linspace(-3, 3, 7))
    angles = np.stack([yaw, np.full_like(yaw, pitch - np.sign(pitch) * away), roll], axis=-1)
    q = conversions.quaternion_from_euler321(angles)
    found = conversions.euler321_from_quaternion(q)
    assert np.max(conversions.angle_between(conversions.quaternion_from_euler321(found), q)) < 4e-15
    np.testing.assert_allclose(found[..., 1], angles[..., 1], atol=2e-15)
    if away == 0.0:
        np.testing.assert_array_equal(found[..., 2], 0.0)


def test_where_numbers_have_no_rate_the_error_says_what_to_use() -> None:
    with pytest.raises(InputError, match="pitch of"):
        parameter_rate(np.array([0.0, np.pi / 2, 0.0]), np.ones(3), "euler321")
    with pytest.raises(InputError, match="angle of 0"):
        parameter_rate(np.array([1.0, 0.0, 0.0, 0.0]), np.ones(3), "axis-angle")
    with pytest.raises(InputError, match="whole turn"):
        parameter_rate(np.array([2 * np.pi, 0.0, 0.0]), np.ones(3), "rotation-vector")


def test_unknown_names_and_wrong_shapes_are_refused() -> None:
    with pytest.raises(InputError, match="rotation-vector"):
        convert(np.ones(3), "rodrigues", "mrp")
    with pytest.raises(ShapeError, match="mrp4"):
        convert(np.ones(4), "mrp4", "mrp")
    with pytest.raises(InputError, match="unit norm"):
        convert(np.ones(4), "quaternion", "mrp")
    with pytest.raises(InputError, match="NaN"):
        parameter_rate(np.zeros(3), np.array([0.0, np.nan, 0.0]), "mrp")


def test_differences_of_a_motion_give_its_rate_at_the_middle_of_the_intervals() -> None:
    moments, rate = np.array([1.0, 0.8, 0.5]), np.array([0.4, 1.0, 0.3])
    time = np.linspace(0.0, 10.0, 2001)
    motion = torque_free_motion(moments, rate, time)
    signs = np.where(np.arange(len(time)) % 3 == 0, -1.0, 1.0)[:, np.newaxis]
    middle, found = rate_from_attitudes(time, signs * motion.attitude)
    expected = torque_free_motion(moments, rate, middle).rate
    assert np.abs(found - expected).max() < 1e-5
    with pytest.raises(InputError, match="does not exceed"):
        rate_from_attitudes(time[::-1], motion.attitude)


def test_a_point_at_rest_accelerates_in_no_turning_frame() -> None:
    """A point fixed in space, seen from a body that turns at a changing rate."""
    w, dw = np.array([0.2, -0.4, 0.9]), np.array([0.05, 0.1, -0.3])
    r = np.array([1.0, 2.0, -0.5])
    v = -np.cross(w, r)
    a = -np.cross(dw, r) - np.cross(w, v)
    total, terms = inertial_acceleration(r, v, a, w, dw)
    np.testing.assert_allclose(total, 0.0, atol=1e-15)
    np.testing.assert_allclose(terms["coriolis"], 2 * np.cross(w, v))
