"""Raw stereo rigs with distortion, and the rectification of their images."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from spinfilters.core.absolute_orientation import nearest_rotation
from spinfilters.core.attitude_conversions import inverse, multiply, quaternion_from_matrix
from spinfilters.core.errors import InputError
from spinfilters.io.camera import (
    CAMERA_RANGES,
    DISTORTION_KEY,
    RIG_FILES,
    PinholeCamera,
    SensorFile,
    StereoRig,
    image_size,
    is_rotation,
    read_sensor_file,
    sensor_text,
)
from spinfilters.io.camera import DISTORTION_MODELS as NAMED_MODELS
from spinfilters.io.document import numbers, read_yaml
from spinfilters.io.input_file import path_text, value_text
from spinfilters.io.output_files import make_folder, write_text
from spinfilters.io.stated_values import LENGTH, NumberRange
from spinfilters.io.truth import Truth

DISTORTION_MODELS: Final = (*NAMED_MODELS, "none")
DISTORTION: Final = NumberRange(-1e3, 1e3)
COEFFICIENTS: Final = (0, 4, 5)
"""Of the Brown model: none, (k1, k2, p1, p2), or these and k3."""


@dataclass(frozen=True, eq=False)
class RawCamera:
    """One camera: p_raw = K distort(p_c / z).

    Attributes
    ----------
    intrinsics : ndarray of shape (4,)
        (fx, fy, cx, cy), px.
    distortion : ndarray of shape (5,)
        (k1, k2, p1, p2, k3), Brown.
    width, height : int
        px.
    R_bc, t_bc : ndarray of shape (3, 3) and ndarray of shape (3,)
        Pose of the camera in the body frame of the rig, m.
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
    InputError
        Images of different sizes, cameras at one place.
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
            raise InputError("both cameras are at one place; T_BS of cam1 must give the baseline")

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
    InputError
        Unreadable YAML, not a pinhole with Brown distortion, numbers out of range, images of different sizes.
    """
    infos = [folder / file.parent / CAMERA_INFO_FILE for file in RIG_FILES]
    from_ros = all(info.is_file() for info in infos) and not any(
        (folder / file).exists() for file in RIG_FILES
    )
    missing = next(
        (folder / file for file in RIG_FILES if not from_ros and not (folder / file).exists()), None
    )
    if missing is not None:
        raise InputError(
            f"{path_text(missing)}: no such file; write that camera's calibration there (spinfilters calibrate)"
        )
    left, right = (
        read_camera_infos(*infos) if from_ros else [read_sensor_file(folder / file) for file in RIG_FILES]
    )
    files = infos if from_ros else [folder / file for file in RIG_FILES]
    cameras = [raw_camera(path, each) for path, each in zip(files, (left, right), strict=True)]
    try:
        return RawRig(*cameras)
    except InputError as error:
        raise InputError(f"{path_text(files[1])}: {error}") from None


def raw_camera(path: Path, content: SensorFile) -> RawCamera:
    """Camera of a file's content; its rotation is made exact. InputError: as `read_raw_rig`."""
    if content.model not in DISTORTION_MODELS:
        raise InputError(
            f"{path_text(path)}: distortion_model is {value_text(content.model)}; only {', '.join(DISTORTION_MODELS)} is known"
        )
    values = zip(
        ("fx", "fy", "cx", "cy", "width", "height"),
        (*content.intrinsics.tolist(), *content.size),
        strict=True,
    )
    for key, value in values:
        CAMERA_RANGES[key].require(f"{path_text(path)}: {key}", value)
    distortion, rotation = _check_distortion(path, content.distortion), nearest_rotation(content.pose[:3, :3])
    return RawCamera(content.intrinsics, distortion, *content.size, rotation, content.pose[:3, 3])


def write_raw_rig(rig: RawRig, folder: Path, deviations: Sequence[str] = ("", "")) -> None:
    """Write both `sensor.yaml` files below the folder. Atomic each.

    Parameters
    ----------
    deviations : Sequence[str]
        Lines of `deviations_text` for each camera.
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


def _check_distortion(path: Path, given: Float[np.ndarray, " k"]) -> Float[np.ndarray, " 5"]:
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
    InputError
        Unreadable YAML, a key that is missing, numbers of another shape, matrices that are no rotations, no
        baseline.
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
        _read_rotation(path, each["rectification_matrix"])
        for path, each in zip((left, right), settings, strict=True)
    )
    projection = _read_matrix(right, "projection_matrix", settings[1]["projection_matrix"], (3, 4))
    baseline = -projection[0, 3] / projection[0, 0] if projection[0, 0] else np.nan
    if not np.isfinite(baseline) or baseline <= 0:
        raise InputError(
            f"{path_text(right)}: projection_matrix is {value_text(projection.tolist())} and gives no baseline; give that of the "
            "right camera, whose P[0, 3] is -fx b"
        )
    LENGTH.require(f"{path_text(right)}: the baseline", float(baseline))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R_left.T @ R_right, R_left.T @ np.array([baseline, 0.0, 0.0])
    return _read_camera(left, settings[0], np.eye(4)), _read_camera(right, settings[1], pose)


def _read_camera(path: Path, settings: dict[str, Any], pose: Float[np.ndarray, "4 4"]) -> SensorFile:
    K = _read_matrix(path, "camera_matrix", settings["camera_matrix"], (3, 3))
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


def _read_rotation(path: Path, value: Any) -> Float[np.ndarray, "3 3"]:
    matrix = _read_matrix(path, "rectification_matrix", value, (3, 3))
    if not is_rotation(matrix):
        raise InputError(
            f"{path_text(path)}: rectification_matrix is {value_text(matrix.tolist())}, not a rotation; correct it"
        )
    return matrix


def _read_matrix(path: Path, key: str, value: Any, shape: tuple[int, int]) -> Float[np.ndarray, "r c"]:
    """Matrix of a mapping with rows, cols and data, or of numbers alone."""
    data = value.get("data") if isinstance(value, dict) else value
    return numbers(path, key, data, (shape[0] * shape[1],)).reshape(shape)


MODE = cv2.INTER_LINEAR
"""Of the interpolation: exact for a ramp of grey values. OpenCV's cubic one is not, and shifts features by up to 0.06 px."""


