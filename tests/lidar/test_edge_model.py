"""Ranges near edges through beams that jitter, against drawn beams; poses that points at edges improve."""

from itertools import pairwise

import numpy as np
import pytest

from spinfilters.core.ray_angles import unit_vectors
from spinfilters.lidar.edge_adjustment import expected_ranges, with_edges
from spinfilters.lidar.face_map import Face
from spinfilters.lidar.mesh import box
from spinfilters.lidar.planes import PointNoise
from spinfilters.lidar.scan import RayPattern, rvs_noise
from spinfilters.lidar.scan_pose import ScanPose, move_placement, rotation_vector
from spinfilters.lidar.scan_poses import scan_poses
from spinfilters.simulation.lidar_scanner import LidarSettings, Scanner, Still, thesis_rotation

FACES = [Face(sign * np.eye(3)[k], 0.5) for k in range(3) for sign in (-1.0, 1.0)]
R, T = thesis_rotation(30, 40, 20), np.array([500.0, 0.0, 0.0])
NOISE = PointNoise(0.003, 1e-4, 2e-4)


def first_ranges(angles: np.ndarray) -> np.ndarray:
    """Ranges at which beams enter the convex body; exact."""
    u = unit_vectors(*angles.T)
    normals = np.array([R @ face.normal for face in FACES])
    distance = np.array([face.offset for face in FACES]) + normals @ T
    along = u @ normals.T
    return np.where(along < 0, distance / along, -np.inf).max(axis=1)


@pytest.mark.parametrize("angles", [(0.0, 0.0), (0.0, 3e-4), (2e-4, -2e-4), (-3e-4, 1e-4)])
def test_mean_and_deviation_of_ranges_near_edges_are_those_of_drawn_beams(
    angles: tuple[float, float],
) -> None:
    generator, beam = np.random.default_rng(0), np.array([angles])
    drawn = beam + generator.standard_normal((200_000, 2)) * [NOISE.azimuth_std, NOISE.elevation_std]
    ranges = first_ranges(drawn) + NOISE.range_std * generator.standard_normal(len(drawn))
    expected = expected_ranges(beam, FACES, R, T, NOISE)
    assert expected.mean[0] == pytest.approx(ranges.mean(), abs=0.15 * ranges.std())
    assert expected.std[0] == pytest.approx(ranges.std(), rel=0.1)


def test_without_jitter_the_range_is_that_of_the_first_face() -> None:
    angles = np.random.default_rng(1).uniform(-5e-4, 5e-4, (50, 2))
    expected = expected_ranges(angles, FACES, R, T, PointNoise(0.003, 0.0, 0.0))
    np.testing.assert_allclose(expected.mean, first_ranges(angles), atol=1e-9)
    np.testing.assert_allclose(expected.std, 0.003, rtol=1e-6)


@pytest.mark.parametrize("noise", [NOISE, PointNoise(0.003, 0.0, 0.0)])
def test_derivatives_by_pose_and_faces_are_those_of_differences(noise: PointNoise) -> None:
    angles = np.random.default_rng(2).uniform(-8e-4, 8e-4, (60, 2))
    found = expected_ranges(angles, FACES, R, T, noise)

    def mean(step: np.ndarray, faces: list[Face]) -> np.ndarray:
        return expected_ranges(angles, faces, *move_placement((R, T), step), noise).mean

    small = 1e-6
    for k, step in enumerate(small * np.eye(6)):
        difference = (mean(step, FACES) - mean(-step, FACES)) / (2 * small)
        np.testing.assert_allclose(found.by_pose[:, k], difference, rtol=1e-4, atol=1e-4)
    for k, j in ((k, j) for k in range(6) for j in range(3)):
        sides = [
            mean(np.zeros(6), [*FACES[:k], changed(FACES[k], sign * small * np.eye(3)[j]), *FACES[k + 1 :]])
            for sign in (1, -1)
        ]
        difference = (sides[0] - sides[1]) / (2 * small)
        np.testing.assert_allclose(found.by_faces[:, 3 * k + j], difference, rtol=1e-4, atol=1e-4)


def changed(face: Face, step: np.ndarray) -> Face:
    """A face after two tangent components of its normal and its offset have changed."""
    return Face(face.normal + face.tangents @ step[:2], face.offset + float(step[2]))


def test_a_beam_that_no_face_is_before_has_no_range() -> None:
    behind = expected_ranges(np.array([[np.pi / 2, 0.0]]), FACES[:1], np.eye(3), T, NOISE).mean
    assert np.isnan(behind).all()


def test_points_at_edges_improve_attitudes_of_a_coarse_scan(monkeypatch: pytest.MonkeyPatch) -> None:
    scanner = Scanner.of(box(), LidarSettings(RayPattern((0.24, 0.24), (67, 67)), rvs_noise()))
    rotations = [thesis_rotation(30 + 5 * k, 40, 20) for k in range(3)]
    generator = np.random.default_rng(4)
    scans = [scanner.scan(Still(Q, T), float(k), generator) for k, Q in enumerate(rotations)]
    found = scan_poses(scans)
    monkeypatch.setattr("spinfilters.lidar.scan_poses.edge_adjusted", lambda tracked, *_: tracked)
    for pose, before in zip(found.poses, scan_poses(scans).poses, strict=True):
        assert np.trace(pose.covariance[3:, 3:]) < 0.7 * np.trace(before.covariance[3:, 3:])
    turns = [b.rotation @ a.rotation.T for a, b in pairwise(found.poses)]
    true = [b @ a.T for a, b in pairwise(rotations)]
    errors = [np.linalg.norm(rotation_vector(a @ b.T)) for a, b in zip(turns, true, strict=True)]
    assert np.rad2deg(max(errors)) < 3.0


def test_rays_that_miss_the_body_leave_the_pose_to_the_others() -> None:
    # a plate seen so flat that 2 of its 61 columns of beams are beyond the grazing angle
    azimuth, elevation = np.meshgrid(np.linspace(-0.04, 0.04, 61), np.linspace(-0.02, 0.02, 31))
    angles = np.column_stack([azimuth.ravel(), elevation.ravel()])
    normal = np.array([-0.058, 0.0, 1.0]) / np.hypot(0.058, 1.0)
    plate, place, noise = [Face(normal, 0.0)], np.array([30.0, 0.0, 0.0]), PointNoise(0.01, 1e-3, 1e-3)
    expected = expected_ranges(angles, plate, np.eye(3), place, noise).mean
    assert 0 < np.isnan(expected).sum() < 100
    points = unit_vectors(*angles.T) * np.nan_to_num(expected, nan=90.0)[:, None]
    displaced = ScanPose(0.0, np.eye(3), place + 0.01 * normal, 1e5 * np.eye(6))
    found = with_edges(displaced, points, plate, noise, 10.0, np.zeros((6, 6)))
    assert abs(normal @ (found.translation - place)) < 1e-6
