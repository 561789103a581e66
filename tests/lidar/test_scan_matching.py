"""Scans of real objects registered: the Stanford bunny in its published poses."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spinfilters.lidar.scan import read_scan
from spinfilters.lidar.scan_adjustment import match_scans

FOLDER = Path(__file__).parents[3] / "shared" / "data" / "stanford_bunny_scans"
NAMES = ("bun000", "bun045", "bun090")


@pytest.mark.skipif(not FOLDER.exists(), reason="the scans of the Stanford bunny are not there")
def test_the_bunny_is_put_together_within_a_millimetre_of_its_published_poses() -> None:
    lines = [line.split() for line in (FOLDER / "bun.conf").read_text().splitlines()]
    told = {words[1]: np.array(words[2:], dtype=float) for words in lines if words[:1] == ["bmesh"]}
    clouds = [read_scan(FOLDER / f"{name}.ply").points[::8] for name in NAMES]
    found = match_scans(
        [0.0, 1.0, 2.0], clouds, clouds[0].mean(axis=0), viewpoint=np.array([0.0, 0.1, 0.8])
    ).poses
    for name, points, pose in zip(NAMES[1:], clouds[1:], found[1:], strict=True):
        place, q = told[f"{name}.ply"][:3], told[f"{name}.ply"][3:]
        published = points @ Rotation.from_quat(q).as_matrix() + place
        own = (points - pose.translation) @ pose.rotation @ found[0].rotation.T + found[0].translation
        assert np.median(np.linalg.norm(own - published, axis=1)) < 1e-3
