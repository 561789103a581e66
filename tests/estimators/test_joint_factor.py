"""Each step of the joint factor against the dense textbook formula for the covariance that it is the root of."""

import numpy as np
import pytest

from spinfilters.estimators.landmarks.joint_factor import (
    after_correction,
    corrected,
    corrected_state,
    extended,
    moved,
    propagated,
    reduced,
)

STATE, LANDMARKS = 5, 4
SIZE = STATE + 3 * LANDMARKS
PRECISION = pytest.mark.parametrize(
    ("dtype", "tolerance"), [(np.float64, 1e-12), (np.float32, 3e-5)], ids=["float64", "float32"]
)


@pytest.fixture
def generator():
    return np.random.default_rng(3)


def lower(generator, size=SIZE, dtype=np.float64):
    return np.tril(generator.standard_normal((size, size))).astype(dtype)


def covariance(factor):
    return factor.astype(float) @ factor.T.astype(float)


def is_lower(factor):
    return not np.triu(factor, 1).any()


@PRECISION
def test_prediction_is_the_textbook_covariance_and_leaves_the_landmarks_alone(generator, dtype, tolerance):
    factor = lower(generator, dtype=dtype)
    Phi, G = generator.standard_normal((STATE, STATE)), generator.standard_normal((STATE, 3))
    after = propagated(factor, Phi @ factor[:STATE, :STATE], G)
    whole, noise = np.eye(SIZE), np.zeros((SIZE, SIZE))
    whole[:STATE, :STATE], noise[:STATE, :STATE] = Phi, G @ G.T
    expected = whole @ covariance(factor) @ whole.T + noise
    assert is_lower(after)
    assert after.dtype == dtype
    np.testing.assert_allclose(covariance(after), expected, atol=tolerance * np.abs(expected).max())


@PRECISION
def test_correction_is_the_textbook_update(generator, dtype, tolerance):
    factor = lower(generator, dtype=dtype)
    H = np.zeros((3 * LANDMARKS, SIZE))
    seen = [0, 2, 3]  # one landmark is not seen
    for k in seen:
        H[3 * k : 3 * k + 3, :STATE] = generator.standard_normal((3, STATE))
        H[3 * k : 3 * k + 3, STATE + 3 * k : STATE + 3 * k + 3] = np.tril(generator.standard_normal((3, 3)))
    Y = (H @ factor.astype(float)).astype(dtype)
    rho = generator.standard_normal(3 * LANDMARKS).astype(dtype)
    rho[3:6] = 0
    found = corrected(np.tril(Y, STATE), rho)
    P = covariance(factor)
    S = np.eye(len(H)) + H @ P @ H.T
    K = P @ H.T @ np.linalg.inv(S)
    scale = np.abs(P).max()
    after = after_correction(factor, found)
    assert is_lower(after)
    np.testing.assert_allclose(factor @ found.coordinates, K @ rho, atol=tolerance * scale)
    np.testing.assert_allclose(covariance(after), P - K @ S @ K.T, atol=tolerance * scale)
    assert found.nis == pytest.approx(rho @ np.linalg.solve(S, rho), rel=100 * tolerance)
    assert found.log_root == pytest.approx(np.linalg.slogdet(S)[1] / 2, rel=100 * tolerance)


def test_a_sensor_that_sees_the_state_alone_corrects_the_landmarks_too(generator):
    factor = lower(generator)
    H, rho = generator.standard_normal((7, STATE)), generator.standard_normal(7)
    found = corrected_state(H @ factor[:STATE, :STATE], rho)
    P, whole = covariance(factor), np.concatenate([H, np.zeros((7, SIZE - STATE))], axis=1)
    K = P @ whole.T @ np.linalg.inv(np.eye(7) + whole @ P @ whole.T)
    np.testing.assert_allclose(factor[:, :STATE] @ found.coordinates, K @ rho, atol=1e-12)
    np.testing.assert_allclose(covariance(after_correction(factor, found)), P - K @ whole @ P, atol=1e-12)


def test_moving_the_point_changes_the_coordinates_of_the_errors(generator):
    factor = lower(generator)
    A, B = generator.standard_normal((STATE, STATE)), generator.standard_normal((SIZE - STATE, STATE))
    whole = np.eye(SIZE)
    whole[:STATE, :STATE], whole[STATE:, :STATE] = A, B
    after = moved(factor, A, B)
    assert is_lower(after)
    np.testing.assert_allclose(covariance(after), whole @ covariance(factor) @ whole.T, atol=1e-11)


def test_new_landmarks_keep_their_correlation_with_everything(generator):
    factor = lower(generator)
    J, own = generator.standard_normal((6, STATE)), np.stack([lower(generator, 3), lower(generator, 3)])
    after = extended(factor, J @ factor[:STATE, :STATE], own)
    P = covariance(factor)
    assert is_lower(after)
    np.testing.assert_allclose(covariance(after)[:SIZE, SIZE:], P[:, :STATE] @ J.T, atol=1e-12)
    own_noise = np.zeros((6, 6))
    own_noise[:3, :3], own_noise[3:, 3:] = own @ own.transpose(0, 2, 1)
    np.testing.assert_allclose(
        covariance(after)[SIZE:, SIZE:], J @ P[:STATE, :STATE] @ J.T + own_noise, atol=1e-12
    )


def test_dropping_landmarks_marginalises_them(generator):
    factor = lower(generator)
    keep = np.array([True, False, True, False])
    rows = np.concatenate([np.ones(STATE, dtype=bool), np.repeat(keep, 3)])
    after = reduced(factor, STATE, keep)
    assert is_lower(after)
    np.testing.assert_allclose(covariance(after), covariance(factor)[np.ix_(rows, rows)], atol=1e-12)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_prior_a_billion_times_wider_than_the_posterior_leaves_a_regular_factor(generator, dtype):
    """Standard deviations of the ratio 1e6: a subtracted covariance would be indefinite in float32 and worthless in float64."""
    factor = (1e6 * np.eye(SIZE)).astype(dtype)
    Y = np.zeros((3 * LANDMARKS, SIZE), dtype=dtype)
    Y[:, STATE:] = 1e6 * np.eye(3 * LANDMARKS)
    after = after_correction(factor, corrected(Y, np.zeros(3 * LANDMARKS, dtype=dtype)))
    np.testing.assert_allclose(np.abs(after.diagonal())[STATE:], 1.0, rtol=1e-5)
    np.testing.assert_allclose(np.abs(after.diagonal())[:STATE], 1e6, rtol=1e-5)
