"""Faces that come back, and poses that carry the errors of their map."""

import numpy as np
import pytest

from spinfilters.core.attitude_conversions import matrix_from_rotation_vector
from spinfilters.lidar.face_map import (
    Face,
    PlaneEvidence,
    TrackedFaces,
    adjusted_faces,
    merged_faces,
    with_map_errors,
)
from spinfilters.lidar.planes import FittedPlane
from spinfilters.lidar.scan_pose import ScanPose

RATE, PLACE = np.array([0.25, 0.35, 0.2]), np.array([20.0, 0.0, 0.0])
SIZE, TURNS = 1.5, 16
FACES = tuple(Face(sign * np.eye(3)[k], 0.5) for k in range(3) for sign in (-1.0, 1.0))


def tracked(faces: tuple[Face, ...], matches: tuple[tuple[int, ...], ...]) -> TrackedFaces:
    rotations = [matrix_from_rotation_vector(RATE * k) for k in range(len(matches))]
    poses = tuple(ScanPose(float(k), R, PLACE, 1e-8 * np.eye(6)) for k, R in enumerate(rotations))
    return TrackedFaces(poses, faces, matches)


def seen(std: float, generator: np.random.Generator) -> tuple[TrackedFaces, list[list[FittedPlane]]]:
    """A turning cube: the planes of the faces towards the lidar, with errors of ``std`` (rad and m)."""
    matches, planes = [], []
    for k in range(TURNS):
        R = matrix_from_rotation_vector(RATE * k)
        visible = tuple(j for j, f in enumerate(FACES) if (R @ f.normal)[0] < -0.1)
        found = []
        for j in visible:
            normal, tangents = R @ FACES[j].normal, R @ FACES[j].tangents
            e = std * generator.standard_normal(3)
            tilted = normal + tangents @ e[:2]
            tilted /= np.linalg.norm(tilted)
            own = np.linalg.svd(tilted[None])[2][1:].T
            centroid = PLACE + (FACES[j].offset + e[2]) * normal
            found.append(FittedPlane(tilted, centroid, own, std**2 * np.eye(3), 100, 1.0))
        matches.append(visible)
        planes.append(found)
    return tracked(FACES, tuple(matches)), planes


def test_a_face_that_came_back_as_a_new_one_is_merged() -> None:
    again = Face(matrix_from_rotation_vector(np.array([0.0, 0.01, 0.0])) @ FACES[0].normal, 0.505)
    merged = merged_faces(tracked((*FACES, again), ((0, 2), (2, 4), (6, 4))), SIZE)
    assert len(merged.faces) == 6
    assert merged.matches == ((0, 2), (2, 4), (0, 4))


def test_coplanar_faces_that_a_scan_sees_side_by_side_stay_two() -> None:
    merged = merged_faces(tracked((*FACES, FACES[0]), ((0, 6), (2, 4), (6, 4))), SIZE)
    assert len(merged.faces) == 7


def test_wrong_faces_are_adjusted_to_the_shape_that_all_planes_show() -> None:
    true, planes = seen(1e-4, np.random.default_rng(0))
    tilts = 2e-3 * np.random.default_rng(1).standard_normal((6, 3))
    rough = tuple(
        Face(matrix_from_rotation_vector(e) @ f.normal, 0.502) for e, f in zip(tilts, FACES, strict=True)
    )
    start = TrackedFaces(true.poses, rough, true.matches)
    assert shape_error(start) > 1e-3
    assert shape_error(adjusted_faces(start, PlaneEvidence(planes), SIZE)) < 3e-4


def shape_error(found: TrackedFaces) -> float:
    """Largest wrong cosine between normals of two faces that scans show."""
    shown = sorted({k for match in found.matches for k in match})
    normals = np.array([found.faces[k].normal for k in shown])
    true = np.array([FACES[k].normal for k in shown])
    return float(np.abs(normals @ normals.T - true @ true.T).max())


def test_the_covariance_of_poses_holds_what_the_faces_do_to_them() -> None:
    start, planes = seen(1e-3, np.random.default_rng(1))
    found = with_map_errors(start, PlaneEvidence(planes), SIZE)
    assert found.covariance.shape == (18, 18)
    assert np.linalg.eigvalsh(found.covariance)[0] > -1e-12
    for before, after, more in zip(start.poses, found.poses, found.common, strict=True):
        np.testing.assert_allclose(after.covariance, before.covariance + more)
        assert np.trace(more[3:, 3:]) == pytest.approx(3 * 1e-6 / TURNS * 2, rel=2.0)


def test_a_face_that_is_hardly_known_does_not_turn_the_frame_of_the_others() -> None:
    start, planes = seen(1e-4, np.random.default_rng(3))
    cap = Face(np.array([1.0, 1.0, 1.0]) / np.sqrt(3), 0.8)
    pose = start.poses[0]
    normal, tangents = pose.rotation @ cap.normal, pose.rotation @ cap.tangents
    vague = FittedPlane(normal, PLACE + 0.8 * normal, tangents, 0.1**2 * np.eye(3), 20, 1.0)
    more = TrackedFaces(start.poses, (*FACES, cap), ((*start.matches[0], 6), *start.matches[1:]))
    found = with_map_errors(more, PlaneEvidence([[*planes[0], vague], *planes[1:]]), SIZE)
    assert found.covariance[18, 18] > 0.05**2
    assert np.sqrt(np.trace(found.common[5][3:, 3:])) < 1e-3
