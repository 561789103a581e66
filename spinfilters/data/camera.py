"""Calibrations of one camera or a stereo pair, in the `sensor.yaml` files of the EuRoC layout."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from jaxtyping import Float

from spinfilters.data.atomic_write import make_folder, write_text
from spinfilters.data.input_file import path_text, value_text
from spinfilters.data.number_range import LENGTH, NumberRange
from spinfilters.data.settings_files import numbers, read_yaml
from spinfilters.errors import InputError

RIG_FILES: Final[tuple[Path, Path]] = (Path("cam0/sensor.yaml"), Path("cam1/sensor.yaml"))
"""Left and right camera, relative to the folder of a data set."""
ROTATION_TOLERANCE: Final[float] = 1e-4
"""Largest entry by which a rotation may miss orthonormality, or a pair parallelism: 0.05 px at f = 500."""
OFF_AXIS_TOLERANCE: Final[float] = 1e-3
"""Largest offset of the right camera across the x axis, as a fraction of the baseline."""
_FOCAL_LENGTH, _CENTRE, _SIZE = (
    NumberRange(1, 1e7, "px"),
    NumberRange(-1e7, 1e7, "px"),
    NumberRange(1, 1e6, "px"),
)
COEFFICIENTS: Final[int] = 4
"""Of the distortion of a lens: k1, k2, p1, p2 (`spinfilters.geometry.lenses.RadialTangentialLens`)."""
DISTORTION_MODELS: Final[tuple[str, ...]] = ("radial-tangential", "radtan", "plumb_bob")
"""Names of that distortion: of the EuRoC layout, Kalibr and ROS."""
CAMERA_RANGES: Final[dict[str, NumberRange]] = {
    "fx": _FOCAL_LENGTH,
    "fy": _FOCAL_LENGTH,
    "cx": _CENTRE,
    "cy": _CENTRE,
    "width": _SIZE,
    "height": _SIZE,
    "baseline_m": NumberRange(1e-6, 1e6, "m"),
    "distortion": NumberRange(-10, 10),
}


@dataclass(frozen=True)
class StereoRig:
    """A parallel pinhole pair: the right camera is the left one moved by the baseline along x.

    Parameters
    ----------
    fx, fy, cx, cy: focal lengths and principal point of both cameras, px.
    width, height: of the images, px.   baseline_m: m, positive.
    distortion: four coefficients of the left lens, then of the right; none of rectified pixels.

    Raises
    ------
    InputError: a value out of its range in `CAMERA_RANGES`, coefficients of another number of lenses.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    baseline_m: float
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        _check(self, "stereo rig", lenses=2)

    @property
    def calibration(self) -> Float[np.ndarray, " c"]:
        """(fx, fy, cx, cy px, baseline m), then the coefficients of distorted lenses."""
        return np.array([self.fx, self.fy, self.cx, self.cy, self.baseline_m, *self.distortion])

    @property
    def left(self) -> "PinholeCamera":
        """The left camera alone."""
        own = self.distortion[:COEFFICIENTS]
        return PinholeCamera(self.fx, self.fy, self.cx, self.cy, self.width, self.height, own)


