"""Calibration of a stereo pair from views of a board, its check on views that were left out, and its files.

The files are cameras as this package and OpenCV read them, and every number with its deviation.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import matrix_from_rotation_vector, rotation_vector_from_matrix
from spinfilters.core.errors import InputError
from spinfilters.io.camera import deviations_text
from spinfilters.io.output_files import write_json, write_text
from spinfilters.vision.calibration_images import FEWEST_PAIRS, Board, BoardView, distinct_views
from spinfilters.vision.camera_calibration import (
    ITERATIONS,
    PARAMETERS,
    RELATIVE,
    CameraCalibration,
    CameraPair,
    RelativePose,
    calibrated_camera,
    calibration_covariance,
)
from spinfilters.vision.image_folder import LossCount
from spinfilters.vision.rectification import RawCamera, RawRig, Rectification, write_raw_rig
from spinfilters.vision.stereo_geometry import points_of

OUTLIER: Final = 3.0
"""Times the median error of all views, beyond which a view is left out."""
LARGEST_ERROR_PX: Final = 1.5
"""Error below which no view is left out, however good the others are."""
LEAST_TRANSFER_ERROR_PX: Final = 2.0
"""Of the right corners where the left image predicts them, below which images are a pair."""
HOPELESS_STD: Final = 0.1
"""Relative deviation of focal length or baseline from which there is no calibration at all."""


@dataclass(frozen=True)
class StereoCalibration:
    """Calibration of a stereo pair.

    Attributes
    ----------
    rig : RawRig
        Body frame is the left camera.
    cameras : CameraPair
        Left and right.
    rms : float
        Of the pair, px.
    views : list[BoardView]
        That were used.
    dropped : dict[str, str]
        Name of a view and why it was left out.
    repeated : dict[str, str]
        Name of a view, and of the one at whose place it shows the board, with which it counts as one.
    baseline_std : float
        m.
    rotation_std : float
        Of the angle between the cameras, rad.
    position_std, turn_std : ndarray of shape (3,)
        Of the left camera's place in the right one, m, and of the rotation between both, rad, along the right camera's axes.
    view_errors : ndarray of shape (v, 2)
        Rms of each used view in both images, px.
    """

    rig: RawRig
    cameras: CameraPair
    rms: float
    views: list[BoardView]
    dropped: dict[str, str]
    repeated: dict[str, str]
    baseline_std: float
    rotation_std: float
    position_std: Float[np.ndarray, "3"]
    turn_std: Float[np.ndarray, "3"]
    view_errors: Float[np.ndarray, "v 2"] = field(repr=False)

    @property
    def baseline(self) -> float:
        """Distance between the cameras, m."""
        return float(np.linalg.norm(self.rig.relative_position))


def calibrate_stereo(views: list[BoardView], board: Board, size: tuple[int, int]) -> StereoCalibration:
    """Calibrate both cameras, then their relative pose.

    Views that disagree with the others are left out and named; those that show the board at one place count as one.

    Raises
    ------
    InputError
        Fewer than four views that differ and agree; views that do not determine focal length or baseline.
    """
    dropped: dict[str, str] = {}
    views, repeated = distinct_views(views, size)
    if len(views) < FEWEST_PAIRS <= len(views) + len(repeated):
        raise InputError(
            f"the views do not determine the focal length: {len(views) + len(repeated)} views show the board at only {len(views)} "
            f"of {FEWEST_PAIRS} different places that are needed; move the board and tilt it between the images"
        )
    while True:
        _require_views(views, dropped)
        cameras = CameraPair(*(calibrated_camera(views, board, size, right=right) for right in (False, True)))
        reason = _worst_camera(views, cameras) or _worst_pair(views, cameras, board)
        if reason is None:
            break
        row, why = reason
        dropped[views.pop(row).name] = why
    found = _join_cameras(views, cameras, board, size, dropped, repeated)
    for what, deviation in undetermined(found, HOPELESS_STD):
        raise InputError(f"{undetermined_text(what, deviation)} between the images")
    return found


def undetermined(found: StereoCalibration, limit: float) -> list[tuple[str, float]]:
    """Focal length and baseline where their relative deviations are not below a limit: name and deviation."""
    deviations = {
        "focal length": max(camera.focal_std for camera in found.cameras),
        "baseline": found.baseline_std / found.baseline,
    }
    return [(what, deviation) for what, deviation in deviations.items() if not deviation < limit]


def undetermined_text(what: str, deviation: float) -> str:
    """Sentence that the views do not determine a quantity, with the cure."""
    known = f"+- {100 * deviation:.1f} %" if deviation < 1 else "known to no digit"
    return f"the views do not determine the {what} ({known}): move the board and tilt it by 20 to 45 degrees"


def _require_views(views: list[BoardView], dropped: dict[str, str]) -> None:
    if len(views) < FEWEST_PAIRS:
        left_out = "; ".join(f"{name}: {why}" for name, why in list(dropped.items())[:2])
        raise InputError(
            f"{len(views)} views of the board agree, {FEWEST_PAIRS} are needed ({left_out}); check the pairs"
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


def _worst_pair(views: list[BoardView], cameras: CameraPair, board: Board) -> tuple[int, str] | None:
    """The view whose relative camera pose deviates most from the others.

    Its images were not taken together. A far or blurred view has a poor pose of the board: it is left out only if its right corners
    also stand elsewhere than its left ones say.
    """
    turns, places = _relative_poses(cameras)
    typical_turn, typical = np.median(turns, axis=0), np.median(places, axis=0)
    off = np.linalg.norm(places - typical, axis=1)
    angle = np.linalg.norm(turns - typical_turn, axis=1)
    missed = _transfer_errors(views, cameras, board, RelativePose(typical_turn, typical))
    stands_elsewhere = np.maximum(
        off / _outlier_limit(off, 0.1 * float(np.linalg.norm(typical))), angle / _outlier_limit(angle, 0.02)
    )
    score = np.minimum(stands_elsewhere, missed / _outlier_limit(missed, LEAST_TRANSFER_ERROR_PX))
    row = int(score.argmax())
    if score[row] <= 1:
        return None
    return row, (
        f"its images are no pair: the cameras stand {1e3 * off[row]:.1f} mm and {np.rad2deg(angle[row]):.2f} deg otherwise than in "
        f"the other views"
    )


def _transfer_errors(
    views: list[BoardView],
    cameras: CameraPair,
    board: Board,
    relative: RelativePose,
) -> Float[np.ndarray, " v"]:
    """Rms by which right corners miss those that the left pose of the board predicts, px, of each view."""
    found = []
    for view, pose in zip(views, cameras.left.poses, strict=True):
        turn, place = cv2.composeRT(pose[:3], pose[3:], *relative)[:2]
        pixels = cv2.projectPoints(board.points, turn, place, cameras.right.K, cameras.right.distortion)[
            0
        ].reshape(-1, 2)
        found.append(np.sqrt(((pixels - view.right)[view.seen] ** 2).sum(axis=1).mean()))
    return np.array(found)


def _outlier_limit(values: Float[np.ndarray, " v"], least: float) -> float:
    """Outlier limit: six times the median, and no small thing either."""
    return max(6 * float(np.median(values)), least)


def _relative_poses(
    cameras: CameraPair,
) -> tuple[Float[np.ndarray, "v 3"], Float[np.ndarray, "v 3"]]:
    """Rotation vectors and places of the left camera in the right one, of each view."""
    turns, places = [], []
    for left, right in zip(cameras.left.poses, cameras.right.poses, strict=True):
        R = matrix_from_rotation_vector(right[:3]) @ matrix_from_rotation_vector(left[:3]).T
        turns.append(rotation_vector_from_matrix(R))
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


def _join_cameras(
    views: list[BoardView],
    cameras: CameraPair,
    board: Board,
    size: tuple[int, int],
    dropped: dict[str, str],
    repeated: dict[str, str],
) -> StereoCalibration:
    """The relative pose, with both cameras as they are, and the covariance of all."""
    left, right = cameras
    turns, places = _relative_poses(cameras)
    R_middle = np.ascontiguousarray(
        matrix_from_rotation_vector(np.median(turns, axis=0))
    )  # OpenCV writes into it
    middle = R_middle, np.median(places, axis=0).reshape(3, 1)
    solved = cv2.stereoCalibrateExtended(
        *_seen_points(views, board),
        *(left.K, left.distortion.copy(), right.K, right.distortion.copy(), size),
        *middle,
        flags=cv2.CALIB_FIX_INTRINSIC,
        criteria=ITERATIONS,
    )
    R, t = np.asarray(solved[5]), np.asarray(solved[6]).ravel()
    first = RawCamera(_four_intrinsics(left.K), left.distortion, *size, np.eye(3), np.zeros(3))
    second = RawCamera(_four_intrinsics(right.K), right.distortion, *size, R.T, -R.T @ t)
    known = calibration_covariance(
        views, board, cameras, RelativePose(rotation_vector_from_matrix(R), t), size
    )
    deviations = known.std
    of_pose, along = known.covariance[RELATIVE, RELATIVE], t / np.linalg.norm(t)
    return StereoCalibration(
        RawRig(first, second),
        CameraPair(_with_std(left, deviations[:9]), _with_std(right, deviations[9:18])),
        float(solved[0]),
        views,
        dropped,
        repeated,
        float(np.sqrt(along @ of_pose[3:, 3:] @ along)),
        float(np.sqrt(np.trace(of_pose[:3, :3]))),
        np.sqrt(np.diag(of_pose[3:, 3:])),
        np.sqrt(np.diag(of_pose[:3, :3])),
        np.asarray(solved[-1]).reshape(-1, 2),
    )


def _with_std(camera: CameraCalibration, deviations: Float[np.ndarray, " 9"]) -> CameraCalibration:
    return replace(camera, std=dict(zip(PARAMETERS, deviations.tolist(), strict=True)))


def _four_intrinsics(K: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, " 4"]:
    return np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]])


def standing_out(found: StereoCalibration) -> list[str]:
    """Views kept although the others fit far better.

    Their corners may have been refined onto something near them.
    """
    sentences = []
    for side, camera in zip(("left", "right"), found.cameras, strict=True):
        median = float(np.median(camera.view_errors))
        for row in np.flatnonzero(camera.view_errors > OUTLIER * median).tolist():
            sentences.append(
                f"{found.views[row].name}: its {side} corners miss by {camera.view_errors[row]:.2f} px, the others by {median:.2f}"
            )
    return sentences


LARGEST_ROW_ERROR_PX: Final = 1.0
LARGEST_SQUARE_ERROR: Final = 0.02
"""Of the measured side of a square, relative."""
FIELD_OF_VIEW_DEG: Final = (10.0, 150.0)
LARGEST_CENTRE_OFFSET: Final = 0.15
"""Of the principal point from the middle of the image, over its width."""
LARGEST_ROTATION_DEG: Final = 15.0
LARGEST_RELATIVE_STD: Final = 0.02
"""Of focal length and baseline: beyond that, the views do not determine them."""


@dataclass(frozen=True)
class CheckResult:
    """Result of one check: quantity, number with unit, limit, verdict."""

    name: str
    value: str
    allowed: str
    passed: bool


@dataclass(frozen=True)
class BoardMeasurement:
    """Measurements of a rig on a board.

    Attributes
    ----------
    rows : ndarray of shape (n,)
        px by which rectified corners of a pair miss one another.
    squares : ndarray of shape (v,)
        Measured side of a square in each view, m.
    """

    rows: Float[np.ndarray, " n"]
    squares: Float[np.ndarray, " v"]


def measured_board(rig: RawRig, views: list[BoardView], board: Board) -> BoardMeasurement:
    """Row errors and sides of squares of all views."""
    rectification, rows, squares = Rectification(rig), [], []
    for view in views:
        left, right = rectification.points(view.left, view.right)
        rows.append((right[:, 1] - left[:, 1])[view.seen])
        values = np.column_stack([left, right[:, 0]])
        points = points_of(values, rectification.stereo)
        seen = view.seen & np.isfinite(points).all(axis=1)
        squares.append(board.square * _similarity_scale(board.points[seen], points[seen]))
    return BoardMeasurement(np.concatenate(rows), np.array(squares))


def _similarity_scale(true: Float[np.ndarray, "n 3"], measured: Float[np.ndarray, "n 3"]) -> float:
    """Scale s of the similarity that takes true points to measured ones, tr(R' M) / sum |x|^2 (Umeyama 1991).

    Its mean is right; that of measured sides is too large, by their noise squared over the side.
    """
    x, y = true - true.mean(axis=0), measured - measured.mean(axis=0)
    return float(np.linalg.svd(x.T @ y, compute_uv=False)[:2].sum() / (x**2).sum())


def checks(rig: RawRig, measured: BoardMeasurement, board: Board) -> list[CheckResult]:
    """All checks of a rig and what it measured."""
    results = [
        check
        for camera, name in ((rig.left, "cam0"), (rig.right, "cam1"))
        for check in _check_camera(camera, name)
    ]
    turn = np.rad2deg(np.arccos(np.clip((np.trace(rig.relative_rotation) - 1) / 2, -1, 1)))
    allowed, name = f"below {LARGEST_ROTATION_DEG:g}", "rotation between the cameras"
    results.append(CheckResult(name, f"{turn:.2f} deg", allowed, bool(turn < LARGEST_ROTATION_DEG)))
    rows = float(np.sqrt(np.mean(measured.rows**2)))
    allowed, name = f"below {LARGEST_ROW_ERROR_PX:g}", "epipolar misalignment, rms"
    results.append(CheckResult(name, f"{rows:.3f} px", allowed, rows < LARGEST_ROW_ERROR_PX))
    side, spread = float(np.mean(measured.squares)), float(np.std(measured.squares))
    off = abs(side / board.square - 1)
    allowed = f"{1e3 * board.square:g} within {100 * LARGEST_SQUARE_ERROR:g} %"
    results.append(
        CheckResult(
            "measured square",
            f"{1e3 * side:.3f} +- {1e3 * spread:.3f} mm",
            allowed,
            off < LARGEST_SQUARE_ERROR,
        )
    )
    return results


def determination(found: StereoCalibration) -> list[CheckResult]:
    """Checks that the views determine focal length and baseline."""
    doubted = dict(undetermined(found, LARGEST_RELATIVE_STD))
    deviations = dict(undetermined(found, 0.0))
    return [
        CheckResult(
            undetermined_text(what, doubted[what]) if what in doubted else f"{what} determined by the views",
            f"+- {100 * deviation:.2f} %",
            f"below {100 * LARGEST_RELATIVE_STD:g}",
            what not in doubted,
        )
        for what, deviation in deviations.items()
    ]


def _check_camera(camera: RawCamera, name: str) -> list[CheckResult]:
    fx, fy, cx, cy = camera.intrinsics.tolist()
    view = float(2 * np.rad2deg(np.arctan(camera.width / 2 / fx)))
    low, high = FIELD_OF_VIEW_DEG
    offset = max(abs(cx - (camera.width - 1) / 2), abs(cy - (camera.height - 1) / 2)) / camera.width
    return [
        CheckResult(f"{name}: field of view", f"{view:.1f} deg", f"{low:g} to {high:g}", low < view < high),
        CheckResult(f"{name}: fx / fy", f"{fx / fy:.4f}", "0.95 to 1.05", 0.95 < fx / fy < 1.05),
        CheckResult(
            f"{name}: principal point off the middle",
            f"{100 * offset:.1f} % of the width",
            f"below {100 * LARGEST_CENTRE_OFFSET:g}",
            offset < LARGEST_CENTRE_OFFSET,
        ),
    ]


def write_calibration(
    folder: Path,
    found: StereoCalibration,
    measured: BoardMeasurement,
    results: list[CheckResult],
    losses: LossCount,
) -> None:
    """Write ``cam0/sensor.yaml``, ``cam1/sensor.yaml``, ``opencv.yml`` and ``calibration.json`` into a folder that exists.

    Parameters
    ----------
    folder : Path
        That exists.
    found : StereoCalibration
        The cameras with their standard deviations.
    measured : BoardMeasurement
        The board as this calibration measures it.
    results : list[CheckResult]
        Of the checkout; empty where none was asked for.
    losses : LossCount
        Images that were not used, and why.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    write_raw_rig(found.rig, folder, stated_deviations(found))
    write_text(folder / "opencv.yml", _opencv_text(found.rig))
    write_json(folder / "calibration.json", _document(found, measured, results, losses))


def stated_deviations(found: StereoCalibration) -> tuple[str, str]:
    """Standard deviations of each camera's calibration file, the baseline's with the right one."""
    left, right = ([camera.std[key] for key in PARAMETERS[:4]] for camera in found.cameras)
    return deviations_text(left), deviations_text(right, found.baseline_std)


def _document(
    found: StereoCalibration, measured: BoardMeasurement, results: list[CheckResult], losses: LossCount
) -> dict[str, Any]:
    cameras = {}
    for name, camera in zip(("cam0", "cam1"), found.cameras, strict=True):
        values = [camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2], *camera.distortion]
        cameras[name] = {
            "rms_px": camera.rms,
            "parameters": {
                key: {"value": float(value), "std": camera.std[key]}
                for key, value in zip(PARAMETERS, values, strict=True)
            },
        }
    return {
        **cameras,
        "stereo_rms_px": found.rms,
        "baseline_m": {"value": found.baseline, "std": found.baseline_std},
        "rotation_std_rad": found.rotation_std,
        "relative_position_std_m": found.position_std.tolist(),
        "relative_rotation_std_rad": found.turn_std.tolist(),
        "views": {
            view.name: errors for view, errors in zip(found.views, found.view_errors.tolist(), strict=True)
        },
        "dropped": found.dropped,
        "repeated": found.repeated,
        "images": losses.document,
        "row_error_rms_px": float(np.sqrt(np.mean(measured.rows**2))),
        "square_m": {"mean": float(np.mean(measured.squares)), "std": float(np.std(measured.squares))},
        "checks": [vars(result) for result in results],
    }


def _opencv_text(rig: RawRig) -> str:
    """Both cameras and their relative pose, as OpenCV's samples name them."""
    storage = cv2.FileStorage("opencv.yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for number, camera in ((1, rig.left), (2, rig.right)):
        storage.write(f"M{number}", camera.camera_matrix)
        storage.write(f"D{number}", camera.distortion.reshape(1, -1))
    storage.write("R", rig.relative_rotation)
    storage.write("T", rig.relative_position.reshape(3, 1))
    return storage.releaseAndGetString()
