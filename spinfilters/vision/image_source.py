"""A folder of stereo images with all that is known beside them, on one clock."""

import os
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float

from spinfilters.data.dataset import INSPECTOR_FILE
from spinfilters.data.input_file import path_text
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.data.pose_files import read_tum
from spinfilters.data.truth import TRUTH_FILES, TRUTH_TABLE, Truth, read_truth
from spinfilters.errors import InputError
from spinfilters.geometry.camera_trajectory import CameraTrajectory
from spinfilters.vision.image_folder import NANOSECOND, StampedPair, stamped_pairs
from spinfilters.vision.loss_count import LossCount
from spinfilters.vision.raw_rig import read_raw_rig
from spinfilters.vision.rectification import Rectification

SAME_TIME_S: Final = 1e-6
"""Times that differ by less are one: seconds since 1970 are told to a quarter of it."""
SHORTEST_INTERVAL_S: Final = 1e-5
"""Between pairs, on the mean: less is another unit, or numbers of images."""
SPARSEST: Final = 10.0
"""Durations of all images, beyond which poses of an inspector are apart by no motion that images could see."""


class ImageSource(NamedTuple):
    """A folder of images with its rectified cameras and stamped pairs.

    ``inspector`` holds the poses of the rectified left camera in i; None of one at rest. Times count from the first pair, s.
    """

    folder: Path
    rectification: Rectification
    pairs: list[StampedPair]
    inspector: MeasurementStream | None
    truth: Truth | None


def read_image_source(folder: Path, losses: LossCount) -> ImageSource:
    """Calibration, pairs, inspector and truth of a folder; no image is read.

    ``inspector.tum`` holds poses of the raw left camera, ``truth.csv`` the truth, both on the clock of the images' stamps, s.

    Raises
    ------
    InputError: no calibration, no pairs, cameras that are not side by side, stamps in another unit, poses that do not cover the
    pairs, a truth of another time. The text names the file.
    """
    rectification = Rectification(read_raw_rig(folder))
    try:
        _ = rectification.stereo
    except InputError as error:
        raise InputError(f"{path_text(folder)}: {error}") from None
    pairs = stamped_pairs(folder, losses)
    mean = pairs[-1].time / (len(pairs) - 1)
    if mean < SHORTEST_INTERVAL_S:
        raise InputError(
            f"{path_text(folder)}: {len(pairs)} pairs are {mean:.2g} s apart by their stamps; write the times in ns into data.csv"
        )
    inspector = rectified_camera_poses(folder, pairs, rectification)
    truth = _truth(folder, pairs)
    if truth is not None and inspector is None:
        truth = rectification.truth(truth)
    return ImageSource(folder, rectification, pairs, inspector, truth)


def rectified_camera_poses(
    folder: Path, pairs: list[StampedPair], rectification: Rectification
) -> MeasurementStream | None:
    """Poses of the rectified left camera in i; None of an inspector at rest.

    Times count from the first pair, s. InputError: what `read_tum` refuses, poses that do not cover the pairs or are far too few.
    """
    path = folder / INSPECTOR_FILE
    if not os.path.lexists(path):
        return None
    raw = read_tum(path)
    poses = replace(raw, time=_from_first(pairs, raw.time), values=rectification.left_poses(raw.values))
    try:
        CameraTrajectory(poses.time, poses.values).require_cover(np.array([0.0, pairs[-1].time]))
    except InputError as error:
        raise InputError(f"{path_text(path)}: from the first pair on, {error}") from None
    apart = float(np.diff(poses.time).max(initial=0.0))
    if apart > SPARSEST * pairs[-1].time:
        raise InputError(
            f"{path_text(path)}: poses are {apart:.2g} s apart, and all images {pairs[-1].time:.2g} s; give their times in s"
        )
    return poses


def _truth(folder: Path, pairs: list[StampedPair]) -> Truth | None:
    """The truth by times from the first pair.

    InputError: as `read_truth`, or of another time than the images.
    """
    if not any(os.path.lexists(folder / name) for name in TRUTH_FILES):
        return None
    truth = read_truth(folder)
    time = _from_first(pairs, truth.time)
    if time[-1] < 0 or time[0] > pairs[-1].time:
        raise InputError(
            f"{path_text(folder / TRUTH_TABLE)}: is from {truth.time[0]:.9g} s to {truth.time[-1]:.9g} s, the images by their "
            f"stamps from {pairs[0].stamp * NANOSECOND:.9g} s to {pairs[-1].stamp * NANOSECOND:.9g} s; give both on one clock"
        )
    return replace(truth, time=time)


def _from_first(pairs: list[StampedPair], time: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Times on the images' clock from the first pair; those of a pair to the bit."""
    since = time - pairs[0].stamp * NANOSECOND
    stamps = np.array([pair.time for pair in pairs])
    after = np.clip(np.searchsorted(stamps, since), 1, len(stamps) - 1)
    nearest = np.where(since - stamps[after - 1] < stamps[after] - since, stamps[after - 1], stamps[after])
    return np.where(np.abs(nearest - since) < SAME_TIME_S, nearest, since)
