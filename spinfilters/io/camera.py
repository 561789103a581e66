"""Calibration of one camera or of a rectified stereo pair, and the `sensor.yaml` files that hold it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import chain
from operator import attrgetter
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.io.consider_parameter import consider_parameters
from spinfilters.io.document import numbers, read_yaml
from spinfilters.io.input_file import path_text, value_text
from spinfilters.io.output_files import make_folder, write_text
from spinfilters.io.stated_values import LENGTH, NumberRange

ROTATION_TOLERANCE: Final[float] = 1e-4
"""Largest entry by which a rotation may miss orthonormality, or a pair parallelism: 0.05 px at f = 500."""
DISTORTION_MODELS: Final[tuple[str, ...]] = ("radial-tangential", "radtan", "plumb_bob")
"""Names of the distortion of Brown: of the EuRoC layout, Kalibr and ROS."""
DISTORTION_KEY: Final = "distortion_coefficients"
INTRINSICS_STD, POSITION_STD = "intrinsics_std", "position_std"
"""Keys of what `spinfilters calibrate` says of the uncertainty; others need not."""
_INTRINSICS_DEVIATION, _PLACE_DEVIATION = (
    NumberRange(0, 1e4, "px"),
    NumberRange(0, 1e3, "m"),
)


@dataclass(frozen=True, eq=False)
class SensorFile:
    """Content of a `sensor.yaml` of a pinhole camera.

    Attributes
    ----------
    intrinsics : Float[np.ndarray, ' 4']
        (fx, fy, cx, cy), px.
    size : tuple[int, int]
        Width and height, px.
    pose : Float[np.ndarray, '4 4']
        T_BS, camera to body, m.
    distortion : Float[np.ndarray, ' k']
        Coefficients as they are given, none where there are none.
    model : object
        Of the distortion, as it is given.
    intrinsics_std : Float[np.ndarray, ' 4'] | None
        Standard deviations of the intrinsics, px.
    position_std : float | None
        Of the camera's place in the body, m. None where the file is silent.
    """

    intrinsics: Float[np.ndarray, " 4"]
    size: tuple[int, int]
    pose: Float[np.ndarray, "4 4"]
    distortion: Float[np.ndarray, " k"]
    model: object
    intrinsics_std: Float[np.ndarray, " 4"] | None = None
    position_std: float | None = None


def read_sensor_file(path: Path) -> SensorFile:
    """Content of a `sensor.yaml`.

    Raises
    ------
    InputError
        Unreadable YAML, a key that is missing, not a pinhole, numbers of another shape, half a pixel, no pose.
    """
    settings = read_yaml(path)
    for key in ("camera_model", "intrinsics", "resolution", "T_BS"):
        if key not in settings:
            raise InputError(
                f"{path_text(path)}: has no {key}; write it as in the EuRoC layout, or calibrate the rig"
            )
    if settings["camera_model"] != "pinhole":
        raise InputError(
            f"{path_text(path)}: camera_model is {value_text(settings['camera_model'])}; rectify the images, "
            "give 'pinhole'"
        )
    intrinsics = numbers(path, "intrinsics", settings["intrinsics"], (4,))
    resolution = numbers(path, "resolution", settings["resolution"], (2,))
    coefficients, model = (
        settings.get(DISTORTION_KEY, []),
        settings.get("distortion_model", DISTORTION_MODELS[0]),
    )
    if not isinstance(coefficients, list):
        raise InputError(
            f"{path_text(path)}: {DISTORTION_KEY} is {value_text(coefficients)}, expected [0.0, 0.0, 0.0, 0.0]; correct it"
        )
    distortion = (
        numbers(path, DISTORTION_KEY, coefficients, (len(coefficients),)) if coefficients else np.zeros(0)
    )
    pose = _pose(path, settings["T_BS"])
    return SensorFile(
        intrinsics, image_size(path, resolution), pose, distortion, model, *_deviations(path, settings)
    )


def sensor_text(
    intrinsics: Sequence[float],
    size: tuple[int, int],
    pose: Float[np.ndarray, "4 4"],
    distortion: Sequence[float],
) -> str:
    """A `sensor.yaml` that `read_sensor_file` reads to the same numbers; `deviations_text` may follow it."""
    return (
        "sensor_type: camera\n"
        f"T_BS:\n  cols: 4\n  rows: 4\n  data: {pose.ravel().tolist()}\n"
        f"resolution: {[int(value) for value in size]}\n"
        "camera_model: pinhole\n"
        f"intrinsics: {[float(value) for value in intrinsics]}\n"
        f"distortion_model: {DISTORTION_MODELS[0]}\n"
        f"{DISTORTION_KEY}: {[float(value) for value in distortion]}\n"
    )


def deviations_text(intrinsics_std: Sequence[float], position_std: float | None = None) -> str:
    """Lines of a `sensor.yaml` that state standard deviations: intrinsics px, camera's place m."""
    place = "" if position_std is None else f"{POSITION_STD}: {float(position_std)}\n"
    return f"{INTRINSICS_STD}: {[float(value) for value in intrinsics_std]}\n{place}"


