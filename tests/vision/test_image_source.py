"""Inspector and truth beside stereo images, on the images' clock."""

from pathlib import Path

import numpy as np
import pytest

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.errors import InputError
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.sensor_tables import write_tum
from spinfilters.io.truth import Truth, write_truth
from spinfilters.simulation.image_sequence import example_rig
from spinfilters.vision.image_folder import LossCount, StampedPair
from spinfilters.vision.rectification import Rectification, write_raw_rig
from spinfilters.vision.track_images import read_image_source, rectified_camera_poses

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


def test_images_on_a_real_clock_are_covered_to_the_last_pair(tmp_path: Path) -> None:
    write_poses(tmp_path, 0.0, 0.5)
    found = rectified_camera_poses(tmp_path, pairs(tmp_path), RECTIFICATION)
    assert found is not None
    assert found.time.tolist() == [0.0, 0.5]


def test_poses_in_ns_are_refused(tmp_path: Path) -> None:
    write_poses(tmp_path, -1e8, 1e9)
    with pytest.raises(InputError, match=r"inspector\.tum: poses are 1\.1e\+09 s apart"):
        rectified_camera_poses(tmp_path, pairs(tmp_path), RECTIFICATION)


def stamped(folder: Path, stamps: list[int]) -> Path:
    """A folder of images that are not there, at these times, ns."""
    write_raw_rig(example_rig((320, 240)), folder)
    for camera in ("cam0", "cam1"):
        (folder / camera / "data").mkdir(exist_ok=True)
        lines = [f"{stamp},{stamp}.png" for stamp in stamps]
        (folder / camera / "data.csv").write_text("\n".join(lines) + "\n")
    return folder


def truth_at(time: np.ndarray) -> Truth:
    """A body that does nothing."""
    n = len(time)
    return Truth(
        time,
        np.tile([0.0, 0, 1], (n, 1)),
        np.tile([0.0, 0, 0, 1], (n, 1)),
        np.zeros((n, 3)),
        np.zeros((n, 3)),
    )


def test_a_truth_is_told_from_the_first_pair_on(tmp_path: Path) -> None:
    folder = stamped(tmp_path, [STAMP + 500_000_000, STAMP + 1_000_000_000])
    write_truth(truth_at(STAMP * 1e-9 + np.array([0.0, 0.5, 1.0])), folder)
    truth = read_image_source(folder, LossCount()).truth
    assert truth is not None
    assert truth.time[1:].tolist() == [0.0, 0.5]
    assert truth.time[0] == pytest.approx(-0.5, abs=1e-6)


def test_a_truth_of_another_clock_is_refused(tmp_path: Path) -> None:
    folder = stamped(tmp_path, [STAMP, STAMP + 500_000_000])
    write_truth(truth_at(np.array([0.0, 0.5])), folder)
    with pytest.raises(InputError, match=r"truth\.csv: is from 0 s to 0\.5 s, the images"):
        read_image_source(folder, LossCount())


def test_numbers_of_images_are_no_times(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="3 pairs are 1e-09 s apart by their stamps"):
        read_image_source(stamped(tmp_path, [0, 1, 2]), LossCount())


def test_an_inspector_at_rest_has_no_file(tmp_path: Path) -> None:
    assert rectified_camera_poses(tmp_path, pairs(tmp_path), RECTIFICATION) is None


def test_poses_that_end_before_the_images_do_are_refused_by_name(tmp_path: Path) -> None:
    write_poses(tmp_path, -0.25, 0.4)
    with pytest.raises(
        InputError, match=r"inspector\.tum: from the first pair on, camera poses are known from"
    ):
        rectified_camera_poses(tmp_path, pairs(tmp_path), RECTIFICATION)
