"""Calibrations that ROS wrote."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from spinfilters.core.errors import InputError
from spinfilters.simulation.image_sequence import example_rig
from spinfilters.vision.rectification import RawRig, read_raw_rig


def _matrix(values: np.ndarray) -> dict[str, Any]:
    rows, cols = np.atleast_2d(values).shape
    return {"rows": rows, "cols": cols, "data": np.ravel(values).tolist()}


def _written(folder: Path, rig: RawRig, **changed: Any) -> Path:
    """As camera_calibration writes it; changes are of the right camera."""
    left, right = rig.left, rig.right
    rotations = cv2.stereoRectify(
        *(left.camera_matrix, left.distortion, right.camera_matrix, right.distortion, rig.size),
        rig.relative_rotation,
        rig.relative_position.reshape(3, 1),
    )[:4]
    for number, camera in enumerate((left, right)):
        document = {
            "image_width": camera.width,
            "image_height": camera.height,
            "camera_name": ("left", "right")[number],
            "camera_matrix": _matrix(camera.camera_matrix),
            "distortion_model": "plumb_bob",
            "distortion_coefficients": _matrix(camera.distortion),
            "rectification_matrix": _matrix(np.asarray(rotations[number])),
            "projection_matrix": _matrix(np.asarray(rotations[2 + number])),
        }
        path = folder / f"cam{number}" / "camera_info.yaml"
        path.parent.mkdir()
        document |= changed if number else {}
        path.write_text(yaml.safe_dump({key: each for key, each in document.items() if each is not None}))
    return folder


def test_a_rig_of_ros_is_the_rig_that_was_calibrated(tmp_path: Path) -> None:
    rig = example_rig()
    found = read_raw_rig(_written(tmp_path, rig))
    assert found.relative_rotation == pytest.approx(rig.relative_rotation, abs=1e-12)
    assert found.relative_position == pytest.approx(rig.relative_position, abs=1e-12)
    for one, other in ((found.left, rig.left), (found.right, rig.right)):
        assert np.array_equal(one.intrinsics, other.intrinsics)
        assert np.array_equal(one.distortion, other.distortion)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"projection_matrix": None}, "has no projection_matrix"),
        ({"projection_matrix": _matrix(np.eye(3, 4))}, "gives no baseline"),
        ({"projection_matrix": _matrix(np.zeros((3, 4)))}, "gives no baseline"),
        ({"rectification_matrix": _matrix(2 * np.eye(3))}, "not a rotation"),
        ({"rectification_matrix": "x"}, "rectification_matrix"),
        ({"camera_matrix": _matrix(np.eye(2))}, "camera_matrix"),
        ({"image_width": 640.5}, "640.5"),
        ({"distortion_model": "rational_polynomial"}, "rational_polynomial"),
        ({"distortion_coefficients": {"data": [0.1] * 8}}, "expected k1, k2, p1, p2"),
        ({"distortion_coefficients": 3}, "distortion_coefficients"),
    ],
)
def test_what_is_no_camera_info_of_a_pair_is_refused_with_its_file(
    changed: dict[str, Any], words: str, tmp_path: Path
) -> None:
    folder = _written(tmp_path, example_rig(), **changed)
    with pytest.raises(InputError, match=r"cam1/camera_info.yaml") as caught:
        read_raw_rig(folder)
    assert words in str(caught.value)
    assert len(str(caught.value)) < 600
