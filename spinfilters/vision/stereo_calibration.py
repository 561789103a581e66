"""Calibration of a stereo pair from views of a board (Zhang 2000; Tweddle 2013, section 2.8)."""

from dataclasses import dataclass, field
from typing import Final, NamedTuple

import cv2
import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.vision.calibration_images import FEWEST_PAIRS, Board, BoardView
from spinfilters.vision.raw_rig import RawCamera, RawRig

OUTLIER: Final = 3.0
"""Times the median error of all views, beyond which a view is left out."""
LARGEST_ERROR_PX: Final = 1.5
"""Error below which no view is left out, however good the others are."""
PARAMETERS: Final[tuple[str, ...]] = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
_ITERATIONS: Final = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-9)


@dataclass(frozen=True)
class CameraCalibration:
    """Calibration of one camera.

    Attributes
    ----------
    K, distortion: found.   std: standard deviation of `PARAMETERS`.   rms: px.
    view_errors: (v,) rms of each view, px.   poses: of the board in the camera, rotation vector and place, (v, 6).
    """

    K: Float[np.ndarray, "3 3"]
    distortion: Float[np.ndarray, " 5"]
    std: dict[str, float]
    rms: float
    view_errors: Float[np.ndarray, " v"]
    poses: Float[np.ndarray, "v 6"]


class CameraPair(NamedTuple):
    """Calibrations of both cameras, each by itself."""

    left: CameraCalibration
    right: CameraCalibration


@dataclass(frozen=True)
class StereoCalibration:
    """Calibration of a stereo pair.

    Attributes
    ----------
    rig: body frame is the left camera.   cameras: left and right.   rms: of the pair, px.   views: that were used.
    dropped: name of a view and why it was left out.   baseline_std: m.   rotation_std: of the angle between the cameras, rad.
    view_errors: (v, 2) rms of each used view in both images, px.
    """

    rig: RawRig
    cameras: CameraPair
    rms: float
    views: list[BoardView]
    dropped: dict[str, str]
    baseline_std: float
    rotation_std: float
    view_errors: Float[np.ndarray, "v 2"] = field(repr=False)


def calibrate_stereo(views: list[BoardView], board: Board, size: tuple[int, int]) -> StereoCalibration:
    """Calibrate both cameras, then their relative pose.

    Views that disagree with the others are left out and named.

    Raises
    ------
    InputError: fewer than four views that agree.
    """
    dropped: dict[str, str] = {}
    views = list(views)
    while True:
        _require(views, dropped)
        cameras = CameraPair(*(_calibrated(views, board, size, right=right) for right in (False, True)))
        reason = _worst_camera(views, cameras) or _worst_pair(views, cameras)
        if reason is None:
            break
        row, why = reason
        dropped[views.pop(row).name] = why
    return _joined(views, cameras, board, size, dropped)


def _require(views: list[BoardView], dropped: dict[str, str]) -> None:
    if len(views) < FEWEST_PAIRS:
        left_out = "; ".join(f"{name}: {why}" for name, why in list(dropped.items())[:2])
        raise InputError(
            f"{len(views)} views of the board agree, {FEWEST_PAIRS} are needed ({left_out}); check the pairs"
        )


def _calibrated(
    views: list[BoardView], board: Board, size: tuple[int, int], right: bool
) -> CameraCalibration:
    points = [board.points[view.seen].astype(np.float32) for view in views]
    pixels = [(view.right if right else view.left)[view.seen].astype(np.float32) for view in views]
    rms, K, distortion, turns, places, deviations, _, errors = cv2.calibrateCameraExtended(
        points, pixels, size, np.eye(3), np.zeros(5), criteria=_ITERATIONS
    )
    std: dict[str, float] = dict(zip(PARAMETERS, np.asarray(deviations).ravel()[:9].tolist(), strict=True))
    poses = np.column_stack([np.reshape(turns, (-1, 3)), np.reshape(places, (-1, 3))])
    return CameraCalibration(
        np.asarray(K), np.asarray(distortion).ravel()[:5], std, float(rms), np.asarray(errors).ravel(), poses
    )


def _worst_camera(views: list[BoardView], cameras: CameraPair) -> tuple[int, str] | None:
    """A view whose corners one camera explains badly."""
    for side, camera in zip(("left", "right"), cameras, strict=True):
        row = int(camera.view_errors.argmax())
        bound = max(LARGEST_ERROR_PX, OUTLIER * float(np.median(camera.view_errors)))
        if camera.view_errors[row] > bound:
            median = float(np.median(camera.view_errors))
            return (
                row,
                f"its {side} corners miss by {camera.view_errors[row]:.2f} px, the others by {median:.2f}",
            )
    return None


