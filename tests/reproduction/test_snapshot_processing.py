"""The thesis' processing gives the thesis' numbers."""

import numpy as np
import pytest

from spinfilters.core.attitude_conversions import cross_matrix, matrix_from_rotation_vector
from spinfilters.core.errors import InputError
from spinfilters.reproduction.decoust.pose_bound import center_bound, pose_bound
from spinfilters.reproduction.decoust.snapshot_frames import (
    PLACE,
    SEQUENCES,
    ProcessedSequence,
    best_fitting_sphere,
    processed_sequence,
)
from spinfilters.simulation.lidar_scanner import thesis_rotation
from spinfilters.simulation.lidar_sequence import RANGE_NOISE

SEEN = np.array([-0.5, 0.5, -0.5])
"""Faces of the cube, by the axis of each."""
TABLE_4_1 = np.array([[-0.05, 3.28, 1.71], [8.35, 0.98, -6.17], [-0.50, -1.06, -3.47]])
"""Differences of boundary corners, cm, as printed."""
FIGURE_4_13_BC3 = [0.37, 3.03, 0.12, 0.03, 0.74, 0.28, 1.11, 1.37, 0.61, 0.81, 2.43, 1.06]
"""Errors of the z axis, deg, transitions 1 to 12."""


@pytest.fixture(scope="module")
def first() -> ProcessedSequence:
    return processed_sequence(SEQUENCES[0])


def test_table_4_1_is_reproduced_to_its_digits(first: ProcessedSequence) -> None:
    ours = np.array([100 * first.errors(first.boundary_corners[:, k])[0] for k in range(3)])
    for printed in TABLE_4_1:
        assert np.abs(ours - printed).max(axis=1).min() < 0.006


def test_a_boundary_corner_of_figure_4_13_is_reproduced_to_its_digits(first: ProcessedSequence) -> None:
    ours = np.array([first.transition_errors(k)[:12, 2] for k in range(3)])
    assert np.abs(ours - FIGURE_4_13_BC3).max(axis=1).min() < 0.011


def test_corners_without_noise_are_exact_where_every_face_is_seen_well(first: ProcessedSequence) -> None:
    assert np.linalg.norm(first.errors(first.corners), axis=1)[1:13].max() < 1e-10


def test_range_noise_of_the_specification_leaves_no_corner_in_most_snapshots() -> None:
    noisy = processed_sequence(SEQUENCES[0][:6], noise=RANGE_NOISE)
    assert sum(each is None for each in noisy.snapshots) >= 4


def test_the_sphere_is_exact_far_from_the_lidar_and_says_how_errors_grow() -> None:
    generator = np.random.default_rng(0)
    directions = generator.standard_normal((12, 3)) * [0.05, 0.05, 0.0] + [0, 0, 1]
    points = 1000 * PLACE + 866.0 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    sphere = best_fitting_sphere(points)
    np.testing.assert_allclose(sphere.centre, 1000 * PLACE, atol=1e-4)
    errors = []
    for _ in range(200):
        moved = points + 1e-4 * generator.standard_normal(points.shape)
        errors.append(best_fitting_sphere(moved).centre - 1000 * PLACE)
    assert np.sqrt(np.mean(np.square(errors))) / 1e-4 == pytest.approx(sphere.amplification, rel=0.15)


def test_points_of_a_plane_have_no_sphere() -> None:
    with pytest.raises(InputError, match="in a plane"):
        best_fitting_sphere(np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0.6, 0.8, 0]]))


def test_the_bound_of_a_pose_is_that_of_ranges_to_moved_faces() -> None:
    pose, size = (30.0, 50.0, 0.0), 1e-6
    R = thesis_rotation(*pose)
    inside = np.random.default_rng(0).uniform(-0.4, 0.4, (30, 2))
    body = np.concatenate([np.insert(inside[k::3], k, side, axis=1) for k, side in enumerate(SEEN)])
    points = body @ R.T + PLACE
    normals = np.repeat(np.diag(np.sign(SEEN)), 10, axis=0) @ R.T
    beams = points / np.linalg.norm(points, axis=1, keepdims=True)

    def ranges(moved: np.ndarray) -> np.ndarray:
        turned = normals @ matrix_from_rotation_vector(moved[:3]).T
        return (turned @ (PLACE + moved[3:]) + 0.5) / np.sum(turned * beams, axis=1)

    slopes = np.stack([(ranges(e) - ranges(-e)) / (2 * size) for e in size * np.eye(6)], axis=1)
    expected = RANGE_NOISE.range_std**2 * np.linalg.inv(slopes.T @ slopes)
    found = pose_bound(points, pose)
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-4, atol=1e-12)
    corner = R @ SEEN
    moved = np.hstack([-cross_matrix(corner), np.eye(3)])
    assert found.of_point(corner) == pytest.approx(np.sqrt(np.trace(moved @ expected @ moved.T)), rel=1e-4)
    assert center_bound([found, found]) == pytest.approx(np.sqrt(np.trace(expected[3:, 3:]) / 2), rel=1e-4)
