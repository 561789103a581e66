"""Poses and a map from tracks in which a third of the ids are swapped, and what finds them out."""

import numpy as np
import pytest
from jaxtyping import Float
from swapped_ids import swapped

from spinfilters.core.attitude_conversions import (
    angle_between,
    inverse,
    matrix_from_quaternion,
    multiply,
    quaternion_from_rotation_vector,
    rotate,
)
from spinfilters.core.cameras import StereoPair
from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.models.camera_landmarks import StereoLandmark, camera_parameters
from spinfilters.models.feature_tracks import RIG
from spinfilters.models.state_layout import StateLayout
from spinfilters.models.tracks.map_building import MapInProgress, poses_without_map
from spinfilters.models.tracks.pose_consensus import Consensus, Matches, MatchTable, consensus_poses
from spinfilters.models.tracks.track_poses import fit_pose
from spinfilters.simulation.scenario import Scenario, simulate

CAMERA = StereoLandmark(StateLayout(("t", "a")))
POSE = np.concatenate([[0.03, -0.02, 0.6], quaternion_from_rotation_vector(np.array([0.5, -1.0, 0.7]))])


def _points(count: int) -> Float[np.ndarray, "count 3"]:
    return np.random.default_rng(0).uniform(-0.1, 0.1, (count, 3))


def _swapped_matches(share: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Map points, the pixels they are taken to have, and which are wrong: each has another point's."""
    points, generator = _points(150), np.random.default_rng(1)
    pixels = CAMERA.predict(POSE, camera_parameters(points, RIG.calibration, 1.0))
    pixels += generator.standard_normal(pixels.shape)
    wrong = np.arange(len(points)) < share * len(points)
    pixels[wrong] = np.roll(pixels[wrong], 1, axis=0)
    return points, pixels, wrong


def _rough(points: np.ndarray, pixels: np.ndarray) -> Consensus:
    return consensus_poses(MatchTable.of([Matches(points, pixels, 1.0)], RIG.calibration), RIG.calibration)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.5, 0.65, 0.75])
def test_the_pose_that_most_matches_agree_on_is_found_among_wrong_ones(share: float) -> None:
    points, pixels, wrong = _swapped_matches(share)
    rough = _rough(points, pixels)
    assert rough.found.all()
    assert angle_between(rough.poses[0, 3:], POSE[3:]) < 0.1
    fitted = fit_pose(Matches(points, pixels, 1.0), RIG.calibration)
    assert fitted is not None
    error = CAMERA.layout.local(fitted.pose, POSE)
    assert error @ np.linalg.solve(fitted.covariance, error) < 30
    assert fitted.inliers[~wrong].all()
    assert fitted.inliers[wrong].sum() <= 0.05 * len(points)


def test_the_same_matches_give_the_same_pose() -> None:
    points, pixels, _ = _swapped_matches(0.5)
    first, again = _rough(points, pixels), _rough(points, pixels)
    np.testing.assert_array_equal(first.poses, again.poses)
    np.testing.assert_array_equal(first.agreeing, again.agreeing)


def test_matches_that_agree_on_nothing_give_no_pose() -> None:
    points, pixels, _ = _swapped_matches(1.0)
    assert fit_pose(Matches(points, pixels, 1.0), RIG.calibration) is None


def test_a_landmark_that_a_wrong_association_made_is_placed_anew_when_later_ones_agree() -> None:
    building, where = MapInProgress.empty(np.array([7])), np.array([0])
    information = np.eye(3)[None] * 1e6
    wrong, right = np.array([[0.1, 0.0, 0.0]]), np.array([[0.0, 0.05, 0.0]])
    building.add(where, information, wrong)
    building.add(where, information, right + 1e-4)
    np.testing.assert_allclose(building.points(where)[0], wrong)
    building.add(where, information, right - 1e-4)
    points, covariance = building.points(where)
    np.testing.assert_allclose(points, right, atol=1e-12)
    np.testing.assert_allclose(covariance, np.eye(3)[None] * 5e-7)


def test_a_single_wrong_association_does_not_move_a_landmark() -> None:
    building, where = MapInProgress.empty(np.array([7])), np.array([0])
    for point in ([[0.0, 0.0, 0.0]], [[0.1, 0.0, 0.0]], [[0.001, 0.0, 0.0]], [[0.0, -0.2, 0.0]]):
        building.add(where, np.eye(3)[None] * 1e6, np.array(point))
    np.testing.assert_allclose(building.points(where)[0], [[0.0005, 0.0, 0.0]], atol=1e-12)


