"""A raw stereo pair: two pinhole cameras with lens distortion.

The files are `sensor.yaml` of the EuRoC layout.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from spinfilters.data.atomic_write import make_folder, write_text
from spinfilters.data.camera import CAMERA_RANGES, RIG_FILES
from spinfilters.data.input_file import path_text, value_text
from spinfilters.data.sensor_yaml import (
    DISTORTION_KEY,
    SensorFile,
    image_size,
    is_rotation,
    read_sensor_file,
    read_yaml,
    sensor_text,
)
from spinfilters.data.sensor_yaml import DISTORTION_MODELS as NAMED_MODELS
from spinfilters.data.stated_values import LENGTH, NumberRange
from spinfilters.data.table_files import numbers
from spinfilters.errors import InputError

DISTORTION_MODELS: Final = (*NAMED_MODELS, "none")
DISTORTION: Final = NumberRange(-1e3, 1e3)
COEFFICIENTS: Final = (0, 4, 5)
"""Of the Brown model: none, (k1, k2, p1, p2), or these and k3."""


@dataclass(frozen=True, eq=False)
class RawCamera:
    """One camera: p_raw = K distort(p_c / z).

    Attributes
    ----------
    intrinsics: (fx, fy, cx, cy), px.   distortion: (k1, k2, p1, p2, k3), Brown.   width, height: px.
    R_bc, t_bc: pose of the camera in the body frame of the rig, m.
    """

    intrinsics: Float[np.ndarray, " 4"]
    distortion: Float[np.ndarray, " 5"]
    width: int
    height: int
    R_bc: Float[np.ndarray, "3 3"]
    t_bc: Float[np.ndarray, " 3"]

    @property
    def camera_matrix(self) -> Float[np.ndarray, "3 3"]:
        """Camera matrix, px."""
        fx, fy, cx, cy = self.intrinsics
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, eq=False)
class RawRig:
    """Left and right camera.

    Raises
    ------
    InputError: images of different sizes, cameras at one place.
    """

    left: RawCamera
    right: RawCamera

    def __post_init__(self) -> None:
        sizes = [(camera.width, camera.height) for camera in (self.left, self.right)]
        if sizes[0] != sizes[1]:
            raise InputError(
                f"the cameras' resolutions {sizes[0]} and {sizes[1]} differ; give images of one size"
            )
        if not np.linalg.norm(self.relative_position) > 0:
            raise InputError("both cameras are at one place; T_BS of cam1 must tell the baseline")

    @property
    def relative_rotation(self) -> Float[np.ndarray, "3 3"]:
        """Rotation from the left camera to the right one."""
        return self.right.R_bc.T @ self.left.R_bc

    @property
    def relative_position(self) -> Float[np.ndarray, " 3"]:
        """Place of the left camera in the right one, m."""
        return self.right.R_bc.T @ (self.left.t_bc - self.right.t_bc)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.left.width, self.left.height


def read_raw_rig(folder: Path) -> RawRig:
    """Rig of `cam0/sensor.yaml` (left) and `cam1/sensor.yaml` (right), or of ROS' `camera_info.yaml` in their places.

    Raises
    ------
    InputError: unreadable YAML, not a pinhole with Brown distortion, numbers out of range, images of different sizes.
    """
    infos = [folder / file.parent / CAMERA_INFO_FILE for file in RIG_FILES]
    told = all(info.is_file() for info in infos) and not any((folder / file).exists() for file in RIG_FILES)
    missing = next((folder / file for file in RIG_FILES if not told and not (folder / file).exists()), None)
    if missing is not None:
        raise InputError(
            f"{path_text(missing)}: no such file; write that camera's calibration there (spinfilters calibrate)"
        )
    left, right = (
        read_camera_infos(*infos) if told else [read_sensor_file(folder / file) for file in RIG_FILES]
    )
    files = infos if told else [folder / file for file in RIG_FILES]
    cameras = [raw_camera(path, each) for path, each in zip(files, (left, right), strict=True)]
    try:
        return RawRig(*cameras)
    except InputError as error:
        raise InputError(f"{path_text(files[1])}: {error}") from None


def raw_camera(path: Path, told: SensorFile) -> RawCamera:
    """Camera of what a file tells; its rotation is made exact. InputError: as `read_raw_rig`."""
    if told.model not in DISTORTION_MODELS:
        raise InputError(
            f"{path_text(path)}: distortion_model is {value_text(told.model)}; only {', '.join(DISTORTION_MODELS)} is known"
        )
    values = zip(
        ("fx", "fy", "cx", "cy", "width", "height"), (*told.intrinsics.tolist(), *told.size), strict=True
    )
    for key, value in values:
        CAMERA_RANGES[key].require(f"{path_text(path)}: {key}", value)
    U, _, Vt = np.linalg.svd(told.pose[:3, :3])
    return RawCamera(
        told.intrinsics, _distortion(path, told.distortion), *told.size, U @ Vt, told.pose[:3, 3]
    )


def write_raw_rig(rig: RawRig, folder: Path, deviations: Sequence[str] = ("", "")) -> None:
    """Write both `sensor.yaml` files below the folder. Atomic each.

    Parameters
    ----------
    deviations: lines of `deviations_text` for each camera.
    """
    for camera, file, stated in zip((rig.left, rig.right), RIG_FILES, deviations, strict=True):
        make_folder((folder / file).parent)
        write_text(folder / file, camera_text(camera) + stated)


def camera_text(camera: RawCamera) -> str:
    """A `sensor.yaml`; the fifth coefficient stands where it is not zero."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = camera.R_bc, camera.t_bc
    distortion = camera.distortion.tolist()
    size = camera.width, camera.height
    return sensor_text(
        camera.intrinsics.tolist(), size, pose, distortion if distortion[4] else distortion[:4]
    )


def _distortion(path: Path, given: Float[np.ndarray, " k"]) -> Float[np.ndarray, " 5"]:
    if len(given) not in COEFFICIENTS:
        raise InputError(
            f"{path_text(path)}: {DISTORTION_KEY} is {value_text(given.tolist())}, expected k1, k2, p1, p2, perhaps k3; correct it"
        )
    for number in given.tolist():
        DISTORTION.require(f"{path_text(path)}: {DISTORTION_KEY}: a number", number)
    return np.concatenate([given, np.zeros(5 - len(given))])


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
    """Matrix of a mapping with rows, cols and data, or of numbers alone."""
    data = value.get("data") if isinstance(value, dict) else value
    return numbers(path, key, data, (shape[0] * shape[1],)).reshape(shape)