EVERY: Final = slice(None)


@dataclass(frozen=True, eq=False)
class Rectification:
    """Rectified pair of a raw rig by Bouguet's method.

    Each camera is turned by half the rotation between them.
    """

    rig: RawRig

    @cached_property
    def _solution(self) -> tuple[np.ndarray, ...]:
        left, right = self.rig.left, self.rig.right
        return cv2.stereoRectify(
            left.camera_matrix,
            left.distortion,
            right.camera_matrix,
            right.distortion,
            self.rig.size,
            self.rig.relative_rotation,
            self.rig.relative_position.reshape(3, 1),
            flags=cv2.CALIB_ZERO_DISPARITY,
            alpha=-1,
        )[:4]

    @property
    def rotation(self) -> Float[np.ndarray, "3 3"]:
        """Raw left camera to rectified left camera."""
        return np.asarray(self._solution[0], dtype=float)

    @cached_property
    def stereo(self) -> StereoRig:
        """The rectified pair. InputError: cameras that are not side by side along x, left before right."""
        first, second = np.asarray(self._solution[2]), np.asarray(self._solution[3])
        baseline = -second[0, 3] / second[0, 0]
        if not baseline > 0 or second[1, 3]:
            raise InputError(
                "the cameras are not side by side with cam0 on the left; exchange them, or turn the images"
            )
        (fx, fy), (cx, cy), (width, height) = (
            np.diag(first)[:2].tolist(),
            first[:2, 2].tolist(),
            self.rig.size,
        )
        return StereoRig(PinholeCamera(fx, fy, cx, cy, width, height), float(baseline))

    @cached_property
    def _maps(self) -> list[tuple[np.ndarray, np.ndarray]]:
        cameras = (self.rig.left, self.rig.right)
        return [
            cv2.initUndistortRectifyMap(
                camera.camera_matrix, camera.distortion, turn, projection[:, :3], self.rig.size, cv2.CV_32FC1
            )
            for camera, turn, projection in zip(cameras, self._solution[:2], self._solution[2:], strict=True)
        ]

    def images(
        self,
        left: UInt8[np.ndarray, "h w"],
        right: UInt8[np.ndarray, "h w"],
        columns: slice = EVERY,
        rows: slice = EVERY,
    ) -> tuple[UInt8[np.ndarray, "rows columns"], UInt8[np.ndarray, "rows columns"]]:
        """Rectified images, or some of their columns and rows."""
        (left_x, left_y), (right_x, right_y) = self._maps
        return (
            cv2.remap(left, left_x[rows, columns], left_y[rows, columns], MODE),
            cv2.remap(right, right_x[rows, columns], right_y[rows, columns], MODE),
        )

    def grey_at(
        self,
        camera: int,
        raw: Float[np.ndarray, "h w"],
        x: Float[np.ndarray, "..."],
        y: Float[np.ndarray, "..."],
    ) -> Float[np.ndarray, "..."]:
        """Grey values of a raw image (camera 0 is the left one) at rectified columns and rows, single precision."""
        across, down = (np.ascontiguousarray(each, dtype=np.float32).reshape(len(x), -1) for each in (x, y))
        column, row = (
            cv2.remap(each, across, down, MODE, borderMode=cv2.BORDER_REPLICATE)
            for each in self._maps[camera]
        )
        found = cv2.remap(raw, column, row, MODE, borderMode=cv2.BORDER_REPLICATE)
        return found.reshape(x.shape)

    def points(
        self, left: Float[np.ndarray, "n 2"], right: Float[np.ndarray, "n 2"]
    ) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"]]:
        """Rectified pixels of raw ones."""
        cameras = (self.rig.left, self.rig.right)
        found = [
            cv2.undistortPoints(
                raw.reshape(-1, 1, 2), each.camera_matrix, each.distortion, R=turn, P=projection
            )
            for raw, each, turn, projection in zip(
                (left, right), cameras, self._solution[:2], self._solution[2:], strict=True
            )
        ]
        return found[0].reshape(-1, 2), found[1].reshape(-1, 2)

    def truth(self, truth: Truth) -> Truth:
        """The truth with the rectified left camera as frame i, not the raw one."""
        R = self.rotation
        return replace(
            truth,
            center_of_mass=truth.center_of_mass @ R.T,
            q_ig=multiply(quaternion_from_matrix(R), truth.q_ig),
            velocity=truth.velocity @ R.T,
            rate_i=truth.rate_i @ R.T,
        )

    def left_poses(self, poses: Float[np.ndarray, "n 7"]) -> Float[np.ndarray, "n 7"]:
        """Poses (t in m, q) of the rectified left camera from those of the raw one."""
        turn = inverse(quaternion_from_matrix(self.rotation))
        q = multiply(poses[:, 3:], np.broadcast_to(turn, (len(poses), 4)))
        return np.concatenate([poses[:, :3], q], axis=1)
