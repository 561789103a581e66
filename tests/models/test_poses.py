"""From tracks to poses: absolute orientation, one epoch's fit, and whole recordings with and without a map."""

import numpy as np
import pytest
from jaxtyping import Float
from scipy.special import chdtri

from spinfilters.core.absolute_orientation import absolute_orientation, absolute_orientations
from spinfilters.core.attitude_conversions import (
    angle_between,
    inverse,
    matrix_from_quaternion,
    multiply,
    quaternion_from_rotation_vector,
    rotate,
)
from spinfilters.core.cameras import StereoPair
from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.sensor_tables import KnownMap
from spinfilters.models.camera_landmarks import StereoLandmark, camera_parameters
from spinfilters.models.feature_tracks import RIG
from spinfilters.models.state_layout import StateLayout
from spinfilters.models.tracks.map_building import poses_without_map
from spinfilters.models.tracks.pose_consensus import Matches
from spinfilters.models.tracks.track_poses import fit_pose, fit_poses, poses_with_map
from spinfilters.simulation.scenario import Scenario, simulate

POSE = StateLayout(("t", "a"))
CAMERA = StereoLandmark(POSE)
TURNS = [0.0, 1e-12, 1e-6, 1.0, np.pi / 2, np.pi - 1e-9, np.pi]


def _points(count: int, seed: int = 0) -> Float[np.ndarray, "count 3"]:
    return np.random.default_rng(seed).uniform(-0.1, 0.1, (count, 3))


def _pose(turn: float, seed: int = 0) -> Float[np.ndarray, " 7"]:
    """0.6 m before the camera, turned by this angle about any axis."""
    axis = np.random.default_rng(seed).standard_normal(3)
    q = quaternion_from_rotation_vector(turn * axis / np.linalg.norm(axis))
    return np.concatenate([[0.03, -0.02, 0.6], q])


def _pixels(pose: np.ndarray, points: np.ndarray) -> Float[np.ndarray, "count 3"]:
    return CAMERA.predict(pose, camera_parameters(points, RIG.calibration, 1.0))


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("count", [3, 4, 50])
def test_absolute_orientation_is_exact_for_exact_points(turn: float, count: int) -> None:
    points, pose = _points(count), _pose(turn)
    q, t = absolute_orientation(rotate(pose[3:], points) + pose[:3], points)
    assert angle_between(q, pose[3:]) < 1e-12
    np.testing.assert_allclose(t, pose[:3], atol=1e-14)


def test_absolute_orientation_leaves_out_points_without_weight() -> None:
    points, pose = _points(10), _pose(2.0)
    seen = rotate(pose[3:], points) + pose[:3]
    seen[:3] += 5.0
    weights = np.ones(10)
    weights[:3] = 0.0
    q, t = absolute_orientation(seen, points, weights)
    assert angle_between(q, pose[3:]) < 1e-12
    np.testing.assert_allclose(t, pose[:3], atol=1e-14)


def test_points_that_leave_a_rotation_undetermined_are_refused() -> None:
    line = np.outer(np.linspace(-1, 1, 6), [0.3, -0.2, 0.9])
    with pytest.raises(InputError, match="on one line"):
        absolute_orientation(line + 1.0, line)
    with pytest.raises(InputError, match="at least 3"):
        absolute_orientation(line[:2], line[:2])


def test_triangulation_undoes_the_projection() -> None:
    points, pose = _points(20), _pose(1.0)
    expected = rotate(pose[3:], points) + pose[:3]
    np.testing.assert_allclose(
        StereoPair().points_of(_pixels(pose, points), RIG.calibration), expected, atol=1e-13
    )


@pytest.mark.parametrize("turn", TURNS)
def test_a_fit_to_exact_pixels_is_the_pose(turn: float) -> None:
    points, pose = _points(30), _pose(turn)
    fitted = fit_pose(Matches(points, _pixels(pose, points), 1.0), RIG.calibration)
    assert fitted is not None
    assert fitted.inliers.all()
    np.testing.assert_allclose(POSE.local(fitted.pose, pose), 0.0, atol=1e-10)