def _worst_pair(views: list[BoardView], cameras: CameraPair) -> tuple[int, str] | None:
    """The view whose relative camera pose deviates most from the others.

    Its images were not taken together.
    """
    turns, places = _relative(cameras)
    typical = np.median(places, axis=0)
    off = np.linalg.norm(places - typical, axis=1)
    angle = np.linalg.norm(turns - np.median(turns, axis=0), axis=1)
    score = np.maximum(off / _limit(off, 0.1 * float(np.linalg.norm(typical))), angle / _limit(angle, 0.02))
    row = int(score.argmax())
    if score[row] <= 1:
        return None
    return row, (
        f"its images are no pair: the cameras stand {1e3 * off[row]:.1f} mm and {np.rad2deg(angle[row]):.2f} deg otherwise than in "
        f"the other views"
    )


def _limit(values: Float[np.ndarray, " v"], least: float) -> float:
    """Outlier limit: six times the median, and no small thing either."""
    return max(6 * float(np.median(values)), least)


def _relative(
    cameras: CameraPair,
) -> tuple[Float[np.ndarray, "v 3"], Float[np.ndarray, "v 3"]]:
    """Rotation vectors and places of the left camera in the right one, of each view."""
    turns, places = [], []
    for left, right in zip(cameras.left.poses, cameras.right.poses, strict=True):
        R = cv2.Rodrigues(right[:3])[0] @ cv2.Rodrigues(left[:3])[0].T
        turns.append(cv2.Rodrigues(R)[0].ravel())
        places.append(right[3:] - R @ left[3:])
    return np.array(turns), np.array(places)


def _seen_points(
    views: list[BoardView], board: Board
) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
    """Corners that both cameras see.

    On the board (m), in the left and in the right images (px).
    """
    return (
        [board.points[view.seen].astype(np.float32) for view in views],
        [view.left[view.seen].astype(np.float32) for view in views],
        [view.right[view.seen].astype(np.float32) for view in views],
    )


def _joined(
    views: list[BoardView],
    cameras: CameraPair,
    board: Board,
    size: tuple[int, int],
    dropped: dict[str, str],
) -> StereoCalibration:
    """The relative pose, with both cameras as they are."""
    left, right = cameras
    turns, places = _relative(cameras)
    middle = cv2.Rodrigues(np.median(turns, axis=0))[0], np.median(places, axis=0).reshape(3, 1)
    solved = cv2.stereoCalibrateExtended(
        *_seen_points(views, board),
        *(left.K, left.distortion.copy(), right.K, right.distortion.copy(), size),
        *middle,
        flags=cv2.CALIB_FIX_INTRINSIC,
        criteria=_ITERATIONS,
    )
    R, t = np.asarray(solved[5]), np.asarray(solved[6]).ravel()
    first = RawCamera(_four(left.K), left.distortion, *size, np.eye(3), np.zeros(3))
    second = RawCamera(_four(right.K), right.distortion, *size, R.T, -R.T @ t)
    return StereoCalibration(
        RawRig(first, second),
        cameras,
        float(solved[0]),
        views,
        dropped,
        _std_of_mean(np.linalg.norm(places, axis=1)),
        _std_of_mean(np.linalg.norm(turns - cv2.Rodrigues(R)[0].ravel(), axis=1)),
        np.asarray(solved[-1]).reshape(-1, 2),
    )


def _std_of_mean(values: Float[np.ndarray, " v"]) -> float:
    return float(np.std(values, ddof=1) / np.sqrt(len(values)))


def _four(K: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, " 4"]:
    return np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]])


def standing_out(found: StereoCalibration) -> list[str]:
    """Views kept although the others fit far better.

    Their corners may have been refined onto something beside them.
    """
    sentences = []
    for side, camera in zip(("left", "right"), found.cameras, strict=True):
        median = float(np.median(camera.view_errors))
        for row in np.flatnonzero(camera.view_errors > OUTLIER * median).tolist():
            sentences.append(
                f"{found.views[row].name}: its {side} corners miss by {camera.view_errors[row]:.2f} px, the others by {median:.2f}"
            )
    return sentences
