"""Numbers of scans that an accuracy takes."""

import numpy as np
import pytest

from spinfilters.lidar.scan_pose import ScanPose, attitude_stds, scans_needed


def poses(*stds: tuple[float, float, float]) -> list[ScanPose]:
    """With standard deviations of the three rotations, rad."""
    covariances = [np.diag([1.0, 1.0, 1.0, *np.square(each)]) for each in stds]
    return [ScanPose(float(k), np.eye(3), np.zeros(3), P) for k, P in enumerate(covariances)]


def test_four_scans_are_twice_as_accurate_as_one() -> None:
    alike = poses(*[(1e-3, 1e-3, 2e-3)] * 4)
    np.testing.assert_allclose(attitude_stds(alike), 2e-3 / np.sqrt([1, 2, 3, 4]))
    assert scans_needed(alike, 2e-3) == 1
    assert scans_needed(alike, 1e-4) == pytest.approx(400, abs=1)


def test_scans_that_each_lack_a_rotation_count_for_what_they_tell() -> None:
    lacking = poses((0.2, 1e-3, 1e-3), (1e-3, 0.2, 1e-3))
    stds = attitude_stds(lacking)
    assert stds[0] == pytest.approx(0.2)
    assert stds[1] == pytest.approx(1e-3, rel=1e-3)
    assert scans_needed(lacking, 1e-3) == 2