def image_size(path: Path, resolution: Float[np.ndarray, " 2"]) -> tuple[int, int]:
    """Width and height. InputError: not whole pixels."""
    width, height = resolution.tolist()
    if not width.is_integer() or not height.is_integer():
        raise InputError(
            f"{path_text(path)}: resolution is {resolution.tolist()}, expected whole pixels; correct it"
        )
    return int(width), int(height)


def is_rotation(matrix: Float[np.ndarray, "3 3"]) -> bool:
    """Whether a matrix is a rotation, to `ROTATION_TOLERANCE`."""
    orthonormal = np.abs(matrix @ matrix.T - np.eye(3)).max() <= ROTATION_TOLERANCE
    return bool(orthonormal and np.linalg.det(matrix) > 0.0)


def _deviations(
    path: Path, settings: Mapping[str, Any]
) -> tuple[Float[np.ndarray, " 4"] | None, float | None]:
    """InputError: deviations of another number or out of range."""
    of_intrinsics, of_place = settings.get(INTRINSICS_STD), settings.get(POSITION_STD)
    if of_intrinsics is not None:
        of_intrinsics = numbers(path, INTRINSICS_STD, of_intrinsics, (4,))
        for value in of_intrinsics.tolist():
            _INTRINSICS_DEVIATION.require(f"{path_text(path)}: {INTRINSICS_STD}: a number", value)
    if of_place is not None:
        _PLACE_DEVIATION.require(f"{path_text(path)}: {POSITION_STD}", of_place)
    return of_intrinsics, None if of_place is None else float(of_place)


def _pose(path: Path, value: Any) -> Float[np.ndarray, "4 4"]:
    """T_BS, camera to body.

    A 4x4 list, 16 numbers, or the EuRoC mapping with rows, cols and data.
    """
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
    if not is_rotation(pose[:3, :3]) or not np.array_equal(pose[3], [0.0, 0.0, 0.0, 1.0]):
        raise InputError(
            f"{path_text(path)}: T_BS is {value_text(pose.tolist())}, not a rotation and a shift; correct it"
        )
    return pose


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
"""Of the distortion of a lens: k1, k2, p1, p2 (`spinfilters.core.cameras.RadialTangentialLens`)."""
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
    fx, fy, cx, cy : float
        Focal lengths and principal point, px.
    width, height : int
        Of the images, px.
    distortion : tuple[float, ...]
        Four coefficients of the lens; none of rectified pixels.

    Raises
    ------
    InputError
        A value out of its range in `CAMERA_RANGES`, another number of coefficients.
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
    """A parallel pinhole pair, each camera with its own lens; the right one is displaced by the baseline along x.

    Parameters
    ----------
    left : PinholeCamera
        Camera.
    baseline_m : float
        m, positive.
    right_distortion : tuple[float, ...]
        Four coefficients of the right lens; none of rectified pixels.

    Raises
    ------
    InputError
        A baseline out of its range in `CAMERA_RANGES`, another number of coefficients.
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
        """(fx, fy, cx, cy px, baseline m), then the coefficients of both lenses if either of them distorts."""
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
    InputError
        Unreadable YAML; not a pinhole; a distortion that is not radial-tangential; intrinsics or image sizes that
        differ; cameras not parallel or not side by side along x; degenerate numbers.
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


def camera_deviations(folder: Path) -> Mapping[str, float]:
    """Calibration deviations of a folder's cameras, the larger of two.

    Raises
    ------
    InputError
        As `read_sensor_file`; a deviation out of the range of its parameter.
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
    stated: dict[str, float] = {}
    if camera.intrinsics_std is not None:
        focal, centre = camera.intrinsics_std[:2] / camera.intrinsics[:2], camera.intrinsics_std[2:]
        stated |= {"focal_std": float(focal.max()), "center_std": float(centre.max())}
    if camera.position_std is not None and len(pair) > 1:
        baseline = float(np.linalg.norm(pair[1].pose[:3, 3] - pair[0].pose[:3, 3]))
        if baseline > 0:
            stated["baseline_std"] = camera.position_std / baseline
    return stated
