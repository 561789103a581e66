"""``spinfilters calibrate``."""

import argparse
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from spinfilters.cli.console import wide_console
from spinfilters.core.errors import InputError
from spinfilters.io.camera import deviations_text
from spinfilters.io.input_file import path_text
from spinfilters.io.output_files import output_folder, refuse_foreign, write_json, write_text
from spinfilters.plots.measurement_figures import calibration_figure
from spinfilters.plots.style import save_figure
from spinfilters.vision.calibration_images import Board, board_views, image_pairs
from spinfilters.vision.camera_calibration import PARAMETERS
from spinfilters.vision.depth_map import disparity_map
from spinfilters.vision.image_folder import LossCount, read_image
from spinfilters.vision.rectification import RawRig, Rectification, write_raw_rig
from spinfilters.vision.stereo_calibration import (
    LARGEST_RELATIVE_STD,
    BoardMeasurement,
    CheckResult,
    StereoCalibration,
    calibrate_stereo,
    checks,
    determination,
    measured_board,
    standing_out,
    undetermined,
    undetermined_text,
)

COMMAND = "calibrate"


def calibrate(options: argparse.Namespace) -> int:
    """Calibrate a stereo pair; write and print the result."""
    source, folder, losses = Path(options.folder), Path(options.output), LossCount()
    board = Board.of(options.corners, options.square, options.charuco, options.window)
    refuse_foreign(folder, COMMAND)
    pairs = image_pairs(source)
    views, size = board_views(pairs, board, losses)
    try:
        found = calibrate_stereo(views, board, size)
    except InputError as error:
        raise InputError(f"{path_text(source)}: {error}") from None
    try:
        measured = measured_board(found.rig, found.views, board)
    except InputError as error:  # left and right exchanged, as a whole
        raise InputError(f"{path_text(source)}: {error} (left* is cam0)") from None
    results = [*determination(found), *checks(found.rig, measured, board)] if options.check else []
    with output_folder(folder, COMMAND) as place:
        write_raw_rig(found.rig, place, stated_deviations(found))
        write_text(place / "opencv.yml", _opencv_text(found.rig))
        write_json(place / "calibration.json", _document(found, measured, results, losses))
        if options.check:
            used = {view.name for view in found.views}
            pair = next(pair for pair in pairs if pair[0].name in used)
            save_figure(_figure(found, *pair), place / "check.png")
    _print(found, results, losses, options.window, folder)
    return 0 if all(result.passed for result in results) else 1


def _figure(found: StereoCalibration, left_path: Path, right_path: Path) -> Any:
    rectification = Rectification(found.rig)
    (left, _), (right, _) = read_image(left_path), read_image(right_path)
    assert left is not None  # the board was seen in both
    assert right is not None
    images = rectification.images(left, right)
    return calibration_figure(
        *images, disparity_map(*images, largest=found.rig.left.width // 4), found.view_errors
    )


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
        "baseline_m": {
            "value": found.baseline,
            "std": found.baseline_std,
        },
        "rotation_std_rad": found.rotation_std,
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


def _print(
    found: StereoCalibration, results: list[CheckResult], losses: LossCount, window: int, folder: Path
) -> None:
    lines = losses.sentences()
    for name, camera in zip(("left", "right"), found.cameras, strict=True):
        K, std = camera.K, camera.std
        lines.append(
            f"{name}: fx {K[0, 0]:.2f} +- {std['fx']:.2f}, fy {K[1, 1]:.2f} +- {std['fy']:.2f}, "
            f"centre {K[0, 2]:.2f}, {K[1, 2]:.2f} px; "
            f"rms {camera.rms:.3f} px"
        )
    lines.append(
        f"pair: baseline {1e3 * found.baseline:.2f} +- {1e3 * found.baseline_std:.2f} mm; "
        f"rms {found.rms:.3f} px, {len(found.views)} views"
    )
    lines += [f"left out: {name}: {why}" for name, why in found.dropped.items()]
    if found.repeated:
        first = next(iter(found.repeated.items()))
        lines.append(
            f"counted as one: {len(found.repeated)} views show the board where another does ({first[0]} as {first[1]})"
        )
    if not results:  # the checks say it themselves
        lines += [
            undetermined_text(what, deviation)
            for what, deviation in undetermined(found, LARGEST_RELATIVE_STD)
        ]
    lines += [f"{why}; try --window {max(3, 2 * window // 3)}" for why in standing_out(found)]
    lines += [
        f"{'ok  ' if result.passed else 'BAD '} {result.name}: {result.value} ({result.allowed})"
        for result in results
    ]
    for line in [*lines, f"calibration in {folder}"]:
        wide_console().print(line, highlight=False, soft_wrap=True)
