"""Calibrations of one camera or a stereo pair, with deviations, in `sensor.yaml` files (EuRoC)."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from itertools import chain
from operator import attrgetter
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float

from spinfilters.data.atomic_write import make_folder, write_text
from spinfilters.data.consider_parameter import consider_parameters
from spinfilters.data.input_file import path_text, value_text
from spinfilters.data.sensor_yaml import (
    DISTORTION_KEY,
    DISTORTION_MODELS,
    ROTATION_TOLERANCE,
    SensorFile,
    read_sensor_file,
    sensor_text,
)
from spinfilters.data.stated_values import NumberRange
from spinfilters.errors import InputError

RIG_FILES: Final[tuple[Path, Path]] = (Path("cam0/sensor.yaml"), Path("cam1/sensor.yaml"))
"""Left and right camera, relative to the folder of a data set."""
OFF_AXIS_TOLERANCE: Final[float] = 1e-3
"""Largest offset of the right camera across the x axis, as a fraction of the baseline."""
_FOCAL_LENGTH, _CENTRE, _SIZE = (
    NumberRange(1, 1e7, "px"),
    NumberRange(-1e7, 1e7, "px"),
    NumberRange(1, 1e6, "px"),
)
COEFFICIENTS: Final[int] = 4
"""Of the distortion of a lens: k1, k2, p1, p2 (`spinfilters.geometry.lenses.RadialTangentialLens`)."""
PERFECT: Final = (0.0,) * COEFFICIENTS
"""Coefficients of a lens that does not distort."""
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
class PinholeCamera:
    """One pinhole camera.

    Parameters
    ----------
    fx, fy, cx, cy: focal lengths and principal point, px.
    width, height: of the images, px.
    distortion: four coefficients of the lens; none of rectified pixels.

    Raises
    ------
    InputError: a value out of its range in `CAMERA_RANGES`, another number of coefficients.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            for number in value if isinstance(value, tuple) else (value,):
                CAMERA_RANGES[field.name].require(f"camera: {field.name}", number)
        _require_lens("camera", self.distortion)

    @property
    def calibration(self) -> Float[np.ndarray, " c"]:
        """(fx, fy, cx, cy px), then the coefficients of a distorted lens."""
        return np.array([*self.intrinsics, *self.distortion])

    @property
    def intrinsics(self) -> tuple[float, float, float, float]:
        """Focal lengths and principal point, px."""
        return self.fx, self.fy, self.cx, self.cy

    @property
    def left(self) -> "PinholeCamera":
        """The camera itself."""
        return self

    @property
    def baseline_m(self) -> float:
        """0: one camera has no baseline."""
        return 0.0


@dataclass(frozen=True)
class StereoRig:
    """A parallel pinhole pair with lenses of their own.

    The right camera is the left one moved by the baseline along x.

    Parameters
    ----------
    left: camera.   baseline_m: m, positive.   right_distortion: four coefficients of the right lens; none of rectified pixels.

    Raises
    ------
    InputError: a baseline out of its range in `CAMERA_RANGES`, another number of coefficients.
    """

    left: PinholeCamera
    baseline_m: float
    right_distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        CAMERA_RANGES["baseline_m"].require("stereo rig: baseline_m", self.baseline_m)
        for number in self.right_distortion:
            CAMERA_RANGES["distortion"].require("stereo rig: right_distortion", number)
        _require_lens("stereo rig", self.right_distortion)

    @property
    def calibration(self) -> Float[np.ndarray, " c"]:
        """(fx, fy, cx, cy px, baseline m), then coefficients of distorting lenses.

        Both lenses have coefficients where one of them distorts.
        """
        lenses = (self.left.distortion, self.right_distortion)
        both = [each or PERFECT for each in lenses] if any(lenses) else []
        return np.array([*self.left.intrinsics, self.baseline_m, *chain(*both)])


Rig = StereoRig | PinholeCamera
"""What a data set with a camera is calibrated with."""


class _PlacedCamera(NamedTuple):
    camera: PinholeCamera
    pose: Float[np.ndarray, "4 4"]


