"""Scans of real objects registered: the Stanford bunny in its published poses."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spinfilters.core.absolute_orientation import nearest_rotation
from spinfilters.core.attitude_conversions import angle_from_matrix
from spinfilters.lidar.scan import LidarNoise, RayPattern, read_scan
from spinfilters.lidar.scan_adjustment import match_scans
from spinfilters.lidar.scan_pose import rotation_std
from spinfilters.simulation.lidar_scanner import LidarSettings, Scanner, thesis_rotation
from spinfilters.simulation.lidar_sequence import Initial, scan_sequence, scan_times, spacecraft, tumble_of

FOLDER = Path(__file__).parents[3] / "shared" / "data" / "stanford_bunny_scans"
NAMES = ("bun000", "bun045", "bun090")
EDGE_ON = (114.1, 90.6, 13.6)
"""Deg: the edge of the spacecraft's panels is seen, and no more."""


@pytest.mark.skipif(not FOLDER.exists(), reason="the scans of the Stanford bunny are not there")
def test_the_bunny_is_put_together_within_a_millimetre_of_its_published_poses() -> None:
    lines = [line.split() for line in (FOLDER / "bun.conf").read_text().splitlines()]
    told = {words[1]: np.array(words[2:], dtype=float) for words in lines if words[:1] == ["bmesh"]}
    clouds = [read_scan(FOLDER / f"{name}.ply").points[::16] for name in NAMES]
    found = match_scans(
        [0.0, 1.0, 2.0], clouds, clouds[0].mean(axis=0), viewpoint=np.array([0.0, 0.1, 0.8])
    ).poses
    for name, points, pose in zip(NAMES[1:], clouds[1:], found[1:], strict=True):
        place, q = told[f"{name}.ply"][:3], told[f"{name}.ply"][3:]
        published = points @ Rotation.from_quat(q).as_matrix() + place
        own = (points - pose.translation) @ pose.rotation @ found[0].rotation.T + found[0].translation
        assert np.median(np.linalg.norm(own - published, axis=1)) < 1e-3


@pytest.mark.parametrize("range_std", [0.0, 0.01])
def test_a_thin_side_seen_first_does_not_turn_the_scans_behind(range_std: float) -> None:
    """The edge of a panel shares hardly a surface with the next scan: a wrong first rotation turned all others by up to 180 deg."""
    body, rate = spacecraft(), np.array([1.0, 2.0, 1.5]) * np.pi / 30
    start = Initial(thesis_rotation(*EDGE_ON), np.array([32.4, 0.0, 0.0]), rate, np.zeros(3))
    motion, times = tumble_of(body, start), scan_times(6, 1.0, 0.0)[0]
    scanner = Scanner.of(body, LidarSettings(RayPattern((32.0, 32.0), (70, 70)), LidarNoise(range_std)))
    clouds = [scan.points for scan in scan_sequence(scanner, motion, times, 0, lambda *_: None)]
    found, true = match_scans(times.tolist(), clouds, clouds[0].mean(axis=0)).poses, motion.poses(times)[0]
    body_side = np.array([pose.rotation.T @ R for pose, R in zip(found, true, strict=True)])
    apart = angle_from_matrix(nearest_rotation(body_side @ body_side[3].T))
    # a rotation about the normal of the side seen first is open, and said to be
    assert (apart < np.maximum(np.deg2rad(1.0), 4 * np.array([rotation_std(pose) for pose in found]))).all()
    assert np.rad2deg(apart[1:]).max() < 1.0
