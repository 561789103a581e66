"""Cameras: pixels of points and points of pixels undo each other, with and without distortion; a known trajectory of the camera."""

import numpy as np
import pytest
from jaxtyping import Float

from spinfilters.core.attitude_conversions import (
    angle_between,
    multiply,
    quaternion_from_rotation_vector,
    rotate,
)
from spinfilters.core.camera_trajectory import CameraTrajectory, in_inertial
from spinfilters.core.cameras import Camera, monocular_camera, stereo_pair
from spinfilters.core.errors import InputError, ShapeError
from spinfilters.models.camera_landmarks import (
    MOVING,
    MonocularLandmark,
    StereoLandmark,
    camera_parameters,
    with_camera_poses,
)
from spinfilters.models.sensor_noise import IsotropicNoise
from spinfilters.models.state_layout import StateLayout

PINHOLE = [458.654, 457.296, 367.215, 248.375]
EUROC = [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
EUROC_RIGHT = [-0.28368365, 0.07451284, -0.00010473, -3.55590700e-05]
CALIBRATIONS = {
    "one camera": np.array(PINHOLE),
    "one distorted camera": np.array([*PINHOLE, *EUROC]),
    "a pair": np.array([*PINHOLE, 0.11]),
    "a distorted pair": np.array([*PINHOLE, 0.11, *EUROC, *EUROC_RIGHT]),
}
POSE = StateLayout(("t", "a"))


def camera_of(calibration: Float[np.ndarray, " c"]) -> Camera:
    """The camera of one of the calibrations."""
    return monocular_camera(calibration) if len(calibration) in (4, 8) else stereo_pair(calibration)


def points_in_view(count: int = 50) -> Float[np.ndarray, "count 3"]:
    """Points before the camera, up to 35 degrees off its axis."""
    generator = np.random.default_rng(1)
    depth = generator.uniform(0.4, 3.0, (count, 1))
    return np.concatenate([depth * generator.uniform(-0.5, 0.5, (count, 2)), depth], axis=1)


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_the_ray_of_a_pixel_meets_its_point(name: str) -> None:
    camera, points = camera_of(CALIBRATIONS[name]), points_in_view()
    rays = camera.rays_of(camera.pixels_of(points, CALIBRATIONS[name]), CALIBRATIONS[name])
    np.testing.assert_allclose(rays, points / points[:, 2:], atol=1e-12)


@pytest.mark.parametrize("name", ["a pair", "a distorted pair"])
def test_a_pair_tells_the_point_of_its_pixels(name: str) -> None:
    pair, points = stereo_pair(CALIBRATIONS[name]), points_in_view()
    found = pair.points_of(pair.pixels_of(points, CALIBRATIONS[name]), CALIBRATIONS[name])
    np.testing.assert_allclose(found, points, rtol=1e-10, atol=1e-10)


def test_distortion_is_that_of_opencv() -> None:
    """What `cv2.projectPoints` of OpenCV 4 gives for these numbers."""
    calibration, points = (
        CALIBRATIONS["one distorted camera"],
        np.array([[0.3, -0.2, 1.0], [-0.4, 0.35, 1.0]]),
    )
    expected = [[499.9055685393346, 160.1887446901026], [197.33899203745875, 396.60340432957366]]
    found = monocular_camera(calibration).pixels_of(points, calibration)
    np.testing.assert_allclose(found, expected, rtol=1e-13)


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_derivatives_by_the_point_are_those_of_finite_differences(name: str) -> None:
    camera, points, step = camera_of(CALIBRATIONS[name]), points_in_view(5), 1e-6
    found = camera.pixels_by_point(points, CALIBRATIONS[name])
    for axis, unit in enumerate(np.eye(3)):
        ends = [camera.pixels_of(points + sign * step * unit, CALIBRATIONS[name]) for sign in (1, -1)]
        np.testing.assert_allclose(found[:, :, axis], (ends[0] - ends[1]) / (2 * step), rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize("k2", [0.0, 0.1])
def test_a_point_beyond_the_fold_of_a_lens_is_not_in_view(k2: float) -> None:
    """With k2 > 0 pixels go outwards again beyond 1.6, far behind the fold at 0.9."""
    lens = [-0.5, k2, 0.0, 0.0]
    calibration = np.array([*PINHOLE, 0.11, *lens, *lens])
    sensor = StereoLandmark(POSE, None, stereo_pair(calibration))
    parameters = camera_parameters(np.array([[0.1, 0.0, 1.0], [3.0, 0.0, 1.0]]), calibration, 1.0)
    found = sensor.linearise(POSE.origin(), parameters, np.zeros((2, 3))).valid
    np.testing.assert_array_equal(found, [True, False])


def test_a_calibration_of_no_camera_is_refused() -> None:
    with pytest.raises(ShapeError, match="no such camera"):
        stereo_pair(np.zeros(6))
    with pytest.raises(ShapeError, match="no such camera"):
        monocular_camera(np.zeros(5))


def random_poses(count: int) -> Float[np.ndarray, "count 7"]:
    """Positions within half a metre, any attitudes."""
    generator = np.random.default_rng(2)
    q = quaternion_from_rotation_vector(generator.uniform(-1, 1, (count, 3)))
    return np.concatenate([generator.uniform(-0.5, 0.5, (count, 3)), q], axis=1)


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_a_moving_camera_sees_what_a_resting_one_sees_of_the_same_scene(name: str) -> None:
    calibration, points = CALIBRATIONS[name], 0.1 * (points_in_view(6) - [0, 0, 1])
    in_camera = np.concatenate(
        [[0.05, -0.02, 0.7], quaternion_from_rotation_vector(np.array([0.4, -1.0, 0.3]))]
    )
    camera_pose = random_poses(1)
    in_i = in_inertial(in_camera[None], camera_pose)[0]
    camera = camera_of(calibration)
    model, parameters = {
        2: (MonocularLandmark, camera_parameters),
        3: (StereoLandmark, camera_parameters),
    }[camera.pixel_dim]
    resting, moving = (
        model(POSE, IsotropicNoise(camera.pixel_dim), camera, *pose) for pose in ((), (MOVING,))
    )
    given = parameters(points, calibration, 1.0)
    expected = resting.predict(np.tile(in_camera, (6, 1)), given)
    found = moving.predict(np.tile(in_i, (6, 1)), with_camera_poses(given, np.tile(camera_pose, (6, 1))))
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_a_moving_pair_tells_the_landmark_of_its_pixels() -> None:
    calibration, points = CALIBRATIONS["a distorted pair"], 0.1 * (points_in_view(6) - [0, 0, 1])
    in_camera = np.concatenate(
        [[0.05, -0.02, 0.7], quaternion_from_rotation_vector(np.array([0.4, -1.0, 0.3]))]
    )
    camera_poses = np.tile(random_poses(1), (6, 1))
    in_i = in_inertial(in_camera[None], camera_poses[:1])[0]
    sensor = StereoLandmark(POSE, IsotropicNoise(3), stereo_pair(calibration), MOVING)
    parameters = with_camera_poses(camera_parameters(points, calibration, 1.0), camera_poses)
    made = sensor.new_landmarks(in_i, parameters, sensor.predict(np.tile(in_i, (6, 1)), parameters))
    assert made.determined.all()
    np.testing.assert_allclose(made.points, points, atol=1e-10)


def test_between_two_poses_a_trajectory_moves_and_rotates_evenly() -> None:
    rotation = np.array([0.3, -0.8, 0.5])
    start, end = random_poses(1)[0], np.zeros(7)
    end[:3] = start[:3] + np.array([1.0, 2.0, 3.0])
    end[3:] = -multiply(
        start[3:], quaternion_from_rotation_vector(rotation)
    )  # the other sign, the same attitude
    found = CameraTrajectory(np.array([2.0, 4.0]), np.stack([start, end])).at(np.array([2.5, 2.0, 4.0, 2.5]))
    np.testing.assert_allclose(found[0, :3], start[:3] + np.array([0.25, 0.5, 0.75]), atol=1e-15)
    expected = multiply(start[3:], quaternion_from_rotation_vector(0.25 * rotation))
    assert angle_between(found[0, 3:], expected) < 1e-14
    np.testing.assert_array_equal(found[1:], [start, end, found[0]])


def test_a_trajectory_says_nothing_of_times_that_it_does_not_cover() -> None:
    trajectory = CameraTrajectory(np.array([0.0, 1.0]), random_poses(2))
    for time in (-1e-3, 1.001):
        with pytest.raises(InputError, match="cover the observations"):
            trajectory.at(np.array([0.5, time]))


@pytest.mark.parametrize("time", [[0.0, 0.0], [1.0, 0.0], [0.0, np.nan]])
def test_a_trajectory_whose_times_do_not_ascend_is_refused(time: list[float]) -> None:
    with pytest.raises(InputError, match="ascending"):
        CameraTrajectory(np.array(time), random_poses(2))


def test_a_pose_in_the_camera_is_carried_along() -> None:
    poses, camera_poses, point = random_poses(4), random_poses(4)[::-1], np.array([0.1, -0.3, 0.2])
    found = in_inertial(poses, camera_poses)
    in_camera = rotate(poses[:, 3:], np.tile(point, (4, 1))) + poses[:, :3]
    expected = rotate(camera_poses[:, 3:], in_camera) + camera_poses[:, :3]
    np.testing.assert_allclose(
        rotate(found[:, 3:], np.tile(point, (4, 1))) + found[:, :3], expected, atol=1e-14
    )