@dataclass(frozen=True)
class PinholeCamera:
    """One pinhole camera. Parameters and errors: `StereoRig`, without the baseline, of one lens."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        _check(self, "camera", lenses=1)

    @property
    def calibration(self) -> Float[np.ndarray, " c"]:
        """(fx, fy, cx, cy px), then the coefficients of a distorted lens."""
        return np.array([self.fx, self.fy, self.cx, self.cy, *self.distortion])

    @property
    def left(self) -> "PinholeCamera":
        """Itself."""
        return self


Rig = StereoRig | PinholeCamera
"""What a data set with a camera is calibrated with."""


class _Camera(NamedTuple):
    intrinsics: Float[np.ndarray, "4"]
    resolution: Float[np.ndarray, "2"]
    pose: Float[np.ndarray, "4 4"]
    distortion: tuple[float, ...]


def _check(rig: Rig, name: str, lenses: int) -> None:
    """InputError: see `StereoRig`."""
    for field in fields(rig):
        value = getattr(rig, field.name)
        for number in value if isinstance(value, tuple) else (value,):
            CAMERA_RANGES[field.name].require(f"{name}: {field.name}", number)
    if len(rig.distortion) not in (0, lenses * COEFFICIENTS):
        raise InputError(
            f"{name}: distortion has {len(rig.distortion)} coefficients; give {COEFFICIENTS} of each lens, or none"
        )


def read_stereo_rig(folder: Path) -> StereoRig:
    """Rig of `cam0/sensor.yaml` (left) and `cam1/sensor.yaml` (right); the baseline is out of their T_BS.

    Raises
    ------
    InputError: unreadable YAML; not a pinhole; a distortion that is not radial-tangential; intrinsics or
    image sizes that differ; cameras not parallel or not side by side along x; degenerate numbers.
    """
    left, right = (_read_camera(folder / file) for file in RIG_FILES)
    path = folder / RIG_FILES[1]
    for key, a, b in zip(("intrinsics", "resolution"), left[:2], right[:2], strict=True):
        if not np.array_equal(a, b):
            raise InputError(
                f"{path_text(path)}: {key} are {b.tolist()}, cam0 has {a.tolist()}; "
                "give the common ones of the rectified pair"
            )
    relative = np.linalg.solve(left.pose, right.pose)
    if np.abs(relative[:3, :3] - np.eye(3)).max() > ROTATION_TOLERANCE:
        raise InputError(
            f"{path_text(path)}: T_BS turns cam1 against cam0; rectify the pair and give the parallel cameras"
        )
    baseline = _baseline(path, relative[:3, 3])
    width, height = _resolution(path, right.resolution)
    fx, fy, cx, cy = right.intrinsics.tolist()
    try:
        return StereoRig(fx, fy, cx, cy, width, height, baseline, _both(left, right))
    except InputError as error:
        raise InputError(f"{path_text(path)}: {error}") from None


def read_camera(folder: Path) -> PinholeCamera:
    """Camera of `cam0/sensor.yaml`. InputError: as `read_stereo_rig`, of one camera."""
    path = folder / RIG_FILES[0]
    camera = _read_camera(path)
    width, height = _resolution(path, camera.resolution)
    fx, fy, cx, cy = camera.intrinsics.tolist()
    try:
        return PinholeCamera(fx, fy, cx, cy, width, height, camera.distortion)
    except InputError as error:
        raise InputError(f"{path_text(path)}: {error}") from None


def write_stereo_rig(rig: StereoRig, folder: Path) -> None:
    """Write both `sensor.yaml` files below the folder, the body frame being the left camera. Atomic each."""
    _write_cameras(rig, folder, (0.0, rig.baseline_m))


def write_camera(camera: PinholeCamera, folder: Path) -> None:
    """Write `cam0/sensor.yaml` below the folder, the body frame being the camera. Atomic."""
    _write_cameras(camera, folder, (0.0,))


def _write_cameras(rig: Rig, folder: Path, shifts: tuple[float, ...]) -> None:
    """Each camera moved by so much along x, m."""
    intrinsics = [float(value) for value in (rig.fx, rig.fy, rig.cx, rig.cy)]
    for number, (file, shift) in enumerate(zip(RIG_FILES, shifts, strict=False)):
        own = rig.distortion[COEFFICIENTS * number : COEFFICIENTS * (number + 1)] or (0.0,) * COEFFICIENTS
        pose = np.eye(4)
        pose[0, 3] = shift
        make_folder((folder / file).parent)
        text = (
            "sensor_type: camera\n"
            f"T_BS:\n  cols: 4\n  rows: 4\n  data: {pose.ravel().tolist()}\n"
            f"resolution: {[int(rig.width), int(rig.height)]}\n"
            "camera_model: pinhole\n"
            f"intrinsics: {intrinsics}\n"
            "distortion_model: radial-tangential\n"
            f"distortion_coefficients: {[float(value) for value in own]}\n"
        )
        write_text(folder / file, text)


def _read_camera(path: Path) -> _Camera:
    settings = read_yaml(path)
    for key in ("camera_model", "intrinsics", "resolution", "T_BS"):
        if key not in settings:
            raise InputError(f"{path_text(path)}: has no {key}; write it as in the EuRoC layout")
    if settings["camera_model"] != "pinhole":
        raise InputError(
            f"{path_text(path)}: camera_model is {value_text(settings['camera_model'])}; rectify the images, "
            "give 'pinhole'"
        )
    intrinsics = numbers(path, "intrinsics", settings["intrinsics"], (4,))
    resolution = numbers(path, "resolution", settings["resolution"], (2,))
    return _Camera(intrinsics, resolution, _pose(path, settings["T_BS"]), _distortion(path, settings))


def _both(left: _Camera, right: _Camera) -> tuple[float, ...]:
    """Coefficients of both lenses; none where neither distorts."""
    if not left.distortion and not right.distortion:
        return ()
    perfect = (0.0,) * COEFFICIENTS
    return (*(left.distortion or perfect), *(right.distortion or perfect))


def _distortion(path: Path, settings: Mapping[str, Any]) -> tuple[float, ...]:
    """Coefficients k1, k2, p1, p2; none where all are zero. InputError: of another model."""
    key, model = "distortion_coefficients", settings.get("distortion_model", DISTORTION_MODELS[0])
    value = settings.get(key, [])
    if not isinstance(value, list):
        raise InputError(
            f"{path_text(path)}: {key} is {value_text(value)}, expected [0.0, 0.0, 0.0, 0.0]; correct it"
        )
    found = numbers(path, key, value, (len(value),))
    if not np.any(found != 0.0):
        return ()
    for number in found.tolist():
        CAMERA_RANGES["distortion"].require(f"{path_text(path)}: {key} holds a number that", number)
    if model not in DISTORTION_MODELS or np.any(found[COEFFICIENTS:] != 0.0) or len(found) < COEFFICIENTS:
        raise InputError(
            f"{path_text(path)}: {key} is {value_text(value)} of the model {value_text(model)}, expected k1, k2, p1, p2 of "
            f"{DISTORTION_MODELS[0]!r}; undistort the tracks and give zeros"
        )
    return tuple(found[:COEFFICIENTS].tolist())


def _pose(path: Path, value: Any) -> Float[np.ndarray, "4 4"]:
    """T_BS, camera to body: a 4x4 list, 16 numbers, or the EuRoC mapping with rows, cols and data."""
    data = value
    if isinstance(value, dict):
        if (value.get("rows"), value.get("cols")) != (4, 4) or "data" not in value:
            raise InputError(
                f"{path_text(path)}: T_BS is {value_text(value)}, expected rows: 4, cols: 4, data: [...]; correct it"
            )
        data = value["data"]
    nested = isinstance(data, list) and len(data) == 4
    pose = numbers(path, "T_BS", data, (4, 4) if nested else (16,)).reshape(4, 4)
    for entry in pose.ravel().tolist():
        LENGTH.require(f"{path_text(path)}: T_BS holds a number that", entry)
    rotation = pose[:3, :3]
    rigid = (
        np.abs(rotation @ rotation.T - np.eye(3)).max() <= ROTATION_TOLERANCE
        and np.linalg.det(rotation) > 0.0
    )
    if not rigid or not np.array_equal(pose[3], [0.0, 0.0, 0.0, 1.0]):
        raise InputError(
            f"{path_text(path)}: T_BS is {value_text(pose.tolist())}, not a rotation and a shift; correct it"
        )
    return pose


def _baseline(path: Path, shift: Float[np.ndarray, "3"]) -> float:
    if shift[0] <= 0.0 or np.abs(shift[1:]).max() > OFF_AXIS_TOLERANCE * shift[0]:
        raise InputError(
            f"{path_text(path)}: T_BS puts cam1 at {shift.tolist()} m in cam0, expected [baseline > 0, 0, 0]; "
            "let cam0 be the left camera and rectify the pair"
        )
    return float(shift[0])


def _resolution(path: Path, resolution: Float[np.ndarray, "2"]) -> tuple[int, int]:
    width, height = resolution.tolist()
    if not width.is_integer() or not height.is_integer():
        raise InputError(
            f"{path_text(path)}: resolution is {resolution.tolist()}, expected whole pixels; correct it"
        )
    return int(width), int(height)
