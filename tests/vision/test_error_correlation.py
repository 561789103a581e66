"""Correlation of the errors of a landmark's observations, and the white noise that says as much."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic_points import RIG

from spinfilters.vision.batch_tracks import PLACE_AND_DISPARITY
from spinfilters.vision.stereo_geometry import pixels_by_point
from spinfilters.vision.track_noise import ANGLES_DEG, LandmarkResiduals, TrackNoise, error_correlation

LANDMARKS, DIRECTIONS, REVOLUTIONS = 150, 4, 3
STD_PX = 0.2


def _scene(generator: np.random.Generator) -> LandmarkResiduals:
    """Landmarks seen from four directions 20 degrees apart in every revolution, each time with another roll; no residuals yet."""
    epochs = []
    for _ in range(REVOLUTIONS):
        for step in range(DIRECTIONS):
            roll = Rotation.from_rotvec([0, 0, generator.uniform(0, 2 * np.pi)])
            epochs.append((roll * Rotation.from_euler("y", 20.0 * step, degrees=True)).as_matrix())
    rotation = np.tile(np.array(epochs), (LANDMARKS, 1, 1))
    point = np.repeat(0.05 * generator.standard_normal((LANDMARKS, 3)), len(epochs), axis=0)
    position = np.tile([0.0, 0.0, 0.6], (len(point), 1))
    at = np.einsum("nij,nj->ni", rotation, point) + position
    jacobian = PLACE_AND_DISPARITY @ pixels_by_point(at, RIG) @ rotation / STD_PX
    landmark = np.repeat(np.arange(LANDMARKS), len(epochs))
    return LandmarkResiduals(landmark, point, rotation, position, np.zeros((len(point), 3)), jacobian)


def _with_errors(
    scene: LandmarkResiduals, share: float, generator: np.random.Generator
) -> tuple[LandmarkResiduals, np.ndarray]:
    """Residuals of errors of which a share of the variance returns with the direction, as a vector of the body."""
    shape = (LANDMARKS, 1, DIRECTIONS, 3)
    vectors = np.broadcast_to(generator.standard_normal(shape), (LANDMARKS, REVOLUTIONS, DIRECTIONS, 3))
    repeated = np.einsum("nij,nj->ni", scene.rotation, vectors.reshape(-1, 3))
    alike = np.broadcast_to(generator.standard_normal(shape), (LANDMARKS, REVOLUTIONS, DIRECTIONS, 3))
    repeated[:, 2] = alike.reshape(-1, 3)[:, 2]
    errors = np.sqrt(share) * repeated
    errors += np.sqrt(1 - share) * generator.standard_normal(errors.shape)
    stacked, J = errors.reshape(LANDMARKS, -1, 1), scene.jacobian.reshape(LANDMARKS, -1, 3)
    Q = np.linalg.qr(J)[0]
    left = (stacked - Q @ (np.swapaxes(Q, 1, 2) @ stacked)).reshape(-1, 3)
    motion = scene.by_common_motion.reshape(LANDMARKS, -1, 6)
    motion = (motion - Q @ (np.swapaxes(Q, 1, 2) @ motion)).reshape(-1, 6)
    moved = np.linalg.solve(motion.T @ motion, motion.T @ left.ravel())
    explained = moved @ (motion.T @ motion) @ moved / 6  # one where the errors are white
    part = LandmarkResiduals(
        scene.landmark, scene.point, scene.rotation, scene.position, left, scene.jacobian
    )
    return part, explained


def test_white_noise_has_no_correlation() -> None:
    generator = np.random.default_rng(0)
    found = error_correlation(_with_errors(_scene(generator), 0.0, generator)[0])
    assert sum(found.place) == pytest.approx(1.0, abs=0.06)
    assert sum(found.place[1:]) < 0.06
    assert sum(found.disparity[1:]) < 0.08
    assert found.inflation == pytest.approx(1.0, abs=0.1)


def test_errors_that_return_with_the_direction_are_found_whatever_the_roll() -> None:
    generator = np.random.default_rng(1)
    found = error_correlation(_with_errors(_scene(generator), 0.5, generator)[0])
    near, far = np.array(ANGLES_DEG) < 20, np.array(ANGLES_DEG) > 20
    for one in (found.place, found.disparity):
        assert one[0] == pytest.approx(0.5, abs=0.08)
        assert np.array(one[1:])[near].sum() == pytest.approx(0.5, abs=0.1)
        assert np.array(one[1:])[far].sum() < 0.08


def test_white_noise_that_says_as_much_explains_the_error_of_poses() -> None:
    generator = np.random.default_rng(2)
    scene = _scene(generator)
    drawn = [_with_errors(scene, 0.5, generator) for _ in range(60)]
    inflation = error_correlation(drawn[0][0]).inflation
    assert inflation == pytest.approx(np.mean([explained for _, explained in drawn]), rel=0.25)
    assert inflation > 1.2
    noise = error_correlation(drawn[0][0]).inflated(TrackNoise((1.0, 2.0), (3.0, 4.0)))
    np.testing.assert_allclose(noise.disparity, np.array([3.0, 4.0]) * inflation)


def test_few_landmarks_tell_nothing() -> None:
    generator = np.random.default_rng(3)
    residuals = _with_errors(_scene(generator), 0.5, generator)[0]
    assert error_correlation(residuals.part(residuals.landmark < 20)).inflation == 1.0
