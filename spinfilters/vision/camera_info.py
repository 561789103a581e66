"""Stereo calibration by ROS camera_calibration: a `camera_info.yaml` of each camera."""

from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from spinfilters.data.input_file import path_text, value_text
from spinfilters.data.number_range import LENGTH
from spinfilters.data.sensor_yaml import SensorFile, image_size, is_rotation
from spinfilters.data.settings_files import numbers, read_yaml
from spinfilters.errors import InputError

CAMERA_INFO_FILE: Final = "camera_info.yaml"
_KEYS: Final = ("image_width", "image_height", "camera_matrix", "distortion_coefficients")


def read_camera_infos(left: Path, right: Path) -> tuple[SensorFile, SensorFile]:
    """Both cameras; the body frame is the left one.

    Rectified points are R_left p_left = R_right p_right + (b, 0, 0), with the rectification matrices and b = -P[0, 3] / P[0, 0] of
    the right projection matrix.

    Raises
    ------
    InputError: unreadable YAML, a key that is missing, numbers of another shape, matrices that are no rotations, no baseline.
    """
    settings = [read_yaml(path) for path in (left, right)]
    for path, each in zip((left, right), settings, strict=True):
        missing = next(
            (key for key in (*_KEYS, "rectification_matrix", "projection_matrix") if key not in each), None
        )
        if missing is not None:
            raise InputError(
                f"{path_text(path)}: has no {missing}; give the camera_info of a stereo calibration as ROS writes it"
            )
    R_left, R_right = (
        _rotation(path, each["rectification_matrix"])
        for path, each in zip((left, right), settings, strict=True)
    )
    projection = _matrix(right, "projection_matrix", settings[1]["projection_matrix"], (3, 4))
    baseline = -projection[0, 3] / projection[0, 0] if projection[0, 0] else np.nan
    if not np.isfinite(baseline) or baseline <= 0:
        raise InputError(
            f"{path_text(right)}: projection_matrix is {value_text(projection.tolist())} and tells no baseline; give that of the "
            "right camera, whose P[0, 3] is -fx b"
        )
    LENGTH.require(f"{path_text(right)}: the baseline", float(baseline))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R_left.T @ R_right, R_left.T @ np.array([baseline, 0.0, 0.0])
    return _camera(left, settings[0], np.eye(4)), _camera(right, settings[1], pose)


def _camera(path: Path, settings: dict[str, Any], pose: Float[np.ndarray, "4 4"]) -> SensorFile:
    K = _matrix(path, "camera_matrix", settings["camera_matrix"], (3, 3))
    size = [settings["image_width"], settings["image_height"]]
    coefficients = settings["distortion_coefficients"]
    data = coefficients.get("data") if isinstance(coefficients, dict) else coefficients
    if not isinstance(data, list):
        raise InputError(
            f"{path_text(path)}: distortion_coefficients is {value_text(coefficients)}, expected rows, cols and data; correct it"
        )
    return SensorFile(
        np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]]),
        image_size(path, numbers(path, "image_width, image_height", size, (2,))),
        pose,
        numbers(path, "distortion_coefficients", data, (len(data),)) if data else np.zeros(0),
        settings.get("distortion_model", "plumb_bob"),
    )


def _rotation(path: Path, value: Any) -> Float[np.ndarray, "3 3"]:
    matrix = _matrix(path, "rectification_matrix", value, (3, 3))
    if not is_rotation(matrix):
        raise InputError(
            f"{path_text(path)}: rectification_matrix is {value_text(matrix.tolist())}, not a rotation; correct it"
        )
    return matrix


def _matrix(path: Path, key: str, value: Any, shape: tuple[int, int]) -> Float[np.ndarray, "r c"]:
    """Of a mapping with rows, cols and data, or of numbers alone."""
    data = value.get("data") if isinstance(value, dict) else value
    return numbers(path, key, data, (shape[0] * shape[1],)).reshape(shape)
