"""Checkout of a stored calibration on new images of a board, and what differs between two calibrations.

After the screens that astronauts saw of the Goggles (Tweddle 2013, sections 5.10 and 5.11): values within ranges, lines between
corresponding corners that must be horizontal, squares of the right size, a depth map that is filled.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.core.attitude_conversions import euler321_from_quaternion, quaternion_from_matrix
from spinfilters.core.attitude_conversions import rotation_vector_from_matrix as rotation_vector
from spinfilters.core.errors import InputError
from spinfilters.io.input_file import path_text, read_settings_text
from spinfilters.vision.calibration_images import Board, BoardView
from spinfilters.vision.rectification import RawRig, Rectification
from spinfilters.vision.stereo_calibration import CheckResult, checks, measured_board

CALIBRATION_FILE: Final = "calibration.json"
LARGEST_SLOPE_PX: Final = 1.0
"""Largest error of rows of a corner whose line still counts as horizontal."""


@dataclass(frozen=True)
class Checkout:
    """What a stored calibration says of new views.

    Attributes
    ----------
    results : list of CheckResult
        Every check with its number, range and verdict.
    left, right : ndarray of float, shape (n, 2)
        Rectified corners of the view whose rows miss most, px.
    level : ndarray of bool, shape (n,)
        Which of the lines between them are horizontal.
    view : int
        Number of that view.
    distance : float
        From the left camera to its board, m.
    """

    results: list[CheckResult]
    left: Float[np.ndarray, "n 2"]
    right: Float[np.ndarray, "n 2"]
    level: Bool[np.ndarray, " n"]
    view: int
    distance: float

    @property
    def passed(self) -> bool:
        """Whether every check passed."""
        return all(result.passed for result in self.results)


def check_stored(rig: RawRig, views: list[BoardView], board: Board) -> Checkout:
    """Check a stored calibration on views that were not calibrated with.

    Parameters
    ----------
    rig : RawRig
        The stored calibration.
    views : list of BoardView
        New views of the board.
    board : Board
        Its corners and the side of its squares.

    Returns
    -------
    Checkout
        Results, and the corners of the worst view.

    Raises
    ------
    InputError
        No views; cameras that are not side by side, left before right.
    """
    if not views:
        raise InputError("no view of the board to check a calibration with; give images that both show it")
    measured = measured_board(rig, views, board)
    x, y, z = rig.relative_position.tolist()
    yaw, pitch, roll = np.rad2deg(euler321_from_quaternion(quaternion_from_matrix(rig.relative_rotation)))
    shown = [
        CheckResult(
            "translation between the cameras",
            f"{1e2 * x:.2f}, {1e2 * y:.2f}, {1e2 * z:.2f} cm",
            "horizontal largest",
            abs(x) > 5 * max(abs(y), abs(z)),
        ),
        CheckResult(
            "roll, pitch, yaw between the cameras",
            f"{roll:.2f}, {pitch:.2f}, {yaw:.2f} deg",
            "below 5",
            bool(max(abs(roll), abs(pitch), abs(yaw)) < 5.0),
        ),
    ]
    rectification = Rectification(rig)
    corners = [rectification.points(view.left, view.right) for view in views]
    errors = [
        np.where(view.seen, np.abs(right[:, 1] - left[:, 1]), 0.0)
        for view, (left, right) in zip(views, corners, strict=True)
    ]
    worst = int(np.argmax([np.sqrt(np.mean(each**2)) for each in errors]))
    (left, right), stereo = corners[worst], rectification.stereo
    disparity = np.median((left[:, 0] - right[:, 0])[views[worst].seen])
    distance = float(stereo.left.fx * stereo.baseline_m / disparity)
    seen = views[worst].seen
    level = errors[worst][seen] < LARGEST_SLOPE_PX
    share = float(
        np.mean([np.mean(each[v.seen] < LARGEST_SLOPE_PX) for each, v in zip(errors, views, strict=True)])
    )
    lines = CheckResult(
        "lines between corners that are horizontal", f"{100 * share:.0f} %", "above 95", share > 0.95
    )
    results = [*shown, *checks(rig, measured, board), lines]
    return Checkout(results, left[seen], right[seen], level, worst, distance)


@dataclass(frozen=True)
class ParameterChange:
    """One number of two calibrations.

    Attributes
    ----------
    name, unit : str
        Of the number.
    first, second : float
        Its values.
    std : float or None
        Standard deviation of their difference; None where no calibration states one.
    """

    name: str
    unit: str
    first: float
    second: float
    std: float | None

    @property
    def difference(self) -> float:
        """Second less first."""
        return self.second - self.first

    @property
    def deviations(self) -> float | None:
        """The difference in its standard deviations; None without them."""
        return None if self.std is None or not self.std > 0 else self.difference / self.std


@dataclass(frozen=True)
class CalibrationDeviations:
    """Standard deviations of a calibration, from its ``calibration.json``.

    Attributes
    ----------
    intrinsics : ndarray of float, shape (2, 4)
        fx, fy, cx, cy of both cameras, px.
    position, rotation : ndarray of float, shape (3,)
        Of the left camera's place in the right one, m, and of the rotation between both, rad, along the right camera's axes; NaN
        where an older file does not hold them.
    """

    intrinsics: Float[np.ndarray, "2 4"]
    position: Float[np.ndarray, "3"]
    rotation: Float[np.ndarray, "3"]


def read_deviations(folder: Path) -> CalibrationDeviations | None:
    """Standard deviations that a calibration's folder states; None without the file.

    Parameters
    ----------
    folder : Path
        That `spinfilters calibrate` wrote.

    Raises
    ------
    InputError
        A file without the numbers.
    """
    path = folder / CALIBRATION_FILE
    if not path.exists():
        return None
    try:
        document = json.loads(read_settings_text(path))
        intrinsics = [
            [float(document[camera]["parameters"][key]["std"]) for key in ("fx", "fy", "cx", "cy")]
            for camera in ("cam0", "cam1")
        ]
        position, rotation = (
            np.array([float(value) for value in document.get(key, [np.nan] * 3)])
            for key in ("relative_position_std_m", "relative_rotation_std_rad")
        )
        if position.shape != (3,) or rotation.shape != (3,):
            raise ValueError("three axes")
    except (ValueError, KeyError, TypeError, RecursionError):
        raise InputError(
            f"{path_text(path)}: holds no standard deviations of a calibration; write it with spinfilters calibrate"
        ) from None
    return CalibrationDeviations(np.array(intrinsics), position, rotation)


def calibration_changes(
    first: RawRig,
    second: RawRig,
    first_std: CalibrationDeviations | None = None,
    second_std: CalibrationDeviations | None = None,
) -> list[ParameterChange]:
    """What differs between two calibrations of one rig (Tweddle 2013, Table 5.5).

    Parameters
    ----------
    first, second : RawRig
        Before and after.
    first_std, second_std : CalibrationDeviations or None
        Those that the calibrations state.

    Returns
    -------
    list of ParameterChange
        Focal lengths and centres, px; place of the left camera in the right one, mm; and the rotation from the first relative
        attitude to the second, as an angle about each axis of the right camera, deg.
    """
    known = [each for each in (first_std, second_std) if each is not None]
    joined = (
        CalibrationDeviations(
            *(
                np.sqrt(np.sum([values**2 for values in each], axis=0))
                for each in zip(*((std.intrinsics, std.position, std.rotation) for std in known), strict=True)
            )
        )
        if known
        else None
    )
    changes = []
    cameras = (("left", first.left, second.left), ("right", first.right, second.right))
    for number, (name, before, after) in enumerate(cameras):
        for k, word in enumerate(("focal length fx", "focal length fy", "centre cx", "centre cy")):
            values = float(before.intrinsics[k]), float(after.intrinsics[k])
            std = None if joined is None else float(joined.intrinsics[number, k])
            changes.append(ParameterChange(f"{name} {word}", "px", *values, std))
    for k, axis in enumerate("xyz"):
        values = 1e3 * float(first.relative_position[k]), 1e3 * float(second.relative_position[k])
        std = None if joined is None else _stated_or_none(1e3 * joined.position[k])
        changes.append(ParameterChange(f"translation {axis}", "mm", *values, std))
    turn = np.rad2deg(_relative_rotation(first, second))
    for k, axis in enumerate("xyz"):
        std = None if joined is None else _stated_or_none(np.rad2deg(joined.rotation[k]))
        changes.append(ParameterChange(f"rotation change about {axis}", "deg", 0.0, float(turn[k]), std))
    return changes


def _stated_or_none(std: float) -> float | None:
    """A deviation, None for NaN."""
    return float(std) if np.isfinite(std) else None


def rotation_change(first: RawRig, second: RawRig) -> tuple[float, Float[np.ndarray, "3"]]:
    """Angle, rad, and unit axis of the rotation from the first relative attitude of the cameras to the second."""
    turn = _relative_rotation(first, second)
    angle = float(np.linalg.norm(turn))
    return angle, turn / angle if angle > 0 else np.array([1.0, 0.0, 0.0])


def _relative_rotation(first: RawRig, second: RawRig) -> Float[np.ndarray, "3"]:
    """Rotation vector from the first relative attitude of the cameras to the second, rad."""
    return rotation_vector(second.relative_rotation @ first.relative_rotation.T)
