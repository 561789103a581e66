"""Bundle adjustment, and the noise that its residuals tell."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic_points import RIG, Ball

from spinfilters.vision.batch_tracks import Observations, adjust
from spinfilters.vision.track_noise import TrackNoise, identified

NOISE = TrackNoise((0.01, 0.004), (0.004, 0.5))


def _scene(epochs: int = 8, pixel: float = 0.0, seed: int = 0) -> tuple[Observations, np.ndarray, np.ndarray]:
    """Observations with the covariance of `NOISE`, times a factor; true poses and points."""
    ball, generator = Ball(120, seed), np.random.default_rng(seed)
    poses, rows = np.zeros((epochs, 7)), []
    covariance = NOISE.covariance(np.full(1, 3.0), np.full(1, 0.1))
    for k in range(epochs):
        turn = Rotation.from_rotvec([0.0, 0.35 * k, 0.05 * k])
        poses[k] = [0.01 * k, 0.0, 0.6, *turn.as_quat()]
        points, landmarks = ball.seen(turn.as_matrix(), poses[k, :3])
        noise = generator.multivariate_normal(np.zeros(3), pixel**2 * covariance[0], len(landmarks))
        rows.append((np.full(len(landmarks), k), landmarks, points.values + noise))
    epoch, landmark, values = (np.concatenate(each) for each in zip(*rows, strict=True))
    often = np.bincount(landmark, minlength=120)[landmark] > 1
    used, landmark = np.unique(landmark[often], return_inverse=True)
    observations = Observations(
        epoch[often], landmark, values[often], np.tile(covariance, (int(often.sum()), 1, 1))
    )
    return observations, poses, ball.points[used]


def _disturbed(poses: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    generator, rough = np.random.default_rng(5), poses.copy()
    rough[1:, :3] += 0.003 * generator.standard_normal((len(poses) - 1, 3))
    return rough, points + 0.003 * generator.standard_normal(points.shape)


def test_exact_observations_give_the_true_poses_and_points() -> None:
    observations, poses, points = _scene()
    found = adjust(observations, *_disturbed(poses, points), RIG)
    np.testing.assert_allclose(found.poses, poses, atol=1e-7)
    np.testing.assert_allclose(found.points, points, atol=1e-7)


def test_wrong_observations_hardly_move_the_poses() -> None:
    observations, poses, points = _scene(pixel=1.0)
    clean = adjust(observations, *_disturbed(poses, points), RIG)
    wrong = np.arange(len(observations.epoch)) % 40 == 0
    observations.values[wrong] += 15.0
    found = adjust(observations, *_disturbed(poses, points), RIG)
    assert np.abs(found.poses[:, 3:] - clean.poses[:, 3:]).max() < 2e-3
    length = np.linalg.norm(found.whitened, axis=1)
    assert length[wrong].min() > 4
    assert (length[~wrong] < 4).mean() > 0.98


@pytest.mark.parametrize("seed", range(3))
def test_residuals_have_the_variance_that_the_fit_has_left(seed: int) -> None:
    observations, poses, points = _scene(12, 1.0, seed)
    residual, freedom = adjust(observations, *_disturbed(poses, points), RIG).residuals(observations)
    place, disparity = NOISE.variances(np.full(1, 3.0), np.full(1, 0.1))
    assert (residual[:, :2] ** 2).sum() / freedom[:, :2].sum() == pytest.approx(place[0], rel=0.12)
    assert (residual[:, 2] ** 2).sum() / freedom[:, 2].sum() == pytest.approx(disparity[0], rel=0.15)


def test_noise_is_identified_with_its_dependence_on_size_and_residual() -> None:
    generator = np.random.default_rng(0)
    size, residual = generator.uniform(2, 12, 20000), generator.uniform(0, 0.5, 20000)
    place, disparity = NOISE.variances(size, residual)
    errors = generator.standard_normal((20000, 3)) * np.sqrt(np.column_stack([place, place, disparity]))
    found = identified(errors, np.ones_like(errors), size, residual)
    np.testing.assert_allclose(found.variances(size, residual), (place, disparity), rtol=0.12)
