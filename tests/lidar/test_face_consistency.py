"""Planes that belong to no face of the drifting body, and planes that have no front."""

from dataclasses import replace

import numpy as np
import pytest

from spinfilters.core.attitude_conversions import matrix_from_rotation_vector
from spinfilters.core.ray_angles import unit_vectors
from spinfilters.lidar.face_map import Face, TrackedFaces, consistent_faces
from spinfilters.lidar.planes import FittedPlane, PointNoise, extract_planes, fitted_plane
from spinfilters.lidar.scan_pose import ScanPose

SIZE, STD, SCANS = 1.5, 1e-4, 12
PLACE, VELOCITY = np.array([20.0, 0.0, 0.0]), np.array([0.0, 0.01, 0.0])
FACES = tuple(Face(sign * np.eye(3)[k], 0.5) for k in range(3) for sign in (-1.0, 1.0))


def drifting() -> tuple[TrackedFaces, list[tuple[FittedPlane, ...]]]:
    """A turning cube of which every scan sees three faces, in scatter of `STD` (m)."""
    generator = np.random.default_rng(0)
    poses, matches, planes = [], [], []
    for k in range(SCANS):
        R, t = matrix_from_rotation_vector(np.array([0.25, 0.35, 0.2]) * k), PLACE + VELOCITY * k
        seen = tuple(j for j, face in enumerate(FACES) if (R @ face.normal)[0] < 0)
        at = t + STD * generator.standard_normal(3)
        planes.append(
            tuple(
                FittedPlane(
                    R @ FACES[j].normal,
                    t + 0.5 * R @ FACES[j].normal,
                    R @ FACES[j].tangents,
                    STD**2 * np.eye(3),
                    100,
                    1.0,
                )
                for j in seen
            )
        )
        matches.append(seen)
        poses.append(ScanPose(float(k), R, at, STD**2 * np.eye(6)))
    return TrackedFaces(tuple(poses), FACES, tuple(matches)), planes


def test_faces_that_the_drift_explains_stay_as_they_are() -> None:
    tracked, planes = drifting()
    found = consistent_faces(tracked, planes, SIZE)
    assert found.tracked is tracked
    assert (found.planes, found.contradicted) == (tuple(planes), 0)


def test_a_plane_of_a_wrong_face_is_dropped_and_the_pose_begins_where_the_drift_leads() -> None:
    tracked, planes = drifting()
    wrong = list(planes[5])
    wrong[1] = replace(wrong[1], centroid=wrong[1].centroid + 0.8 * wrong[1].normal)
    poses = list(tracked.poses)
    poses[5] = replace(poses[5], translation=poses[5].translation + 0.8 * wrong[1].normal)
    moved = replace(tracked, poses=tuple(poses))
    found = consistent_faces(moved, [*planes[:5], wrong, *planes[6:]], SIZE)
    assert found.contradicted == 1
    assert found.tracked.matches[5] == (tracked.matches[5][0], tracked.matches[5][2])
    assert found.planes[5] == (wrong[0], wrong[2])
    np.testing.assert_allclose(
        found.tracked.poses[5].translation, PLACE + 5 * VELOCITY, rtol=0, atol=10 * STD
    )


def test_a_body_that_does_not_drift_uniformly_keeps_its_planes_and_the_scans_are_counted() -> None:
    (tracked, planes), aside = drifting(), np.array([0.0, 0.5, 0.0])
    for k in range(SCANS - 4, SCANS):
        planes[k] = tuple(replace(each, centroid=each.centroid + aside) for each in planes[k])
    found = consistent_faces(tracked, planes, SIZE)
    assert found.tracked is tracked
    assert found.contradicted >= 4


@pytest.mark.parametrize("std", [0.0, 1e-5])
def test_one_line_of_rays_is_no_plane_of_the_body(std: float) -> None:
    """Its rays lie in a plane through the lidar, whose normal is towards neither side."""
    azimuth = np.linspace(-0.03, 0.03, 60)
    points = (30 + np.abs(azimuth) * 20)[:, None] * unit_vectors(azimuth, np.full(60, 0.01))
    noise = PointNoise(0.003, std, std)
    assert not fitted_plane(points, noise).shows_its_front
    assert extract_planes(points, noise, np.random.default_rng(0))[0] == []
