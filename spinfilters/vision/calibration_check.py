"""Checks of a calibration after the thesis' astronaut checkout (section 5.10)."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.geometry.cameras import stereo_pair
from spinfilters.vision.calibration_images import Board, BoardView
from spinfilters.vision.raw_rig import RawCamera, RawRig
from spinfilters.vision.rectification import Rectification
from spinfilters.vision.stereo_calibration import StereoCalibration, undetermined, undetermined_text

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
    rows: (n,) px by which rectified corners of a pair miss one another.   squares: (v,) measured side of a square in each view, m.
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
        points = stereo_pair(rectification.stereo.calibration).points_of(
            values, rectification.stereo.calibration
        )
        seen = view.seen & np.isfinite(points).all(axis=1)
        squares.append(board.square * _scale(board.points[seen], points[seen]))
    return BoardMeasurement(np.concatenate(rows), np.array(squares))


def _scale(true: Float[np.ndarray, "n 3"], measured: Float[np.ndarray, "n 3"]) -> float:
    """Scale s of the similarity that takes true points to measured ones, tr(R' M) / sum |x|^2 (Umeyama 1991).

    Its mean is right; that of measured sides is too large, by their noise squared over the side.
    """
    x, y = true - true.mean(axis=0), measured - measured.mean(axis=0)
    return float(np.linalg.svd(x.T @ y, compute_uv=False)[:2].sum() / (x**2).sum())


def checks(rig: RawRig, measured: BoardMeasurement, board: Board) -> list[CheckResult]:
    """All checks of a rig and what it measured."""
    results = [
        check for camera, name in ((rig.left, "cam0"), (rig.right, "cam1")) for check in _camera(camera, name)
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


def _camera(camera: RawCamera, name: str) -> list[CheckResult]:
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
