"""Measurements of a folder of scans: registered into poses with covariance, or points on the faces of the body."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.absolute_orientation import mean_quaternion, nearest_rotation
from spinfilters.core.attitude_conversions import (
    angle_between,
    continuous_quaternions,
    inverse,
    matrix_from_quaternion,
    multiply,
    quaternion_from_matrix,
)
from spinfilters.core.errors import InputError
from spinfilters.core.ray_angles import angles_of
from spinfilters.io.dataset import DATASET_FILE
from spinfilters.io.dataset_reader import RawDataReader, RawMeasurements
from spinfilters.io.input_file import path_text
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.truth import Truth, truth_in_moved_frame
from spinfilters.lidar.face_map import LARGE, Face, TrackedFaces
from spinfilters.lidar.planes import FittedPlane, rows_of_planes
from spinfilters.lidar.scan import Scan, read_scan
from spinfilters.lidar.scan_pose import ScanPose
from spinfilters.lidar.scan_poses import ScanPoses, scan_poses

MOST_POINTS: Final = 400
"""Of a scan."""
GRAZING: Final = 0.1
"""Cosine of incidence, at least: below, the range along a beam is not linear in the errors of the face."""


@dataclass(frozen=True, eq=False)
class FacePoints:
    """Points of all scans in the order of these.

    Attributes
    ----------
    time : ndarray of shape (n,)
        Epochs of their scans, s.
    values : ndarray of shape (n, 8)
        Range m, azimuth and elevation rad, delay s, normal and offset (g, m).
    covariance : ndarray of shape (n, 3, 3)
        Over (range, azimuth, elevation), m and rad.
    """

    time: Float[np.ndarray, " n"]
    values: Float[np.ndarray, "n 8"]
    covariance: Float[np.ndarray, "n 3 3"]


def face_points(found: ScanPoses) -> FacePoints:
    """Points clearly of one face, not at its border.

    A scan has at most `MOST_POINTS`. A face's error is common to all of its points: those of a scan carry it so often in
    their ranges that their mean has it once.

    Raises
    ------
    InputError
        a body without plane faces; no point that is clearly of one face.
    """
    if found.faces is None:
        raise InputError(
            "the body has no plane faces for points to be measured against, or some behind others; use kind = 'lidar-scans'"
        )
    parts = [_face_points_of_scan(found, found.faces, k) for k in range(len(found.poses))]
    if not sum(len(part.time) for part in parts):
        raise InputError("no point is clearly of one face; use kind = 'lidar-scans'")
    arrays = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("time", "values", "covariance")
    )
    return FacePoints(*arrays)


def _face_points_of_scan(found: ScanPoses, faces: TrackedFaces, number: int) -> FacePoints:
    scan, pose, points = found.scans[number], found.poses[number], found.points(number)
    seen = sorted(set(faces.matches[number]))
    planes = [_place_face(faces.faces[k], pose) for k in seen]
    rows_of = rows_of_planes(points, np.stack(angles_of(points), axis=1), planes, found.noise)
    rows_of = [
        rows[_incidence(points[rows], each.normal) < -GRAZING]
        for rows, each in zip(rows_of, planes, strict=True)
    ]
    every = max(1.0, sum(map(len, rows_of)) / MOST_POINTS)
    rows_of = [rows[np.arange(0, len(rows), every).astype(int)] for rows in rows_of]
    returns = np.flatnonzero(scan.is_return)
    values, covariances = [], []
    for k, rows in zip(seen, rows_of, strict=True):
        face, ray = faces.faces[k], returns[rows]
        angles = np.column_stack([scan.azimuth[ray], scan.elevation[ray]])
        plane = np.tile([*face.normal, face.offset], (len(ray), 1))
        values.append(np.column_stack([scan.distance[ray], angles, scan.time[ray] - pose.time, plane]))
        covariances.append(_range_covariance(found, points[rows], pose, k))
    values, covariances = (
        np.concatenate(values or [np.zeros((0, 8))]),
        np.concatenate(covariances or [np.zeros((0, 3, 3))]),
    )
    order = np.argsort(values[:, 3], kind="stable")
    return FacePoints(np.full(len(order), pose.time), values[order], covariances[order])


def _place_face(face: Face, pose: ScanPose) -> FittedPlane:
    """A face where a pose puts it."""
    normal = pose.rotation @ face.normal
    place = pose.translation + face.offset * normal
    return FittedPlane(normal, place, pose.rotation @ face.tangents, np.zeros((3, 3)), 0, 1.0)


def _range_covariance(
    found: ScanPoses, points: Float[np.ndarray, "n 3"], pose: ScanPose, number: int
) -> Float[np.ndarray, "n 3 3"]:
    """Covariance of the noise and of the map's error in the range.

    The error of face ``number`` counts once for each of these points.
    """
    assert found.faces is not None
    face, M = (
        found.faces.faces[number],
        found.faces.covariance[3 * number : 3 * number + 3, 3 * number : 3 * number + 3],
    )
    in_g = (points - pose.translation) @ pose.rotation
    along = np.column_stack([in_g @ face.tangents, -np.ones(len(points))])
    incidence = _incidence(points, pose.rotation @ face.normal)
    common = np.einsum("ni,ij,nj->n", along, M, along) * len(points) / incidence**2
    noise = found.noise
    covariance = np.tile(
        np.diag([noise.range_std, noise.azimuth_std, noise.elevation_std]) ** 2, (len(points), 1, 1)
    )
    covariance += np.diag([1e-12, 1e-18, 1e-18])  # of scans without noise
    covariance[:, 0, 0] += common
    return covariance


def _incidence(points: Float[np.ndarray, "n 3"], normal: Float[np.ndarray, "3"]) -> Float[np.ndarray, " n"]:
    """Cosine between beams and a normal."""
    return points @ normal / np.linalg.norm(points, axis=1)


KIND: Final = "lidar-scans"
"""Kind of a data set that holds scans, of which the poses are measurements."""
POINTS_KIND: Final = "lidar-scan-points"
"""Kind of a data set that holds scans, of which the points are measurements."""
SCAN_FOLDER: Final = "scans"
_STEPS = 8


def read_scans(folder: Path, truth: Truth | None) -> RawMeasurements:
    """Poses of the scans in ``scans/*.ply`` in time order, and the truth in their frame g.

    Raises
    ------
    InputError
        No scan, one that cannot be read, stamps that do not rise with the names, fewer than two that see the
        body.
    """
    found = registered_scans(folder)
    stream = pose_stream(found)
    moved = None if truth is None else in_frame_of(stream, truth)
    return RawMeasurements(stream, moved, found.remarks, found.doubts, found.inflation)


def read_scan_points(folder: Path, truth: Truth | None) -> RawMeasurements:
    """Points of the scans in ``scans/*.ply``, the truth in the frame g of their faces.

    Raises
    ------
    InputError
        As `read_scans`; a body without plane faces.
    """
    found = registered_scans(folder)
    try:
        points = face_points(found)
    except InputError as error:
        raise InputError(f"{path_text(folder)}: {error}") from None
    stream = MeasurementStream("lidar-points", points.time, points.values, None, points.covariance)
    moved = None if truth is None else in_frame_of(pose_stream(found), truth)
    return RawMeasurements(stream, moved, found.remarks, found.doubts)


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
    blocks = [
        pose.covariance if pose.own_covariance is None else found.inflation * pose.own_covariance
        for pose in poses
    ]
    q = continuous_quaternions(
        quaternion_from_matrix(np.array([nearest_rotation(pose.rotation) for pose in poses]))
    )
    values = np.hstack([np.array([pose.translation for pose in poses]), q])
    covariance = np.array([(each + each.T) / 2 for each in blocks])
    return MeasurementStream("lidar-poses", np.array([pose.time for pose in poses]), values, None, covariance)


def in_frame_of(stream: MeasurementStream, truth: Truth) -> Truth:
    """The truth in the frame g of the scans.

    Only the scans define that g: it is the transformation that fits all poses best.
    The estimators see nothing of it; NEES has six degrees of freedom less.
    """
    rows = np.searchsorted(truth.time, stream.time)
    rows = np.clip(rows, 0, len(truth.time) - 1)
    if truth.center_of_mass_g is None or np.abs(truth.time[rows] - stream.time).max() > 1e-6:
        return truth
    true = matrix_from_quaternion(truth.q_ig[rows])
    place = truth.center_of_mass[rows] - true @ truth.center_of_mass_g
    P = np.broadcast_to(np.eye(6), (len(rows), 6, 6)) if stream.covariance is None else stream.covariance
    turn = _common_rotation(truth.q_ig[rows], stream.values[:, 3:], P[:, 3:, 3:])
    shift = _common_shift(true, stream.values[:, :3] - place, P[:, :3, :3])
    return replace(truth_in_moved_frame(truth, turn, shift), frame_is_fitted=True)


def _common_rotation(
    true: Float[np.ndarray, "n 4"], measured: Float[np.ndarray, "n 4"], P: Float[np.ndarray, "n 3 3"]
) -> Float[np.ndarray, " 4"]:
    """Rotation of the scans' g in that of the truth; outlying poses have little weight (Cauchy loss)."""
    weights, differences = 1 / np.trace(P, axis1=1, axis2=2), multiply(inverse(true), measured)
    loss, common = np.ones(len(true)), differences[0]
    for _ in range(_STEPS):
        common = mean_quaternion(differences, loss * weights)
        loss = 1 / (1 + weights * angle_between(differences, common) ** 2 / LARGE)
    return common


def _common_shift(
    true: Float[np.ndarray, "n 3 3"], apart: Float[np.ndarray, "n 3"], P: Float[np.ndarray, "n 3 3"]
) -> Float[np.ndarray, "3"]:
    """Origin of the scans' g in that of the truth, m; outlying poses have little weight (Cauchy loss)."""
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
