"""The shape of a body that is few beams wide, from all of its ranges; what keeps its planes."""

from itertools import combinations

import numpy as np
import pytest

from spinfilters.core.ray_angles import angles_of
from spinfilters.lidar.edge_adjustment import RangeEvidence, edge_adjusted
from spinfilters.lidar.face_map import Face, TrackedFaces
from spinfilters.lidar.mesh import box
from spinfilters.lidar.planes import PointNoise, identified_noise
from spinfilters.lidar.scan import RayPattern, Scan, rvs_noise
from spinfilters.lidar.scan_pose import ScanPose
from spinfilters.reproduction.decoust.snapshot_frames import SEQUENCES
from spinfilters.simulation.lidar_scanner import LidarSettings, Scanner, Still, thesis_rotation

PLACE, SIZE = np.array([500.0, 0.0, 0.0]), 1.6
SPECIFIED = rvs_noise()
NOISE = PointNoise(SPECIFIED.range_std, SPECIFIED.azimuth_std, SPECIFIED.elevation_std)
ROTATIONS = [thesis_rotation(*angles) for angles in SEQUENCES[1][2:10]]


@pytest.fixture(scope="module")
def scans() -> list[Scan]:
    """The thesis' cube at 500 m, 30 beams wide."""
    scanner = Scanner.of(box(), LidarSettings(RayPattern((0.24, 0.24), (67, 67)), SPECIFIED))
    generator = np.random.default_rng(4)
    return [scanner.scan(Still(R, PLACE), float(k), generator) for k, R in enumerate(ROTATIONS)]


def tilted(angle: float) -> TrackedFaces:
    """The cube in its true poses, one of its three faces tilted."""
    seen = [Face(normal, 0.5) for normal in (-np.eye(3)[0], np.eye(3)[1], -np.eye(3)[2])]
    seen = [Face(face.normal if (ROTATIONS[0] @ face.normal)[0] < 0 else -face.normal, 0.5) for face in seen]
    normal = np.cos(angle) * seen[0].normal + np.sin(angle) * seen[1].normal
    poses = tuple(ScanPose(float(k), R, PLACE, 1e-4 * np.eye(6)) for k, R in enumerate(ROTATIONS))
    none = tuple(np.zeros((6, 6)) for _ in poses)
    return TrackedFaces(poses, (Face(normal, 0.5), *seen[1:]), ((0, 1, 2),) * len(poses), common=none)


def skewness(tracked: TrackedFaces) -> float:
    """Largest angle by which two faces of the cube are not perpendicular, deg."""
    return float(np.rad2deg(max(abs(a.normal @ b.normal) for a, b in combinations(tracked.faces, 2))))


def test_a_face_that_planes_tilted_is_set_right_by_all_ranges(scans: list[Scan]) -> None:
    start = tilted(0.06)
    found = edge_adjusted(start, [scan.points for scan in scans], NOISE, SIZE)
    assert skewness(start) > 3.0
    assert skewness(found) < 1.5
    for pose in found.poses:
        assert np.rad2deg(np.sqrt(np.linalg.eigvalsh(pose.covariance[3:, 3:])[-1])) < 1.5


def test_ranges_of_the_true_body_are_as_far_off_as_their_noise(scans: list[Scan]) -> None:
    points = [scan.points for scan in scans]
    evidence = RangeEvidence(
        [np.stack(angles_of(each), axis=1) for each in points],
        [np.linalg.norm(each, axis=1) for each in points],
        NOISE,
        SIZE,
    )
    assert evidence.reduced_chi_square(tilted(0.0)) < 1.2
    assert evidence.reduced_chi_square(tilted(0.3)) > 1.2


def test_faces_stay_where_beams_do_not_jitter(scans: list[Scan]) -> None:
    start = tilted(0.0)
    found = edge_adjusted(start, [scan.points for scan in scans], PointNoise(0.003, 0.0, 0.0), SIZE)
    assert found.faces is start.faces


def test_noise_of_azimuth_and_elevation_is_told_apart(scans: list[Scan]) -> None:
    found = identified_noise(scans)
    assert found.azimuth_std == pytest.approx(NOISE.azimuth_std, rel=0.25)
    assert found.elevation_std == pytest.approx(NOISE.elevation_std, rel=0.25)


def test_a_face_that_no_scan_tells_of_leaves_the_others_determined(scans: list[Scan]) -> None:
    """It was a singular matrix."""
    start = tilted(0.02)
    hidden = Face(ROTATIONS[0].T @ np.array([1.0, 0.0, 0.0]), 0.5)
    start = TrackedFaces(start.poses, (*start.faces, hidden), start.matches, common=start.common)
    found = edge_adjusted(start, [scan.points for scan in scans], NOISE, SIZE)
    assert np.isfinite(found.covariance).all()
    assert skewness(TrackedFaces(found.poses, found.faces[:3], found.matches)) < 1.5
