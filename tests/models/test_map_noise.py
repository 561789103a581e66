"""Matches with uncertain points, eliminated."""

import numpy as np

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.models.camera_landmarks import StereoLandmark, camera_parameters
from spinfilters.models.feature_tracks import RIG
from spinfilters.models.state_layout import POSE_BLOCKS, StateLayout
from spinfilters.models.tracks.track_poses import UncertainMatches

MODEL = StereoLandmark(StateLayout(POSE_BLOCKS))


def sample() -> tuple[UncertainMatches, np.ndarray, np.ndarray]:
    """Twelve matches of three poses."""
    generator = np.random.default_rng(6)
    q = generator.standard_normal((3, 4))
    poses = np.hstack([[[0.02, -0.01, 0.6]] * 3, q / np.linalg.norm(q, axis=1, keepdims=True)])
    epochs = np.repeat(np.arange(3), 4)
    points = generator.uniform(-0.1, 0.1, (12, 3))
    parameters = camera_parameters(points, RIG.calibration, 1.3)
    pixels = MODEL.predict(poses[epochs], parameters) + generator.standard_normal((12, 3))
    roots = 0.01 * generator.standard_normal((12, 3, 3))
    away = 0.005 * generator.standard_normal((12, 3))
    return UncertainMatches(parameters, pixels, away, roots @ np.swapaxes(roots, 1, 2)), poses, epochs


def test_rows_are_whitened_by_pixels_and_points_together() -> None:
    matches, poses, epochs = sample()
    found = matches.linearised(MODEL, poses, epochs)
    innovation, jacobian, _, _ = MODEL.linearise(poses[epochs], matches.parameters, matches.pixels)
    by_point = jacobian[..., :3] @ matrix_from_quaternion(poses[epochs, 3:])
    noise = np.eye(3) + by_point @ matches.covariance @ np.swapaxes(by_point, 1, 2)
    rows = np.linalg.solve(np.linalg.cholesky(noise), jacobian)
    np.testing.assert_allclose(found.jacobian, rows, rtol=1e-9, atol=1e-9 * np.abs(rows).max())
    at_map = innovation - (by_point @ matches.away[..., None])[..., 0]
    squares = np.einsum("ki,ki->k", at_map, np.linalg.solve(noise, at_map[..., None])[..., 0])
    np.testing.assert_allclose(np.square(found.innovation).sum(axis=1), squares, rtol=1e-9)
    assert found.valid.all()


def test_a_points_correction_is_its_mean_given_the_pixels() -> None:
    matches, poses, epochs = sample()
    found = matches.linearised(MODEL, poses, epochs)
    correction = (found.by_left @ found.innovation[..., None])[..., 0]
    innovation, jacobian, _, _ = MODEL.linearise(poses[epochs], matches.parameters, matches.pixels)
    by_point = jacobian[..., :3] @ matrix_from_quaternion(poses[epochs, 3:])
    gain = matches.covariance @ np.swapaxes(by_point, 1, 2)
    at_map = innovation - (by_point @ matches.away[..., None])[..., 0]
    expected = (gain @ np.linalg.solve(np.eye(3) + by_point @ gain, at_map[..., None]))[..., 0]
    np.testing.assert_allclose(correction, expected, rtol=1e-8, atol=1e-12)


def test_a_match_that_no_number_describes_spoils_no_other() -> None:
    matches, poses, epochs = sample()
    whole = matches.linearised(MODEL, poses, epochs)
    matches.covariance[5] = np.nan
    found = matches.linearised(MODEL, poses, epochs)
    others = np.arange(12) != 5
    assert not np.isfinite(found.innovation[5]).any()
    np.testing.assert_array_equal(found.innovation[others], whole.innovation[others])
