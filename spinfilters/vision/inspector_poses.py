"""Known poses of the inspector that took the stereo images of a folder."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from spinfilters.data.input_file import path_text
from spinfilters.data.inspector_files import INSPECTOR_FILE
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.data.pose_files import read_tum
from spinfilters.errors import InputError
from spinfilters.geometry.camera_trajectory import CameraTrajectory
from spinfilters.vision.image_folder import StampedPair
from spinfilters.vision.rectification import Rectification

NANOSECOND = 1e-9


def rectified_camera_poses(
    folder: Path, pairs: list[StampedPair], rectification: Rectification
) -> MeasurementStream | None:
    """Poses of the rectified left camera in i; None of an inspector at rest.

    Times count from the first pair, s.
    The file ``inspector.tum`` holds those of the raw left camera, on the clock of the images' stamps, s.

    Raises
    ------
    InputError: what `read_tum` refuses, poses that do not cover the pairs. The text names the file.
    """
    path = folder / INSPECTOR_FILE
    if not os.path.lexists(path):
        return None
    raw = read_tum(path)
    try:
        CameraTrajectory(raw.time, raw.values).require_cover(
            np.array([pair.stamp * NANOSECOND for pair in (pairs[0], pairs[-1])])
        )
    except InputError as error:
        raise InputError(f"{path_text(path)}: {error}") from None
    return replace(
        raw, time=raw.time - pairs[0].stamp * NANOSECOND, values=rectification.left_poses(raw.values)
    )