@pytest.fixture(scope="module")
def recording() -> Dataset:
    return simulate(Scenario.simplified(rate_rpm=(4.0, 9.0, 3.0), epochs=20, landmarks=300, seed=4))


def _pose_errors(recording: Dataset, poses: MeasurementStream) -> tuple[np.ndarray, np.ndarray]:
    """Angles (rad) and distances (m) from the true motion, in the epoch on the body that the first pose defines."""
    truth = recording.truth
    assert truth is not None
    assert truth.center_of_mass_g is not None
    t = truth.center_of_mass - matrix_from_quaternion(truth.q_ig) @ truth.center_of_mass_g
    first = poses.values[0]
    q_gn = multiply(inverse(truth.q_ig[0]), first[3:])
    t_gn = matrix_from_quaternion(truth.q_ig[0]).T @ (first[:3] - t[0])
    q = multiply(truth.q_ig, np.broadcast_to(q_gn, truth.q_ig.shape))
    return (
        angle_between(q, poses.values[:, 3:]),
        np.linalg.norm(t + rotate(truth.q_ig, t_gn) - poses.values[:, :3], axis=1),
    )


def test_a_third_of_the_ids_swapped_leaves_poses_and_map_nearly_as_good(recording: Dataset) -> None:
    tracks = swapped(recording.log.stream("stereo"), 0.3, np.random.default_rng(0))
    poses, found, _ = poses_without_map(tracks, RIG.calibration, 1.0)
    assert len(poses) == 20
    angles, distances = _pose_errors(recording, poses)
    assert angles.max() < 0.1
    assert distances.max() < 0.01
    assert recording.known_map is not None
    truth = recording.truth
    assert truth is not None
    assert truth.center_of_mass_g is not None
    R = matrix_from_quaternion(truth.q_ig[0])
    known = recording.known_map.points[np.searchsorted(recording.known_map.ids, found.ids)]
    camera = known @ R.T + truth.center_of_mass[0] - R @ truth.center_of_mass_g
    there = (camera - poses.values[0, :3]) @ matrix_from_quaternion(poses.values[0, 3:])
    assert np.quantile(np.linalg.norm(there - found.points, axis=1), 0.8) < 0.01


def test_the_first_frames_alone_are_all_that_is_looked_at(recording: Dataset) -> None:
    tracks = recording.log.stream("stereo")
    poses, found, _ = poses_without_map(tracks, RIG.calibration, 1.0, epochs=6)
    only = tracks.slice(tracks.time[0], tracks.epoch_times[5])
    assert only is not None
    expected, expected_map, _ = poses_without_map(only, RIG.calibration, 1.0)
    np.testing.assert_array_equal(poses.values, expected.values)
    np.testing.assert_array_equal(found.ids, expected_map.ids)
    np.testing.assert_array_equal(found.points, expected_map.points)


def _never_returning(tracks: MeasurementStream) -> MeasurementStream:
    """A landmark that comes back after more than 2 s has another id."""
    assert tracks.ids is not None
    last: dict[int, float] = {}
    number: dict[int, int] = {}
    ids = []
    for time, landmark in zip(tracks.time.tolist(), tracks.ids.tolist(), strict=True):
        number[landmark] = number.get(landmark, 0) + (time - last.get(landmark, time) > 2.0)
        last[landmark] = time
        ids.append(landmark + 1000 * number[landmark])
    return MeasurementStream("stereo", tracks.time, tracks.values, np.array(ids))


def test_tracks_that_never_return_give_poses_to_the_end() -> None:
    recording = simulate(Scenario.simplified(epochs=45, landmarks=500, seed=2))
    tracks = _never_returning(recording.log.stream("stereo"))
    poses, found, _ = poses_without_map(tracks, RIG.calibration, 1.0)
    assert len(poses) == 45
    assert len(found.ids) > 900
    assert _pose_errors(recording, poses)[0].max() < 0.5


def test_a_point_at_infinity_leaves_the_map_as_it_was(recording: Dataset) -> None:
    tracks = recording.log.stream("stereo")
    assert tracks.ids is not None
    values, ids = tracks.values.copy(), tracks.ids.copy()
    first = tracks.epoch_offsets[:-1]
    values[first, 2] = values[first, 0] - 1e-13
    assert np.isfinite(StereoPair().points_of(values[first], RIG.calibration)).all()
    ids[first] = 10_000
    poses, found, _ = poses_without_map(
        MeasurementStream("stereo", tracks.time, values, ids), RIG.calibration, 1.0
    )
    assert len(poses) == 20
    assert 10_000 not in found.ids
