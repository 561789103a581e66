"""Measurements of a folder of scans: registered into poses with covariance, or points on the faces of the body."""

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.conversions import (
    continuous_quaternions,
    matrix_from_quaternion,
    quaternion_from_matrix,
)
from spinfilters.data.dataset import DATASET_FILE
from spinfilters.data.input_file import path_text
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.data.raw_data import RawDataReader, RawMeasurements
from spinfilters.data.truth import Truth
from spinfilters.errors import InputError
from spinfilters.geometry.truth_frame import truth_in_moved_frame
from spinfilters.lidar.face_points import face_points
from spinfilters.lidar.scan import Scan
from spinfilters.lidar.scan_files import read_scan
from spinfilters.lidar.scan_pose import nearest_rotation, rotation_vector
from spinfilters.lidar.scan_poses import ScanPoses, scan_poses

KIND: Final = "lidar-scans"
"""Kind of a data set that holds scans, of which the poses are measurements."""
POINTS_KIND: Final = "lidar-scan-points"
"""Kind of a data set that holds scans, of which the points are measurements."""
SCAN_FOLDER: Final = "scans"
LARGE: Final = 25.0
"""Squared error of a pose, in standard deviations, at which its weight is halved."""
_STEPS = 8


def read_scans(folder: Path, truth: Truth | None) -> RawMeasurements:
    """Poses of the scans in ``scans/*.ply`` in time order.

    The truth is told in their frame g.

    Raises
    ------
    InputError: no scan, one that cannot be read, stamps that do not rise with the names, fewer than two that see the body.
    """
    found = registered_scans(folder)
    stream = pose_stream(found)
    told = None if truth is None else in_frame_of(stream, truth)
    return RawMeasurements(stream, told, found.remarks, found.doubts, found.inflation)


def read_scan_points(folder: Path, truth: Truth | None) -> RawMeasurements:
    """Points of the scans in ``scans/*.ply``, the truth told in the frame g of their faces.

    Raises
    ------
    InputError: as `read_scans`; a body without plane faces.
    """
    found = registered_scans(folder)
    try:
        points = face_points(found)
    except InputError as error:
        raise InputError(f"{path_text(folder)}: {error}") from None
    stream = MeasurementStream("lidar-points", points.time, points.values, None, points.covariance)
    told = None if truth is None else in_frame_of(pose_stream(found), truth)
    return RawMeasurements(stream, told, found.remarks, found.doubts)


def registered_scans(folder: Path) -> ScanPoses:
    """The scans in ``scans/*.ply`` with their poses. InputError: see `read_scans`."""
    paths = sorted((folder / SCAN_FOLDER).glob("*.ply"), key=_name_order)
    if not paths:
        raise InputError(
            f"{path_text(folder / DATASET_FILE)}: the kind is lidar-scans or lidar-scan-points, "
            f"but {SCAN_FOLDER} holds no .ply; put the scans there"
        )
    scans = [read_scan(path) for path in paths]
    _require_order(scans)
    try:
        return scan_poses(scans)
    except InputError as error:
        raise InputError(f"{path_text(folder)}: {error}") from None


def _name_order(path: Path) -> tuple[list[str | int], str]:
    """Key of names in the order of their numbers: scan2 before scan10."""
    parts = re.split(r"(\d+)", path.stem)
    return [int(part) if k % 2 else part for k, part in enumerate(parts)], path.name


def _require_order(scans: Sequence[Scan]) -> None:
    """InputError: a scan that is not after the one before in the order of names."""
    for first, second in pairwise(scans):
        if second.epoch == first.epoch:
            raise InputError(
                f"{second.name}: is at {second.epoch} s as the scan before; give every scan its own times (time_s)"
            )
        if second.epoch < first.epoch:
            raise InputError(
                f"{second.name}: is at {second.epoch:g} s, {Path(first.name).name} before it at {first.epoch:g} s: time runs "
                "backwards; name the scans in the order of their times, or correct time_s"
            )


