"""Points of scans on the faces of a map.

Range and angles with their own stamps, and the covariance that the map leaves them.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.geometry.ray_angles import angles_of
from spinfilters.lidar.face_map import Face, TrackedFaces
from spinfilters.lidar.planes import FittedPlane, rows_of_planes
from spinfilters.lidar.scan_pose import ScanPose
from spinfilters.lidar.scan_poses import ScanPoses

MOST_POINTS: Final = 400
"""Of a scan."""
GRAZING: Final = 0.1
"""Cosine of incidence, at least: below, the range along a beam is not linear in the errors of the face."""


@dataclass(frozen=True, eq=False)
class FacePoints:
    """Points of all scans in the order of these.

    Attributes
    ----------
    time: (n,) epochs of their scans, s.   values: (n, 8) range m, azimuth and elevation rad, delay s, normal and offset (g, m).
    covariance: (n, 3, 3) over (range, azimuth, elevation), m and rad.
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
    InputError: a body without plane faces; no point that is clearly of one face.
    """
    if found.faces is None:
        raise InputError(
            "the body has no plane faces for points to be measured against; use kind = 'lidar-scans'"
        )
    parts = [_of_scan(found, found.faces, k) for k in range(len(found.poses))]
    if not sum(len(part.time) for part in parts):
        raise InputError("no point is clearly of one face; use kind = 'lidar-scans'")
    arrays = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("time", "values", "covariance")
    )
    return FacePoints(*arrays)


def _of_scan(found: ScanPoses, faces: TrackedFaces, number: int) -> FacePoints:
    scan, pose, points = found.scans[number], found.poses[number], found.points(number)
    seen = sorted(set(faces.matches[number]))
    planes = [_plane(faces.faces[k], pose) for k in seen]
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
        covariances.append(_covariance(found, points[rows], pose, k))
    values, covariances = (
        np.concatenate(values or [np.zeros((0, 8))]),
        np.concatenate(covariances or [np.zeros((0, 3, 3))]),
    )
    order = np.argsort(values[:, 3], kind="stable")
    return FacePoints(np.full(len(order), pose.time), values[order], covariances[order])


def _plane(face: Face, pose: ScanPose) -> FittedPlane:
    """A face where a pose puts it."""
    normal = pose.rotation @ face.normal
    place = pose.translation + face.offset * normal
    return FittedPlane(normal, place, pose.rotation @ face.tangents, np.zeros((3, 3)), 0, 1.0)


def _covariance(
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