def test_a_fit_s_error_is_explained_by_its_covariance() -> None:
    generator, points = np.random.default_rng(1), _points(60)
    total = 0.0
    for k in range(100):
        pose = _pose(1.0, seed=k)
        noisy = _pixels(pose, points) + generator.standard_normal((60, 3))
        fitted = fit_pose(Matches(points, noisy, 1.0), RIG.calibration)
        assert fitted is not None
        error = POSE.local(fitted.pose, pose)
        total += float(error @ np.linalg.solve(fitted.covariance, error))
    assert chdtri(600, 0.999) < total < chdtri(600, 0.001)


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_wrong_matches_are_found_and_do_not_move_the_pose(share: float) -> None:
    generator, points, pose = np.random.default_rng(2), _points(80), _pose(1.0)
    pixels = _pixels(pose, points)
    wrong = np.zeros(80, dtype=bool)
    wrong[: int(80 * share)] = True
    pixels[wrong] += generator.uniform(30, 60, (wrong.sum(), 3)) * generator.choice([-1, 1], (wrong.sum(), 3))
    fitted = fit_pose(Matches(points, pixels, 1.0), RIG.calibration)
    assert fitted is not None
    np.testing.assert_array_equal(fitted.inliers, ~wrong)
    np.testing.assert_allclose(POSE.local(fitted.pose, pose), 0.0, atol=1e-10)


def test_fewer_than_four_usable_matches_give_no_pose() -> None:
    points, pose = _points(6), _pose(1.0)
    pixels = _pixels(pose, points)
    assert fit_pose(Matches(points[:3], pixels[:3], 1.0), RIG.calibration) is None
    pixels[:3] = np.nan
    assert fit_pose(Matches(points, pixels, 1.0), RIG.calibration) is None


def _unlike_frames(with_map_noise: bool) -> list[Matches]:
    """Many matches and few, wrong ones, too few, none at all, some without a number, and some that agree on nothing."""
    generator, epochs = np.random.default_rng(5), []
    for k, count in enumerate([60, 7, 90, 3, 0, 40, 30, 65]):
        points, pose = _points(count, seed=k), _pose(0.4 * k, seed=k)
        pixels = _pixels(pose, points) + generator.standard_normal((count, 3))
        if k == 2:
            pixels[:45] = np.roll(pixels[:45], 1, axis=0)
        if k == 5:
            pixels[3:7] = np.nan
        if k == 6:
            pixels = np.roll(pixels, 1, axis=0)
        covariance = np.tile(1e-7 * np.eye(3), (count, 1, 1)) if with_map_noise else None
        epochs.append(Matches(points, pixels, 1.0, covariance))
    return epochs


