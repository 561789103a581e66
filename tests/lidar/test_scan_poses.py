"""Poses from scans: faces with noise, shapes without faces, what a scan does not determine, motion during the scan."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from spinfilters.core.absolute_orientation import nearest_rotation
from spinfilters.core.errors import InputError
from spinfilters.lidar.adjustment_covariance import AdjustedScans
from spinfilters.lidar.mesh import TriangleMesh, box
from spinfilters.lidar.planes import PointNoise, extract_planes, identified_noise
from spinfilters.lidar.scan import (
    LidarNoise,
    Losses,
    RayPattern,
    Scan,
    rvs_noise,
    scan_of_points,
    without_isolated,
)
from spinfilters.lidar.scan_pose import ScanPose, rotation_vector
from spinfilters.lidar.scan_poses import ScanPoses, scan_poses
from spinfilters.reproduction.decoust.snapshot_frames import SEQUENCES
from spinfilters.simulation.lidar_scanner import LidarSettings, Scanner, Still, thesis_rotation
from spinfilters.simulation.lidar_sequence import (
    Initial,
    scan_sequence,
    scan_times,
    spacecraft,
    tumble_of,
)


def snapshots(distance: float, field: float, rays: int, noise: LidarNoise) -> tuple[list[Scan], np.ndarray]:
    """Scans of the thesis' cube in the poses of its first sequence, and these."""
    scanner = Scanner.of(box(), LidarSettings(RayPattern((field, field), (rays, rays)), noise))
    generator, rotations = (
        np.random.default_rng(1),
        np.array([thesis_rotation(*pose) for pose in SEQUENCES[0][1::3]]),
    )
    place = np.array([distance, 0.0, 0.0])
    return [scanner.scan(Still(R, place), float(k), generator) for k, R in enumerate(rotations)], rotations


def transition_error(poses: tuple[ScanPose, ...], rotations: np.ndarray) -> float:
    """Largest angle between measured and true rotations from scan to scan, deg."""
    errors = [
        b.rotation @ a.rotation.T @ (R @ Q.T).T
        for a, b, Q, R in zip(poses[:-1], poses[1:], rotations[:-1], rotations[1:], strict=True)
    ]
    return float(np.rad2deg(max(np.linalg.norm(rotation_vector(each)) for each in errors)))


def test_transitions_without_noise_are_exact() -> None:
    scans, rotations = snapshots(500.0, 0.24, 71, LidarNoise())
    assert transition_error(scan_poses(scans).poses, rotations) < 1e-9


@pytest.mark.parametrize(("distance", "field", "bar"), [(30.0, 4.0, 0.1), (500.0, 0.24, 4.0)])
def test_transitions_with_the_noise_of_the_specification(distance: float, field: float, bar: float) -> None:
    scans, rotations = snapshots(distance, field, 151, rvs_noise())
    found = scan_poses(scans)
    assert found.by_faces
    assert transition_error(found.poses, rotations) < bar


def test_noise_is_identified_from_the_scans() -> None:
    scans, _ = snapshots(30.0, 4.0, 201, rvs_noise())
    noise, true = identified_noise(scans), rvs_noise()
    stated = PointNoise(true.range_std, true.azimuth_std, true.elevation_std)
    for normal in (np.array([-1.0, 0, 0]), np.array([-0.8, 0.6, 0])):
        point = np.array([[30.0, 0.0, 0.0]])
        assert noise.across(point, normal)[0] == pytest.approx(stated.across(point, normal)[0], rel=0.2)


def test_noise_free_ranges_of_a_near_body_tell_no_noise_of_angles() -> None:
    """Ranges of planes are curved over the angles: at 5 m that was taken for angles three times as noisy as they are."""
    scans, _ = snapshots(5.0, 24.0, 121, LidarNoise())
    assert max(identified_noise(scans).azimuth_std, identified_noise(scans).elevation_std) < 1e-12


