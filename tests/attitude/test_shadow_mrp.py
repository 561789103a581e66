"""The two MRP of an attitude, on both sides of half a turn, and the covariance carried between them."""

import numpy as np
import pytest
from attitude_samples import vectors
from hypothesis import given

from spinfilters.attitude import conversions as attitude

DIRECTION = np.array([2.0, -1.0, 2.0]) / 3
LENGTHS = [1e-6, 0.5, 4 - 1e-6, 4 - 1e-12, 4.0, 4 + 1e-12, 4 + 1e-6, 4.5, 1e3]


@pytest.mark.parametrize("length", LENGTHS)
def test_the_shadow_is_the_same_attitude(length: float) -> None:
    a = length * DIRECTION
    shadow = attitude.shadow_mrp(a)
    q, p = attitude.quaternion_from_mrp(a), attitude.quaternion_from_mrp(shadow)
    np.testing.assert_allclose(p, -q, atol=4e-16)
    np.testing.assert_allclose(np.linalg.norm(shadow) * length, 16, rtol=1e-15)
    np.testing.assert_allclose(attitude.shadow_mrp(shadow), a, rtol=1e-15)


@pytest.mark.parametrize("length", LENGTHS)
def test_the_short_way_takes_whichever_mrp_is_inside_half_a_turn(length: float) -> None:
    a = length * DIRECTION
    inside = a if length <= 4 else attitude.shadow_mrp(a)
    found = attitude.mrp_from_quaternion(attitude.quaternion_from_mrp(a))
    if length == 4:  # both are on the boundary
        found = found * np.sign(found @ inside)
    np.testing.assert_allclose(found, inside, rtol=1e-15, atol=3e-16)


@given(vectors(3, 6.0).filter(lambda a: np.linalg.norm(a) > 0.1))
def test_the_jacobian_of_the_shadow_is_its_finite_difference(a: np.ndarray) -> None:
    h = 1e-3 * np.linalg.norm(a)
    shifts = h * np.eye(3)[:, np.newaxis] * np.array([-2, -1, 1, 2])[:, np.newaxis]
    far_below, below, above, far_above = np.moveaxis(attitude.shadow_mrp(a + shifts), 1, 0)
    J = ((far_below - 8 * below + 8 * above - far_above) / (12 * h)).T
    P = np.diag([1.0, 2.0, 3.0]) + 0.3
    scale = (16 / (a @ a)) ** 2
    np.testing.assert_allclose(attitude.shadow_mrp_covariance(a, P) / scale, J @ P @ J.T / scale, atol=1e-8)


def test_the_shadow_covariance_is_that_of_shadowed_samples() -> None:
    rng = np.random.default_rng(1)
    factor = 0.01 * np.array([[1.0, 0.0, 0.0], [0.8, 0.5, 0.0], [-0.3, 0.2, 0.7]])
    a, P = 4.2 * DIRECTION, factor @ factor.T
    samples = attitude.shadow_mrp(a + rng.normal(size=(100_000, 3)) @ factor.T)
    predicted = np.linalg.cholesky(attitude.shadow_mrp_covariance(a, P))
    whitened = np.linalg.solve(predicted, (samples - samples.mean(axis=0)).T)
    # 100 000 samples leave 1/sqrt(N) = 0.3 % on an off-diagonal element: five sigma
    np.testing.assert_allclose(np.cov(whitened), np.eye(3), atol=0.023)


def test_the_shadow_covariance_maps_each_item_of_a_batch_and_back() -> None:
    rng = np.random.default_rng(2)
    a, L = rng.normal(size=(2, 3, 3)) + 2, rng.normal(size=(2, 3, 3, 3))
    P = L @ np.swapaxes(L, -1, -2)
    mapped = attitude.shadow_mrp_covariance(a, P)
    np.testing.assert_array_equal(mapped[1, 2], attitude.shadow_mrp_covariance(a[1, 2], P[1, 2]))
    back = attitude.shadow_mrp_covariance(attitude.shadow_mrp(a), mapped)
    np.testing.assert_allclose(back, P, rtol=1e-12, atol=1e-12)
