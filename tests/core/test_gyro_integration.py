"""Gyro logs integrated: exact turns, order of convergence, irregular stamps, and the chain of products."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from spinfilters.core import attitude_conversions as attitude
from spinfilters.core.errors import InputError, ShapeError
from tests.core.attitude_samples import random_quaternions

START = random_quaternions()


def _coning_rate(time: np.ndarray) -> np.ndarray:
    return np.stack([2 * np.cos(3 * time), 1.5 * np.sin(3 * time), 0.5 + 0.4 * time], axis=-1)


def _exact_attitude(until: float) -> np.ndarray:
    def derivative(time: float, q: np.ndarray) -> np.ndarray:
        w, v, s = _coning_rate(np.array(time)), q[:3], q[3]
        return np.append(s * w + np.cross(v, w), -w @ v) / 2

    return solve_ivp(derivative, (0, until), START, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]


def test_a_constant_rate_is_exact_at_irregular_stamps() -> None:
    time = np.cumsum(np.random.default_rng(0).uniform(1e-3, 0.3, 500))
    w = np.array([3.0, -2.0, 1.0])
    found = attitude.integrate_gyro(time, np.tile(w, (500, 1)), START)
    turn = attitude.quaternion_from_rotation_vector(w * (time - time[0])[:, np.newaxis])
    assert np.max(attitude.angle_between(found, attitude.multiply(START, turn))) < 1e-12


@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_the_linear_rate_between_stamps_is_integrated_to_fourth_order(jitter: float) -> None:
    nodes = np.linspace(0, 2, 9)  # the true rate is linear between these
    draws = np.random.default_rng(4).uniform(-jitter, jitter, 16)

    def error(parts: int) -> float:
        inner = (np.arange(parts) + draws[:parts] * (np.arange(parts) > 0)) / parts
        time = np.append((nodes[:-1, np.newaxis] + inner * np.diff(nodes)[:, np.newaxis]).ravel(), nodes[-1])
        rate = np.stack([np.interp(time, nodes, axis) for axis in _coning_rate(nodes).T], axis=-1)
        return float(attitude.angle_between(attitude.integrate_gyro(time, rate, START)[-1], exact))

    fine = np.linspace(0, 2, 8 * 512 + 1)
    rate = np.stack([np.interp(fine, nodes, axis) for axis in _coning_rate(nodes).T], axis=-1)
    exact = attitude.integrate_gyro(fine, rate, START)[-1]
    assert error(16) < 2e-7
    assert error(4) / error(16) > 4**3.5


def test_a_smooth_rate_is_integrated_to_second_order_of_its_sampling() -> None:
    exact = _exact_attitude(2.0)

    def error(count: int) -> float:
        time = np.linspace(0, 2, count + 1)
        return float(
            attitude.angle_between(attitude.integrate_gyro(time, _coning_rate(time), START)[-1], exact)
        )

    assert error(2000) < 2e-6
    assert 3.9 < error(200) / error(400) < 4.1


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7, 16, 33])
def test_the_chain_by_pairs_is_the_chain_one_by_one(count: int) -> None:
    time = np.arange(count) * 0.01
    found = attitude.integrate_gyro(time, _coning_rate(time), START)
    one_by_one = START
    for k in range(count):
        if k:
            one_by_one = attitude.integrate_gyro(
                time[k - 1 : k + 1], _coning_rate(time[k - 1 : k + 1]), one_by_one
            )[1]
        np.testing.assert_allclose(found[k], one_by_one, atol=1e-15)


def test_a_long_log_keeps_unit_norm_and_sign() -> None:
    time = np.arange(100_000) * 0.01
    q = attitude.integrate_gyro(time, _coning_rate(time % 50), START)
    np.testing.assert_allclose(np.linalg.norm(q, axis=-1), 1, atol=1e-15)
    np.testing.assert_array_equal(attitude.continuous_quaternions(q), q)


def test_stamps_that_go_back_are_named() -> None:
    with pytest.raises(InputError, match=r"time step\[1\] = 0.0 s is not positive"):
        attitude.integrate_gyro(np.array([0.0, 1.0, 1.0]), np.zeros((3, 3)), START)
    with pytest.raises(InputError, match=r"rate\[2, 0\] = nan"):
        attitude.integrate_gyro(np.arange(3.0), np.array([[0.0] * 3, [0.0] * 3, [np.nan, 0, 0]]), START)


@pytest.mark.parametrize(
    ("stamps", "rates", "start"), [(0, 0, (4,)), (3, 2, (4,)), (3, 3, (3,)), (3, 3, (3, 4))]
)
def test_a_log_of_the_wrong_shape_is_refused(stamps: int, rates: int, start: tuple[int, ...]) -> None:
    with pytest.raises(ShapeError):
        attitude.integrate_gyro(np.arange(float(stamps)), np.zeros((rates, 3)), np.ones(start) / 2)
