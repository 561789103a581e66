"""Files of a stereo calibration: cameras as this package and OpenCV read them, and every number with its deviation."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from spinfilters.io.camera import deviations_text
from spinfilters.io.output_files import write_json, write_text
from spinfilters.vision.camera_calibration import PARAMETERS
from spinfilters.vision.image_folder import LossCount
from spinfilters.vision.rectification import RawRig, write_raw_rig
from spinfilters.vision.stereo_calibration import BoardMeasurement, CheckResult, StereoCalibration


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
