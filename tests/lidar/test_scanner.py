"""Scans: patterns, errors in three modes, losses, motion during the scan, files."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.core.ray_angles import unit_vectors
from spinfilters.lidar.mesh import box
from spinfilters.lidar.scan import (
    DUST,
    MISS,
    RETURN,
    SATURATED,
    WEAK,
    HighResolutionWindow,
    LidarNoise,
    Losses,
    RayPattern,
    Scan,
    read_scan,
    rvs_noise,
    write_scan,
)
from spinfilters.simulation.lidar_scanner import LidarSettings, Scanner, Still
from spinfilters.simulation.lidar_sequence import Initial, scan_times, tumble_of

WALL = Still(np.eye(3), np.array([100.0, 0.0, 0.0]))
NARROW = RayPattern((0.4, 0.4), (60, 60))


def scan_of(settings: LidarSettings, motion: Still = WALL, seed: int = 0) -> Scan:
    return Scanner.of(box((1.0, 4.0, 4.0)), settings).scan(motion, 0.0, np.random.default_rng(seed))


def test_windows_of_table_2_1_begin_at_rays_and_end_at_the_field_of_view() -> None:
    windows = (HighResolutionWindow(20, 14, 25, 5), HighResolutionWindow(5, 8, 1, 6))
    rays = RayPattern((50.0, 50.0), (5, 10), windows).directions()
    grid = np.linspace(-25, 25, 10)
    first, second = (np.rad2deg(rays.elevation[rays.window == k]) for k in (1, 2))
    assert np.unique(first.round(9)).tolist() == pytest.approx([grid[8], (grid[8] + grid[9]) / 2, grid[9]])
    assert np.unique(second.round(9))[::2].tolist() == pytest.approx(grid[5:8].tolist())
    assert np.unique(np.rad2deg(rays.azimuth[rays.window == 2]).round(9)).tolist() == pytest.approx(
        [0, 6.25, 12.5]
    )
    pairs = np.stack([rays.azimuth, rays.elevation], axis=1).round(12)
    assert len(np.unique(pairs, axis=0)) == len(pairs)


def test_a_window_beside_the_field_of_view_is_refused() -> None:
    with pytest.raises(InputError, match="outside the field of view"):
        RayPattern((10.0, 10.0), (5, 5), (HighResolutionWindow(6, 2, 0, 1),))


@pytest.mark.parametrize(
    ("mode", "across", "along"), [("jitter", False, True), ("encoder", True, False), ("thesis", True, True)]
)
def test_each_mode_of_angle_noise_moves_what_it_says(mode: str, across: bool, along: bool) -> None:
    noise = LidarNoise(azimuth_std=1e-4, elevation_std=2e-4, mode=mode)  # pyright: ignore[reportArgumentType]
    tilted = Still(np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]]), np.array([100.0, 0, 0]))
    exact, noisy = (scan_of(LidarSettings(NARROW, each), tilted) for each in (LidarNoise(), noise))
    assert (np.std(noisy.azimuth - exact.azimuth) > 0) == across
    assert (np.std(noisy.distance - exact.distance) > 0) == along
    if across:
        assert np.std(noisy.elevation - exact.elevation) == pytest.approx(2e-4, rel=0.05)
    normal = tilted.rotation @ [-1, 0, 0]
    residual = np.std((noisy.points - tilted.translation) @ normal)
    assert (residual > 1e-3) == (mode != "thesis")  # the thesis' points stay on the surface


def test_range_noise_and_biases_are_those_of_the_specification() -> None:
    exact, noisy = (
        scan_of(LidarSettings(NARROW, each)) for each in (LidarNoise(), rvs_noise("encoder", True, True))
    )
    error = noisy.distance - exact.distance
    assert np.mean(error) == pytest.approx(0.5, abs=0.003)
    assert np.std(error) == pytest.approx(0.1 / 3, rel=0.05)
    assert np.rad2deg(np.mean(noisy.azimuth - exact.azimuth)) == pytest.approx(0.1, rel=0.01)


def test_intensity_is_the_cosine_of_incidence() -> None:
    rotation = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]])
    scan = scan_of(
        LidarSettings(RayPattern((1e-3, 1e-3), (5, 5)), losses=Losses(0.5)),
        Still(rotation, np.array([100.0, 0, 0])),
    )
    np.testing.assert_allclose(scan.intensity, 0.4, rtol=1e-4)


@pytest.mark.parametrize(
    ("losses", "flag"),
    [
        (Losses(weakest=26.0), WEAK),
        (Losses(strongest=24.0), SATURATED),
        (Losses(sun=(-1.0, 0.0, 0.0)), SATURATED),
        (Losses(dust=1.0), DUST),
    ],
)
def test_each_loss_has_its_flag(losses: Losses, flag: int) -> None:
    scan = scan_of(LidarSettings(NARROW, losses=losses))
    assert set(scan.flag.tolist()) == {flag}
    assert not scan.is_return.any()
    assert np.isnan(scan.distance).all()


def test_a_miss_is_flagged_and_clutter_lies_before_the_body() -> None:
    scan = scan_of(LidarSettings(RayPattern((10.0, 10.0), (60, 60)), losses=Losses(clutter=0.5)))
    assert set(scan.flag.tolist()) == {MISS, RETURN}
    assert (scan.distance[scan.is_return] < 101.0).all()
    assert 0.3 < np.mean(scan.distance[scan.is_return] < 99.0) < 0.7


def test_rays_meet_the_body_where_it_is_at_their_own_time() -> None:
    mesh = box((1.0, 2.0, 3.0))
    motion = tumble_of(
        mesh,
        Initial(np.eye(3), np.array([30.0, 0, 0]), np.array([0.3, -0.2, 0.5]), np.array([0.1, 0.2, -0.1])),
    )
    scanner = Scanner.of(mesh, LidarSettings(RayPattern((8.0, 8.0), (40, 40)), duration=2.0))
    scan = scanner.scan(motion, 1.0, np.random.default_rng(0))
    assert (scan.time[0], scan.time[-1] < 3.0) == (1.0, True)
    R, t = motion.poses(scan.point_times)
    body = np.einsum("nji,nj->ni", R, scan.points - t)
    assert len(body) > 300
    on_surface = np.abs(np.abs(body) - np.array([0.5, 1.0, 1.5])).min(axis=1)
    assert on_surface.max() < 1e-12


def test_the_true_rate_turns_the_true_attitude() -> None:
    motion = tumble_of(
        box((1.0, 2.0, 3.0)), Initial(np.eye(3), np.zeros(3), np.array([0.3, -0.2, 0.5]), np.zeros(3))
    )
    h = 1e-5
    R, _ = motion.poses(np.array([1.0 - h, 1.0, 1.0 + h]))
    W = (R[2] - R[0]) / (2 * h) @ R[1].T
    np.testing.assert_allclose([W[2, 1], W[0, 2], W[1, 0]], motion.rates(np.array([1.0]))[0], atol=1e-9)


def test_scans_that_overlap_are_refused() -> None:
    with pytest.raises(InputError, match="overlap"):
        scan_times(3, 1.0, 2.0)


def test_a_scan_is_read_as_it_was_written(tmp_path: Path) -> None:
    scan = scan_of(LidarSettings(RayPattern((10.0, 10.0), (20, 20)), rvs_noise(), duration=1.0))
    write_scan(tmp_path / "a.ply", scan, misses=True)
    read = read_scan(tmp_path / "a.ply")
    for name in ("time", "azimuth", "elevation", "distance", "intensity", "flag", "window"):
        np.testing.assert_array_equal(getattr(read, name), getattr(scan, name))
    assert read.metadata["rays"] == 400
    write_scan(tmp_path / "b.ply", scan)
    np.testing.assert_array_equal(read_scan(tmp_path / "b.ply").points, scan.points)
    for name in ("c.pcd", "c.csv"):
        write_scan(tmp_path / name, scan)
    lines = (tmp_path / "c.csv").read_text().splitlines()
    assert len(lines) == 2 + np.count_nonzero(scan.is_return)
    np.testing.assert_array_equal([float(x) for x in lines[2].split(",")[:3]], scan.points[0])
    raw = (tmp_path / "c.pcd").read_bytes()
    start = raw.index(b"DATA binary\n") + 12
    assert len(raw) - start == (8 * 8 + 1 + 4) * np.count_nonzero(scan.is_return)
    np.testing.assert_array_equal(np.frombuffer(raw, "<f8", 3, start), scan.points[0])


def test_a_cloud_of_another_program_is_read_as_points(tmp_path: Path) -> None:
    head = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    (tmp_path / "a.ply").write_text(head + "1 2 3\n4 5 6\n")
    np.testing.assert_allclose(read_scan(tmp_path / "a.ply").points, [[1, 2, 3], [4, 5, 6]], rtol=1e-12)
    for content, says in (
        (head.replace("vertex 2", "vertex 0"), "no point"),
        (head + "1 2 nan\n4 5 6\n", "not finite"),
    ):
        (tmp_path / "a.ply").write_text(content)
        with pytest.raises(InputError, match=says):
            read_scan(tmp_path / "a.ply")


def test_directions_follow_the_axes_of_the_lidar() -> None:
    up, right = unit_vectors(np.array([0.0, 0.1]), np.array([0.1, 0.0]))
    assert up[1] > 0
    assert right[2] > 0


@pytest.mark.parametrize(
    ("old", "new"), [(b'"rays"', b'"rays'), (b"{", b"["), (b'"start_s": 0.0', b'"start_s": NaN')]
)
def test_damaged_metadata_of_a_scan_are_passed_over(old: bytes, new: bytes, tmp_path: Path) -> None:
    write_scan(tmp_path / "a.ply", scan_of(LidarSettings(NARROW, duration=1.0)))
    content = (tmp_path / "a.ply").read_bytes()
    (tmp_path / "a.ply").write_bytes(content.replace(old, new, 1))
    assert read_scan(tmp_path / "a.ply").epoch == pytest.approx(0.5, abs=0.01)


def test_a_scan_with_a_time_that_is_not_finite_is_refused(tmp_path: Path) -> None:
    scan = scan_of(LidarSettings(NARROW))
    write_scan(tmp_path / "a.ply", replace(scan, time=np.full(len(scan), np.nan)))
    with pytest.raises(InputError, match="not finite"):
        read_scan(tmp_path / "a.ply")
