"""Poses of a moving inspector beside stereo images."""

from pathlib import Path

import numpy as np
import pytest

from spinfilters.api.image_recordings import example_rig
from spinfilters.attitude.conversions import matrix_from_quaternion
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.data.pose_files import write_tum
from spinfilters.errors import InputError
from spinfilters.vision.image_folder import StampedPair
from spinfilters.vision.inspector_poses import rectified_camera_poses
from spinfilters.vision.rectification import Rectification

STAMP = 1_403_636_579_000_000_000
RECTIFICATION = Rectification(example_rig((320, 240)))


def pairs(folder: Path) -> list[StampedPair]:
    """Two pairs half a second apart, on a clock that began in 1970."""
    steps = (0, 500_000_000)
    return [StampedPair(step * 1e-9, folder, folder, STAMP + step) for step in steps]


def write_poses(folder: Path, first: float, last: float) -> np.ndarray:
    """Poses of the raw left camera at times of that clock, s."""
    half = np.sqrt(0.5)
    poses = np.array([[0.0, 0, 0, 0, 0, 0, 1], [0.3, 0.1, 0.2, 0, half, 0, half]])
    write_tum(
        folder / "inspector.tum", MeasurementStream("pose", STAMP * 1e-9 + np.array([first, last]), poses)
    )
    return poses


def test_poses_are_those_of_the_rectified_camera_from_the_first_pair_on(tmp_path: Path) -> None:
    raw = write_poses(tmp_path, -0.25, 1.0)
    found = rectified_camera_poses(tmp_path, pairs(tmp_path), RECTIFICATION)
    assert found is not None
    np.testing.assert_allclose(found.time, [-0.25, 1.0], atol=1e-6)
    ray = np.array([0.1, -0.2, 1.0])
    for pose, expected in zip(found.values, raw, strict=True):
        np.testing.assert_array_equal(pose[:3], expected[:3])
        of_rectified = matrix_from_quaternion(pose[3:]) @ RECTIFICATION.rotation @ ray
        np.testing.assert_allclose(of_rectified, matrix_from_quaternion(expected[3:]) @ ray, atol=1e-12)


def test_an_inspector_at_rest_has_no_file(tmp_path: Path) -> None:
    assert rectified_camera_poses(tmp_path, pairs(tmp_path), RECTIFICATION) is None


def test_poses_that_end_before_the_images_do_are_refused_by_name(tmp_path: Path) -> None:
    write_poses(tmp_path, -0.25, 0.4)
    with pytest.raises(InputError, match=r"inspector\.tum: camera poses are known from"):
        rectified_camera_poses(tmp_path, pairs(tmp_path), RECTIFICATION)
