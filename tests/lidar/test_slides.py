"""Panels that slide along themselves: scans leave the thickness of a body open, and its uniform drift tells it."""

import numpy as np

from spinfilters.lidar.adjustment_covariance import AdjustedScans
from spinfilters.lidar.registration import cloud_of
from spinfilters.lidar.scan import LidarNoise, RayPattern, rvs_noise
from spinfilters.lidar.scan_adjustment import adjusted_scans
from spinfilters.lidar.scan_pose import ScanPose
from spinfilters.simulation.lidar_scanner import LidarSettings, Scanner
from spinfilters.simulation.lidar_sequence import Initial, scan_sequence, scan_times, spacecraft, tumble_of

SCANS = 36
SLIDE = 0.1


def slid_scans(noise: LidarNoise) -> tuple[AdjustedScans, np.ndarray]:
    """Adjusted scans of a spacecraft whose one side slid along its panels, and their errors of place in g, m."""
    body = spacecraft()
    start = Initial(np.eye(3), np.array([32.4, 0, 0]), np.array([1.0, 2.0, 1.5]) * np.pi / 30, np.zeros(3))
    motion = tumble_of(body, start)
    scanner = Scanner.of(body, LidarSettings(RayPattern((28.0, 28.0), (90, 90)), noise))
    times = scan_times(SCANS, 1.0, 0.0)[0]
    scans = scan_sequence(scanner, motion, times, 0, lambda *_: None)
    R, t = motion.poses(times)
    clouds = [cloud_of(scan.points, np.zeros(3), 400) for scan in scans]
    size = max(cloud.size for cloud in clouds)
    # direction of the lidar in the body; its z lies along the panels and the antenna
    seen = -np.einsum("kji,kj->ki", R, t / np.linalg.norm(t, axis=1, keepdims=True))
    slid = t + np.where(seen[:, 2:] < -0.1, SLIDE, 0.0) * R[:, :, 2]
    poses = [
        ScanPose(float(time), turn, place, np.zeros((6, 6)))
        for time, turn, place in zip(times, R, slid, strict=True)
    ]
    found = adjusted_scans(clouds, poses, size, 0.01 * size)
    off = np.array(
        [
            np.einsum("ji,j->i", Q, p.translation - place)
            for Q, p, place in zip(R, found.poses, t, strict=True)
        ]
    )
    return found, off - np.median(off, axis=0)  # frame g has no place of its own


def test_scans_of_one_side_that_slid_along_the_panels_are_put_back_by_the_drift() -> None:
    """Sides that no scan sees together were 0.1 m off with deviations of 1 mm: errors of normals told of the slide."""
    adjusted, off = slid_scans(rvs_noise())
    found = adjusted.poses
    own = np.array([np.trace(p.own_covariance[:3, :3]) ** 0.5 for p in found if p.own_covariance is not None])
    # scans that see a flat panel and no more do not say where they are along it
    assert 1 <= np.count_nonzero(own > SLIDE) <= 3
    assert np.linalg.norm(off[own < SLIDE], axis=1).max() < 0.2 * SLIDE


def test_scans_without_noise_state_what_their_slides_leave() -> None:
    """Their residuals are rounding, so that open directions made the information singular, and deviations were 1e-12 m."""
    found, off = slid_scans(LidarNoise())
    errors, covariances = np.linalg.norm(off, axis=1), [p.own_covariance for p in found.poses]
    std = np.array([np.trace(found.inflation * own[:3, :3]) ** 0.5 for own in covariances if own is not None])
    assert np.isfinite(std).all()
    # a drift tells of slides alone: what panels turned about their normals for it took 8 mm of places that matches determine
    assert errors.max() < 0.02 * SLIDE
    for pose in found.poses:
        np.linalg.cholesky(pose.covariance)
    sure = std < SLIDE
    assert np.count_nonzero(sure) > SCANS / 3
    assert errors[sure].max() < 0.2 * SLIDE
    assert (errors[sure] < 4 * std[sure]).all()
