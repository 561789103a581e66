"""Calibrations of one camera or a stereo pair, in the `sensor.yaml` files of the EuRoC layout."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float

from spinfilters.data.atomic_write import make_folder, write_text
from spinfilters.data.input_file import path_text, value_text
from spinfilters.data.number_range import NumberRange
from spinfilters.data.sensor_yaml import (
    DISTORTION_KEY,
    DISTORTION_MODELS,
    ROTATION_TOLERANCE,
    SensorFile,
    read_sensor_file,
    sensor_text,
)
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
    size: tuple[int, int]
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
                f"{path_text(path)}: {key} are {np.array(b).tolist()}, cam0 has {np.array(a).tolist()}; "
                "give the common ones of the rectified pair"
            )
    relative = np.linalg.solve(left.pose, right.pose)
    if np.abs(relative[:3, :3] - np.eye(3)).max() > ROTATION_TOLERANCE:
        raise InputError(
            f"{path_text(path)}: T_BS turns cam1 against cam0; rectify the pair and give the parallel cameras"
        )
    baseline = _baseline(path, relative[:3, 3])
    width, height = right.size
    fx, fy, cx, cy = right.intrinsics.tolist()
    try:
        return StereoRig(fx, fy, cx, cy, width, height, baseline, _both(left, right))
    except InputError as error:
        raise InputError(f"{path_text(path)}: {error}") from None


def read_camera(folder: Path) -> PinholeCamera:
    """Camera of `cam0/sensor.yaml`. InputError: as `read_stereo_rig`, of one camera."""
    path = folder / RIG_FILES[0]
    camera = _read_camera(path)
    width, height = camera.size
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
        text = sensor_text(intrinsics, (rig.width, rig.height), pose, own)
        write_text(folder / file, text)


def _read_camera(path: Path) -> _Camera:
    found = read_sensor_file(path)
    return _Camera(found.intrinsics, found.size, found.pose, _distortion(path, found))


def _both(left: _Camera, right: _Camera) -> tuple[float, ...]:
    """Coefficients of both lenses; none where neither distorts."""
    if not left.distortion and not right.distortion:
        return ()
    perfect = (0.0,) * COEFFICIENTS
    return (*(left.distortion or perfect), *(right.distortion or perfect))


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