def _require_lens(name: str, distortion: tuple[float, ...]) -> None:
    """InputError: coefficients that are neither none nor those of one lens."""
    if len(distortion) not in (0, COEFFICIENTS):
        raise InputError(
            f"{name}: distortion has {len(distortion)} coefficients; give {COEFFICIENTS} of each lens, or none"
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
    for key, of in (("intrinsics", attrgetter("intrinsics")), ("resolution", attrgetter("width", "height"))):
        a, b = of(left.camera), of(right.camera)
        if a != b:
            raise InputError(
                f"{path_text(path)}: {key} are {list(b)}, cam0 has {list(a)}; give the common ones of the rectified pair"
            )
    relative = np.linalg.solve(left.pose, right.pose)
    if np.abs(relative[:3, :3] - np.eye(3)).max() > ROTATION_TOLERANCE:
        raise InputError(
            f"{path_text(path)}: T_BS turns cam1 against cam0; rectify the pair and give the parallel cameras"
        )
    baseline = _baseline(path, relative[:3, 3])
    try:
        return StereoRig(left.camera, baseline, right.camera.distortion)
    except InputError as error:
        raise InputError(f"{path_text(path)}: {error}") from None


def read_camera(folder: Path) -> PinholeCamera:
    """Camera of `cam0/sensor.yaml`. InputError: as `read_stereo_rig`, of one camera."""
    return _read_camera(folder / RIG_FILES[0]).camera


def write_stereo_rig(rig: StereoRig, folder: Path) -> None:
    """Write both `sensor.yaml` files below the folder, the body frame being the left camera. Atomic each."""
    write_camera(rig.left, folder)
    _write_camera(rig.left, folder / RIG_FILES[1], rig.baseline_m, rig.right_distortion)


def write_camera(camera: PinholeCamera, folder: Path) -> None:
    """Write `cam0/sensor.yaml` below the folder, the body frame being the camera. Atomic."""
    _write_camera(camera, folder / RIG_FILES[0], 0.0, camera.distortion)


def _write_camera(camera: PinholeCamera, file: Path, shift: float, distortion: tuple[float, ...]) -> None:
    """Moved by so much along x, m, with a lens of these coefficients."""
    pose = np.eye(4)
    pose[0, 3] = shift
    make_folder(file.parent)
    intrinsics = [float(value) for value in camera.intrinsics]
    write_text(file, sensor_text(intrinsics, (camera.width, camera.height), pose, distortion or PERFECT))


def _read_camera(path: Path) -> _PlacedCamera:
    found = read_sensor_file(path)
    fx, fy, cx, cy = found.intrinsics.tolist()
    distortion = _distortion(path, found)
    try:
        return _PlacedCamera(PinholeCamera(fx, fy, cx, cy, *found.size, distortion), found.pose)
    except InputError as error:
        raise InputError(f"{path_text(path)}: {error}") from None


def _distortion(path: Path, camera: SensorFile) -> tuple[float, ...]:
    """Coefficients k1, k2, p1, p2; none where all are zero. InputError: of another model."""
    found, key = camera.distortion, DISTORTION_KEY
    if not np.any(found != 0.0):
        return ()
    for number in found.tolist():
        CAMERA_RANGES["distortion"].require(f"{path_text(path)}: {key} holds a number that", number)
    known = camera.model in DISTORTION_MODELS
    if not known or np.any(found[COEFFICIENTS:] != 0.0) or len(found) < COEFFICIENTS:
        raise InputError(
            f"{path_text(path)}: {key} is {value_text(found.tolist())} of the model {value_text(camera.model)}, expected k1, k2, "
            f"p1, p2 of {DISTORTION_MODELS[0]!r}; undistort the tracks and give zeros"
        )
    return tuple(found[:COEFFICIENTS].tolist())


def _baseline(path: Path, shift: Float[np.ndarray, "3"]) -> float:
    if shift[0] <= 0.0 or np.abs(shift[1:]).max() > OFF_AXIS_TOLERANCE * shift[0]:
        raise InputError(
            f"{path_text(path)}: T_BS puts cam1 at {shift.tolist()} m in cam0, expected [baseline > 0, 0, 0]; "
            "let cam0 be the left camera and rectify the pair"
        )
    return float(shift[0])


def told_deviations(folder: Path) -> Mapping[str, float]:
    """Calibration deviations of a folder's cameras, the larger of two.

    Raises
    ------
    InputError: as `read_sensor_file`; a deviation out of the range of its parameter.
    """
    cameras = {
        path: read_sensor_file(path) for path in (folder / file for file in RIG_FILES) if path.is_file()
    }
    found: dict[str, float] = {}
    for path, camera in cameras.items():
        for name, value in _of_camera(camera, list(cameras.values())).items():
            consider_parameters()[name].allowed.require(f"{path_text(path)}: its {name}", value)
            found[name] = max(value, found.get(name, 0.0))
    return found


def _of_camera(camera: SensorFile, pair: list[SensorFile]) -> dict[str, float]:
    """Deviations relative to focal length and baseline, and of the principal point in px."""
    told: dict[str, float] = {}
    if camera.intrinsics_std is not None:
        focal, centre = camera.intrinsics_std[:2] / camera.intrinsics[:2], camera.intrinsics_std[2:]
        told |= {"focal_std": float(focal.max()), "center_std": float(centre.max())}
    if camera.position_std is not None and len(pair) > 1:
        baseline = float(np.linalg.norm(pair[1].pose[:3, 3] - pair[0].pose[:3, 3]))
        if baseline > 0:
            told["baseline_std"] = camera.position_std / baseline
    return told