@pytest.mark.parametrize("with_map_noise", [False, True])
@pytest.mark.parametrize("at_once", [3, 64])
def test_epochs_fitted_together_are_those_fitted_alone(
    with_map_noise: bool, at_once: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("spinfilters.models.tracks.track_poses.EPOCHS_AT_ONCE", at_once)
    epochs = _unlike_frames(with_map_noise)
    together = fit_poses(epochs, RIG.calibration)
    assert [fitted is not None for fitted in together] == [True, True, True, False, False, True, False, True]
    for fitted, epoch in zip(together, epochs, strict=True):
        alone = fit_pose(epoch, RIG.calibration)
        assert (alone is None) == (fitted is None)
        if fitted is not None and alone is not None:
            np.testing.assert_allclose(POSE.local(fitted.pose, alone.pose), 0.0, atol=1e-12)
            np.testing.assert_allclose(fitted.covariance, alone.covariance, rtol=1e-9, atol=1e-15)
            np.testing.assert_array_equal(fitted.inliers, alone.inliers)


@pytest.fixture(scope="module")
def recording() -> Dataset:
    """30 epochs of 12 degrees: a whole revolution, so that a map must close."""
    return simulate(Scenario.simplified(epochs=32, interval=0.2, landmarks=250, seed=4))


def _true_poses(recording: Dataset) -> Float[np.ndarray, "n 7"]:
    truth = recording.truth
    assert truth is not None
    assert truth.center_of_mass_g is not None
    t = truth.center_of_mass - matrix_from_quaternion(truth.q_ig) @ truth.center_of_mass_g
    return np.concatenate([t, truth.q_ig], axis=1)


def test_poses_with_the_known_map_are_the_simulated_motion(recording: Dataset) -> None:
    assert recording.known_map is not None
    poses = poses_with_map(recording.log.stream("stereo"), recording.known_map, RIG.calibration, 1.0)
    assert poses.covariance is not None
    np.testing.assert_array_equal(poses.time, 0.2 * np.arange(32))
    errors = POSE.local(poses.values, _true_poses(recording))
    total = sum(float(e @ np.linalg.solve(P, e)) for e, P in zip(errors, poses.covariance, strict=True))
    assert chdtri(6 * 32, 0.999) < total < chdtri(6 * 32, 0.001)


def test_poses_without_a_map_are_the_simulated_motion_in_another_frame_on_the_body(
    recording: Dataset,
) -> None:
    """Frame g is then defined by the first epoch's points: the first pose tells how it lies in the true one, to some 0.03 rad,
    because one epoch's depths are poor (about 12 mm each)."""
    poses, found, _ = poses_without_map(recording.log.stream("stereo"), RIG.calibration, 1.0)
    assert recording.known_map is not None
    true = _true_poses(recording)
    q_gn = multiply(inverse(true[0, 3:]), poses.values[0, 3:])
    t_gn = matrix_from_quaternion(true[0, 3:]).T @ (poses.values[0, :3] - true[0, :3])
    expected_q = multiply(true[:, 3:], np.broadcast_to(q_gn, (32, 4)))
    expected_t = true[:, :3] + matrix_from_quaternion(true[:, 3:]) @ t_gn
    assert angle_between(expected_q, poses.values[:, 3:]).max() < 0.06
    assert np.linalg.norm(expected_t - poses.values[:, :3], axis=1).max() < 0.005
    known = recording.known_map.points[np.searchsorted(recording.known_map.ids, found.ids)]
    distance = np.linalg.norm(rotate(q_gn, found.points) + t_gn - known, axis=1)
    assert np.median(distance) < 0.003


def test_tracks_that_share_no_landmark_with_the_map_are_refused(recording: Dataset) -> None:
    assert recording.known_map is not None
    elsewhere = KnownMap(recording.known_map.ids + 10_000, recording.known_map.points)
    with pytest.raises(InputError, match="four landmarks"):
        poses_with_map(recording.log.stream("stereo"), elsewhere, RIG.calibration, 1.0)


@pytest.mark.parametrize("turn", TURNS)
def test_triples_near_a_line_lose_no_more_digits_than_their_spread(turn: float) -> None:
    pose, points = _pose(turn), np.stack([_points(3, seed) for seed in range(4)])
    R_ab = matrix_from_quaternion(pose[3:])
    for flatness in (1.0, 1e-2, 1e-4):
        along = np.array([0.6, 0.0, 0.8])
        near = points @ np.outer(along, along) + flatness * points @ (np.eye(3) - np.outer(along, along))
        found = absolute_orientations(near @ R_ab.T + pose[:3], near)
        assert found.determined.all()
        np.testing.assert_allclose(found.R, np.tile(R_ab, (4, 1, 1)), atol=1e-13 / flatness**2)
        np.testing.assert_allclose(found.t, np.tile(pose[:3], (4, 1)), atol=1e-9)
