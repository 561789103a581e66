"""A stereo pair as it is built: two pinhole cameras with lens distortion, as `sensor.yaml` files of the EuRoC layout."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from spinfilters.data.atomic_write import make_folder, write_text
from spinfilters.data.camera import CAMERA_RANGES, RIG_FILES, ROTATION_TOLERANCE
from spinfilters.data.input_file import path_text, value_text
from spinfilters.data.number_range import LENGTH, NumberRange
from spinfilters.data.settings_files import numbers, read_yaml
from spinfilters.errors import InputError

DISTORTION_MODELS: Final = ("radial-tangential", "radtan", "plumb_bob", "none")
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
        """Left camera to right camera."""
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
    """Rig of `cam0/sensor.yaml` (left) and `cam1/sensor.yaml` (right).

    Raises
    ------
    InputError: unreadable YAML, not a pinhole with Brown distortion, numbers out of range, images of different sizes.
    """
    left, right = (read_raw_camera(folder / file) for file in RIG_FILES)
    try:
        return RawRig(left, right)
    except InputError as error:
        raise InputError(f"{path_text(folder / RIG_FILES[1])}: {error}") from None


def read_raw_camera(path: Path) -> RawCamera:
    """Camera of one `sensor.yaml`. InputError: as `read_raw_rig`."""
    settings = read_yaml(path)
    for key in ("intrinsics", "resolution", "T_BS"):
        if key not in settings:
            raise InputError(
                f"{path_text(path)}: has no {key}; write it as in the EuRoC layout, or calibrate the rig"
            )
    for key, allowed in (("camera_model", ("pinhole",)), ("distortion_model", DISTORTION_MODELS)):
        if settings.get(key, allowed[0]) not in allowed:
            raise InputError(
                f"{path_text(path)}: {key} is {value_text(settings[key])}; only {', '.join(allowed)} is known"
            )
    intrinsics = numbers(path, "intrinsics", settings["intrinsics"], (4,))
    width, height = numbers(path, "resolution", settings["resolution"], (2,)).tolist()
    values = dict(
        zip(("fx", "fy", "cx", "cy", "width", "height"), (*intrinsics.tolist(), width, height), strict=True)
    )
    for key, value in values.items():
        CAMERA_RANGES[key].require(f"{path_text(path)}: {key}", value)
    if not (width.is_integer() and height.is_integer()):
        raise InputError(
            f"{path_text(path)}: resolution is {[width, height]}, expected whole pixels; correct it"
        )
    pose = _pose(path, settings["T_BS"])
    distortion = _distortion(path, settings.get("distortion_coefficients", []))
    return RawCamera(intrinsics, distortion, int(width), int(height), pose[:3, :3], pose[:3, 3])


def write_raw_rig(rig: RawRig, folder: Path) -> None:
    """Write both `sensor.yaml` files below the folder. Atomic each."""
    for camera, file in zip((rig.left, rig.right), RIG_FILES, strict=True):
        make_folder((folder / file).parent)
        write_text(folder / file, camera_text(camera))


def camera_text(camera: RawCamera) -> str:
    """A `sensor.yaml`; the fifth coefficient stands where it is not zero."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = camera.R_bc, camera.t_bc
    distortion = camera.distortion.tolist()
    return (
        "sensor_type: camera\n"
        f"T_BS:\n  cols: 4\n  rows: 4\n  data: {pose.ravel().tolist()}\n"
        f"resolution: {[camera.width, camera.height]}\n"
        "camera_model: pinhole\n"
        f"intrinsics: {camera.intrinsics.tolist()}\n"
        "distortion_model: radial-tangential\n"
        f"distortion_coefficients: {distortion if distortion[4] else distortion[:4]}\n"
    )


def _distortion(path: Path, value: object) -> Float[np.ndarray, " 5"]:
    key = "distortion_coefficients"
    if not isinstance(value, list) or len(value) not in COEFFICIENTS:
        raise InputError(
            f"{path_text(path)}: {key} is {value_text(value)}, expected k1, k2, p1, p2 and perhaps k3; correct it"
        )
    given = numbers(path, key, value, (len(value),)) if value else np.zeros(0)
    for number in given.tolist():
        DISTORTION.require(f"{path_text(path)}: {key}: a number", number)
    return np.concatenate([given, np.zeros(5 - len(given))])


def _pose(path: Path, value: Any) -> Float[np.ndarray, "4 4"]:
    """T_BS, camera to body: a 4x4 list, 16 numbers, or the EuRoC mapping with data; its rotation is made exact."""
    data = value.get("data") if isinstance(value, dict) else value
    nested = isinstance(data, list) and len(data) == 4
    pose = numbers(path, "T_BS", data, (4, 4) if nested else (16,)).reshape(4, 4)
    for entry in pose.ravel().tolist():
        LENGTH.require(f"{path_text(path)}: T_BS holds a number that", entry)
    rotation = pose[:3, :3]
    rigid = (
        np.abs(rotation @ rotation.T - np.eye(3)).max() <= ROTATION_TOLERANCE and np.linalg.det(rotation) > 0
    )
    if not rigid or not np.array_equal(pose[3], [0.0, 0.0, 0.0, 1.0]):
        raise InputError(
            f"{path_text(path)}: T_BS is {value_text(pose.tolist())}, not a rotation and a shift; correct it"
        )
    U, _, Vt = np.linalg.svd(rotation)
    pose[:3, :3] = U @ Vt
    return pose