def tumbling(
    mesh: TriangleMesh, seed: int, count: int, duration: float = 0.0
) -> tuple[list[Scan], np.ndarray, np.ndarray]:
    """Scans of a tumbling body with noise, and its true poses."""
    start = Initial(
        Rotation.random(rng=np.random.default_rng(seed)).as_matrix(),
        np.array([30.0, 0, 0]),
        np.array([0.15, 0.2, 0.12]),
        np.array([2e-3, 1e-3, -1e-3]),
    )
    motion = tumble_of(mesh, start)
    scanner = Scanner.of(
        mesh, LidarSettings(RayPattern((4.0, 4.0), (81, 81)), rvs_noise(), duration=duration)
    )
    begin, epochs = scan_times(count, 1.0, duration)
    scans = scan_sequence(scanner, motion, begin, seed, lambda *_: None)
    R, t = motion.poses(epochs)
    return scans, R, t


def errors_of(poses: tuple[ScanPose, ...], R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Position and rotation errors, both frames g brought together as they fit best."""
    turn = nearest_rotation(np.sum([a.T @ p.rotation for a, p in zip(R, poses, strict=True)], axis=0))
    turns = [rotation_vector((a @ turn).T @ p.rotation) for a, p in zip(R, poses, strict=True)]
    sure = [k for k, p in enumerate(poses) if not p.undetermined]
    off = np.median([R[k].T @ (poses[k].translation - t[k]) for k in sure], axis=0)
    shifts = [p.translation - x - a @ off for a, p, x in zip(R, poses, t, strict=True)]
    return np.hstack([shifts, turns])


def test_a_full_turn_with_faces_coming_and_going_is_tracked_with_honest_covariance() -> None:
    scans, R, t = tumbling(box((1.0, 1.3, 0.8)), 1, 24)
    found = scan_poses(scans)
    errors = errors_of(found.poses, R, t)
    assert np.rad2deg(np.linalg.norm(errors[:, 3:], axis=1)).max() < 0.2
    nees = [e @ np.linalg.solve(p.covariance, e) for e, p in zip(errors, found.poses, strict=True)]
    assert 3.0 < np.mean(nees) < 9.0


def test_a_single_face_leaves_directions_that_are_named() -> None:
    scanner = Scanner.of(box((1.0, 1.0, 1.0)), LidarSettings(RayPattern((1.5, 1.5), (61, 61)), rvs_noise()))
    generator, still = np.random.default_rng(0), Still(np.eye(3), np.array([30.0, 0, 0]))
    found = scan_poses([scanner.scan(still, float(k), generator) for k in range(3)])
    last = found.poses[-1]
    assert len(last.undetermined) == 3
    (turn,) = (each for each in last.undetermined if each.startswith("rotation"))
    assert "1.00, " in turn
    assert last.covariance[3, 3] > 0.01 > 100 * last.covariance[4, 4]
    assert "do not determine the whole pose" in found.remarks[-1]


def test_scans_with_repeats_are_left_out_and_two_are_needed() -> None:
    scans, _ = snapshots(30.0, 4.0, 61, rvs_noise())
    empty = scan_of_points(np.zeros((0, 3)))
    assert "1 scans" in scan_poses([scans[2], empty, scans[3]]).remarks[0]
    with pytest.raises(InputError, match="at least two"):
        scan_poses([scans[0], empty])


def test_a_body_without_faces_is_registered() -> None:
    generator = np.random.default_rng(3)
    sphere = generator.standard_normal((1500, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    bumps = 1 + 0.25 * np.sin(3 * sphere[:, 0] + 1) * np.cos(4 * sphere[:, 1]) + 0.1 * sphere[:, 2]
    faces = ConvexHull(sphere).simplices
    a, b, c = np.moveaxis(sphere[faces], 1, 0)
    flip = np.einsum("ni,ni->n", np.cross(b - a, c - a), a) < 0
    faces[flip] = faces[flip][:, ::-1]
    mesh = TriangleMesh(0.6 * sphere * bumps[:, None] * np.array([1.0, 1.2, 0.8]), faces)
    scans, R, t = tumbling(mesh, 2, 6)
    found = scan_poses(scans)
    assert not found.by_faces
    errors = errors_of(found.poses, R, t)
    assert np.rad2deg(np.linalg.norm(errors[:, 3:], axis=1)).max() < 1.0
    nees = [e @ np.linalg.solve(p.covariance, e) for e, p in zip(errors, found.poses, strict=True)]
    assert 3.0 < np.mean(nees) < 14.0


def test_faces_behind_one_another_are_not_told_apart_by_their_normals() -> None:
    """Panels of a spacecraft were taken for the box before them: attitudes ended up to 180 deg off."""
    scans, R, t = tumbling(spacecraft().scaled(0.12), 0, 8)
    found = scan_poses(scans)
    assert not found.by_faces
    assert not found.doubts
    errors = errors_of(found.poses, R, t)
    assert np.rad2deg(np.linalg.norm(errors[:, 3:], axis=1)).max() < 1.0


@pytest.mark.parametrize(("noise", "all_are_found"), [(LidarNoise(), True), (rvs_noise(), False)])
def test_coarse_scans_of_a_body_with_hidden_faces_are_right_or_doubted_and_not_used(
    noise: LidarNoise, all_are_found: bool
) -> None:
    """Noise confuses panels, so that attitudes are off by any angle; what registration does not find too has no weight."""
    mesh = spacecraft()
    start = Initial(np.eye(3), np.array([32.4, 0, 0]), np.array([0.1, 0.21, 0.16]), np.zeros(3))
    scanner = Scanner.of(mesh, LidarSettings(RayPattern((28.0, 28.0), (60, 60)), noise))
    scans = scan_sequence(scanner, tumble_of(mesh, start), scan_times(8, 1.0, 0.0)[0], 0, lambda *_: None)
    motion = tumble_of(mesh, start)
    found = scan_poses(scans)
    assert found.by_faces
    assert any("are not used" in each for each in found.doubts) != all_are_found
    assert len(found.poses) == 8 if all_are_found else 4 <= len(found.poses) < 8
    R, t = motion.poses(np.array([pose.time for pose in found.poses]))
    errors = errors_of(found.poses, R, t)
    assert np.rad2deg(np.linalg.norm(errors[:, 3:], axis=1)).max() < 1.0


def test_a_sequence_in_which_no_attitude_is_confirmed_is_refused() -> None:
    mesh = spacecraft()
    start = Initial(np.eye(3), np.array([32.4, 0, 0]), np.array([0.1, 0.21, 0.16]), np.zeros(3))
    scanner = Scanner.of(mesh, LidarSettings(RayPattern((28.0, 28.0), (40, 40)), rvs_noise()))
    scans = scan_sequence(scanner, tumble_of(mesh, start), scan_times(8, 1.0, 0.0)[0], 0, lambda *_: None)
    with pytest.raises(InputError, match="8 of 8 scans are not used"):
        scan_poses(scans)


def test_too_few_points_to_register_a_body_are_refused() -> None:
    """Of 106 points a scan, attitudes that two ways confirmed were off by up to 7.5 deg."""
    body = spacecraft().scaled(0.12)
    start = Initial(np.eye(3), np.array([30.0, 0, 0]), np.array([0.1, 0.21, 0.16]), np.zeros(3))
    scanner = Scanner.of(body, LidarSettings(RayPattern((4.0, 4.0), (25, 25)), rvs_noise()))
    scans = scan_sequence(scanner, tumble_of(body, start), scan_times(6, 1.0, 0.0)[0], 0, lambda *_: None)
    with pytest.raises(InputError, match=r"points a scan are too few .* give scans of 150 points or more"):
        scan_poses(scans)


def test_planes_are_those_of_the_body_and_their_covariance_is_honest() -> None:
    scanner = Scanner.of(box(), LidarSettings(RayPattern((4.0, 4.0), (81, 81)), LidarNoise(range_std=0.003)))
    R, noise, generator = thesis_rotation(30, 50, 0), PointNoise(0.003, 0.0, 0.0), np.random.default_rng(5)
    squares = []
    for _ in range(8):
        points = scanner.scan(Still(R, np.array([30.0, 0, 0])), 0.0, generator).points
        planes, share = extract_planes(points, noise, generator)
        assert len(planes) == 3
        assert share > 0.97
        for plane in planes:
            true = R[:, np.argmax(np.abs(plane.normal @ R))] * np.sign(
                plane.normal @ R[:, np.argmax(np.abs(plane.normal @ R))]
            )
            offset = true @ (plane.centroid - [30.0, 0, 0]) - 0.5
            error = np.array([*(plane.tangents.T @ true), -offset])
            squares.append(error @ np.linalg.solve(plane.covariance, error))
    assert 2.0 < np.mean(squares) < 4.5


@pytest.mark.parametrize(("contradicted", "doubted"), [(0, False), (1, False), (3, True), (20, True)])
def test_planes_that_contradict_the_drift_are_told_and_doubted(contradicted: int, doubted: bool) -> None:
    found = poses_of(contradicted)
    assert bool(found.remarks) == bool(contradicted)
    assert bool(found.doubts) == doubted


def poses_of(contradicted: int) -> ScanPoses:
    """Of 24 scans that see all faces of a box, of which so many are said to contradict its drift."""
    scans, *_ = tumbling(box((1.0, 1.3, 0.8)), 1, 4)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "spinfilters.lidar.scan_poses.edge_adjusted",
            lambda tracked, *_: replace(
                tracked, contradicted=contradicted, poses=tracked.poses * 6, common=tracked.common * 6
            ),
        )
        return scan_poses(scans)


@pytest.mark.parametrize(("matched", "doubted"), [(600, False), (200, True)])
def test_registered_scans_that_share_little_surface_are_doubted(
    matched: int, doubted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    poses = [ScanPose(float(k), np.eye(3), np.zeros(3), np.eye(6), matched=matched) for k in range(3)]
    monkeypatch.setattr("spinfilters.lidar.scan_poses.match_scans", lambda *_: AdjustedScans(tuple(poses)))
    cloud = np.random.default_rng(0).normal([10.0, 0.0, 0.0], 1.0, (1000, 3))
    found = scan_poses([scan_of_points(cloud, float(k)) for k in range(3)])
    assert not found.by_faces
    assert bool([each for each in found.doubts if "may be turned wrongly" in each]) == doubted


def test_returns_of_dust_and_clutter_are_left_out_and_told() -> None:
    scanner = Scanner.of(
        box((1.0, 1.3, 0.8)),
        LidarSettings(RayPattern((4.0, 4.0), (61, 61)), rvs_noise(), Losses(clutter=0.5)),
    )
    R, generator = thesis_rotation(20, 30, 10), np.random.default_rng(0)
    scans = [scanner.scan(Still(R, np.array([30.0, 0, 0])), float(k), generator) for k in range(2)]
    found = scan_poses(scans)
    assert found.by_faces
    assert "% of the points are isolated" in found.remarks[0]
    off = found.scans[0].points @ R - np.array([30.0, 0, 0]) @ R
    beyond = (np.abs(off) > np.array([0.5, 0.65, 0.4]) + 0.02).any(axis=1)
    assert np.count_nonzero(beyond) < 0.05 * len(off)  # of one half
    assert len(off) > 0.9 * 0.5 * np.count_nonzero(scans[0].is_return)


def test_no_point_of_a_clean_body_is_taken_for_clutter() -> None:
    for scan in snapshots(30.0, 4.0, 61, rvs_noise())[0]:
        assert without_isolated(scan)[1] <= 2


def test_thousands_of_points_in_one_spot_are_one_point() -> None:
    scans = snapshots(30.0, 4.0, 61, rvs_noise())[0][:3]
    spot = [with_repeats(scan, 3000) for scan in scans]
    found, alone = scan_poses(spot), scan_poses(scans)
    assert found.by_faces
    np.testing.assert_allclose(found.poses[-1].rotation, alone.poses[-1].rotation, atol=1e-9)
    with pytest.raises(InputError, match="at least two"):
        scan_poses([scan_of_points(np.tile([[30.0, 0.1, 0.2]], (500, 1)), float(k)) for k in range(3)])


def with_repeats(scan: Scan, repeats: int) -> Scan:
    """A scan whose first return is there so many times more."""
    first = np.flatnonzero(scan.is_return)[:1].repeat(repeats)
    rows = np.concatenate([np.arange(len(scan)), first])
    names = ("time", "azimuth", "elevation", "distance", "intensity", "flag", "window")
    return replace(scan, **{name: getattr(scan, name)[rows] for name in names})


def test_points_that_all_lie_in_one_place_are_refused() -> None:
    generator = np.random.default_rng(0)
    spots = [np.array([30.0, 0.1, 0.2]) + 1e-12 * generator.standard_normal((500, 3)) for _ in range(3)]
    with pytest.raises(InputError, match=r"one place|at least two"):
        scan_poses([scan_of_points(points, float(k)) for k, points in enumerate(spots)])