def pose_stream(found: ScanPoses) -> MeasurementStream:
    """Poses as measurements of the sensor ``lidar-poses``; frame i is that of the lidar.

    Covariances are those of all errors, or of those that scans do not share, inflated for those that they do.
    """
    poses = found.poses
    told = [
        pose.covariance if pose.own_covariance is None else found.inflation * pose.own_covariance
        for pose in poses
    ]
    q = continuous_quaternions(
        quaternion_from_matrix(np.array([nearest_rotation(pose.rotation) for pose in poses]))
    )
    values = np.hstack([np.array([pose.translation for pose in poses]), q])
    covariance = np.array([(each + each.T) / 2 for each in told])
    return MeasurementStream("lidar-poses", np.array([pose.time for pose in poses]), values, None, covariance)


def in_frame_of(stream: MeasurementStream, truth: Truth) -> Truth:
    """The truth in the frame g of the scans.

    Nobody but the scans defines that g: it is the transformation that fits all poses best.
    The estimators see nothing of it; NEES has six degrees of freedom less.
    """
    rows = np.searchsorted(truth.time, stream.time)
    rows = np.clip(rows, 0, len(truth.time) - 1)
    if truth.center_of_mass_g is None or np.abs(truth.time[rows] - stream.time).max() > 1e-6:
        return truth
    true, measured = matrix_from_quaternion(truth.q_ig[rows]), matrix_from_quaternion(stream.values[:, 3:])
    place = truth.center_of_mass[rows] - true @ truth.center_of_mass_g
    P = np.broadcast_to(np.eye(6), (len(rows), 6, 6)) if stream.covariance is None else stream.covariance
    turn = _common_rotation(true, measured, P[:, 3:, 3:])
    shift = _common_shift(true, stream.values[:, :3] - place, P[:, :3, :3])
    return replace(truth_in_moved_frame(truth, quaternion_from_matrix(turn), shift), frame_is_fitted=True)


def _common_rotation(
    true: Float[np.ndarray, "n 3 3"], measured: Float[np.ndarray, "n 3 3"], P: Float[np.ndarray, "n 3 3"]
) -> Float[np.ndarray, "3 3"]:
    """Rotation of the scans' g in that of the truth.

    A pose that is wrong has little say (Cauchy).
    """
    weights = 1 / np.trace(P, axis1=1, axis2=2)
    loss, turn = np.ones(len(true)), np.eye(3)
    for _ in range(_STEPS):
        turn = nearest_rotation(np.einsum("n,nji,njk->ik", loss * weights, true, measured))
        apart = np.array([rotation_vector((R @ turn).T @ Q) for R, Q in zip(true, measured, strict=True)])
        loss = 1 / (1 + weights * np.sum(apart**2, axis=1) / LARGE)
    return turn


def _common_shift(
    true: Float[np.ndarray, "n 3 3"], apart: Float[np.ndarray, "n 3"], P: Float[np.ndarray, "n 3 3"]
) -> Float[np.ndarray, "3"]:
    """Origin of the scans' g in that of the truth, m.

    A pose that is wrong has little say (Cauchy).
    """
    W = np.linalg.inv(P)
    loss, shift = np.ones(len(true)), np.zeros(3)
    for _ in range(_STEPS):
        weighted = np.swapaxes(true, 1, 2) @ (loss[:, None, None] * W)
        shift = np.linalg.solve(
            np.sum(weighted @ true, axis=0), np.sum(weighted @ apart[:, :, None], axis=0)[:, 0]
        )
        off = apart - true @ shift
        loss = 1 / (1 + np.einsum("ni,nij,nj->n", off, W, off) / LARGE)
    return shift


SCANS: Final = RawDataReader(KIND, "lidar-poses", read_scans)
SCAN_POINTS: Final = RawDataReader(POINTS_KIND, "lidar-points", read_scan_points)
