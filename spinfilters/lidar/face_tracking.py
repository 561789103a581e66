"""Poses of a body with plane faces.

Faces tracked with the predicted rate, attitude by weighted Wahba, one map of all scans.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment

from spinfilters.lidar.face_adjustment import (
    FEWEST_FOR_DRIFT,
    PlaneEvidence,
    adjusted_faces,
    merged_faces,
    uniform_drift,
    with_map_errors,
)
from spinfilters.lidar.face_consistency import consistent_faces
from spinfilters.lidar.face_map import (
    Face,
    MatchedFace,
    TrackedFaces,
    face_jacobian,
    normal_equations,
    residual_and_jacobian,
)
from spinfilters.lidar.planes import FittedPlane
from spinfilters.lidar.pose_prediction import interpolated_rotation, predicted_pose
from spinfilters.lidar.scan_pose import (
    ScanPose,
    nearest_rotation,
    pose_covariance,
    rotation_matrix,
)

WIDEST_MATCH: Final = np.deg2rad(40.0)
"""Angle between a predicted and a seen normal, at most: faces of a box are 90 deg apart."""
_STEPS, _SWEEPS = 4, 2
_HUGE = 1e6
_RIDGE = 1e-9


def track_faces(
    times: Sequence[float],
    planes: Sequence[Sequence[FittedPlane]],
    middle: Float[np.ndarray, "3"],
    size: float,
) -> TrackedFaces:
    """Poses and faces from the planes of every scan.

    Frame g has the lidar's axes at the first scan and its origin at ``middle``.

    Parameters
    ----------
    size: of the body, m: how far a predicted position may be wrong.
    """
    poses: list[ScanPose] = []
    faces: list[Face] = []
    matches: list[tuple[int, ...]] = []
    for time, seen in zip(times, planes, strict=True):
        R, t = predicted_pose(poses, time, size) if poses else (np.eye(3), middle)
        pairs: list[tuple[int, int]] = []
        for gate in (0.5 * size, 0.15 * size):
            pairs = _matched(seen, faces, R, t, gate)
            R, t = _aligned([MatchedFace(seen[i], faces[j]) for i, j in pairs], R, t, size)
        of_plane = dict(pairs)
        for number, plane in enumerate(seen):
            if number not in of_plane:
                of_plane[number] = len(faces)
                faces.append(_face(plane, R, t))
        matches.append(tuple(of_plane[number] for number in range(len(seen))))
        known = normal_equations([MatchedFace(seen[i], faces[j]) for i, j in pairs], R, t)[0]
        poses.append(ScanPose(time, R, t, pose_covariance(known, R, size)[0]))
    return _adjusted(poses, faces, matches, planes, size)


def _face(plane: FittedPlane, R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]) -> Face:
    return Face(R.T @ plane.normal, float(plane.normal @ (plane.centroid - t)))


def _matched(
    seen: Sequence[FittedPlane],
    faces: Sequence[Face],
    R: Float[np.ndarray, "3 3"],
    t: Float[np.ndarray, "3"],
    gate: float,
) -> list[tuple[int, int]]:
    """Pairs (plane, face) of least total disagreement with a predicted pose."""
    if not seen or not faces:
        return []
    angle = np.array([[np.arccos(np.clip(p.normal @ R @ f.normal, -1, 1)) for f in faces] for p in seen])
    shift = np.array([[abs(p.normal @ (p.centroid - t) - f.offset) for f in faces] for p in seen])
    cost = angle / WIDEST_MATCH + shift / gate
    cost[(angle > WIDEST_MATCH) | (shift > gate)] = _HUGE
    rows, columns = linear_sum_assignment(cost)
    return [(int(i), int(j)) for i, j in zip(rows, columns, strict=True) if cost[i, j] < _HUGE]


def _aligned(
    pairs: Sequence[MatchedFace],
    R: Float[np.ndarray, "3 3"],
    t: Float[np.ndarray, "3"],
    size: float,
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Pose of the matched faces.

    Wahba's attitude first, then Gauss-Newton with the planes' covariances and the predicted pose.
    """
    if len(pairs) >= 2:
        weights = [1 / max(np.trace(p.covariance[:2, :2]), 1e-30) for p, _ in pairs]
        weights = np.array(weights) / max(weights)
        prior = 1e-3 * R  # the predicted attitude decides what fewer than two directions leave open
        M = prior + sum(w * np.outer(p.normal, f.normal) for w, (p, f) in zip(weights, pairs, strict=True))
        R = nearest_rotation(M)
    start, place = R, t
    for _ in range(_STEPS if pairs else 0):
        H, b = normal_equations(pairs, R, t)
        weak = np.repeat([1e-6, 1e-6 / size**2], 3) * np.trace(H) / 6 * 1e-6 + 1e-12
        shift = np.linalg.solve(H + np.diag(weak), b)
        R, t = rotation_matrix(shift[:3]) @ R, t + shift[3:]
        if np.linalg.norm(shift[:3]) < 1e-13:
            break
    return (R, t) if np.isfinite(R).all() and np.isfinite(t).all() else (start, place)


def _adjusted(
    poses: list[ScanPose],
    faces: list[Face],
    matches: list[tuple[int, ...]],
    planes: Sequence[Sequence[FittedPlane]],
    size: float,
) -> TrackedFaces:
    """All poses and faces, adjusted by turns.

    Each face from all scans that see it, each pose from all faces that it sees.
    """
    for sweep in range(2 * _SWEEPS):
        faces = [_refitted(k, face, poses, matches, planes) for k, face in enumerate(faces)]
        if sweep >= _SWEEPS and len(poses) >= FEWEST_FOR_DRIFT:
            faces, poses = _drifting(faces, poses, matches, planes)
        poses = [
            _posed(pose, faces, m, seen, size) for pose, m, seen in zip(poses, matches, planes, strict=True)
        ]
    tracked = adjusted_faces(
        TrackedFaces(tuple(poses), tuple(faces), tuple(matches)), PlaneEvidence(planes), size
    )
    merged = merged_faces(tracked, size)
    if len(merged.faces) < len(tracked.faces):
        tracked = adjusted_faces(merged, PlaneEvidence(planes), size)
    found = consistent_faces(_all_posed(tracked, planes, size), planes, size)
    tracked, planes = adjusted_faces(found.tracked, PlaneEvidence(found.planes), size), found.planes
    tracked = _all_posed(_led_by_neighbours(_all_posed(tracked, planes, size), size), planes, size)
    tracked = with_map_errors(tracked, PlaneEvidence(planes), size)
    return replace(tracked, contradicted=found.contradicted)


def _led_by_neighbours(tracked: TrackedFaces, size: float) -> TrackedFaces:
    """Scans that do not determine their pose begin from where those before and after lead."""
    drift, poses = uniform_drift(tracked, size), list(tracked.poses)
    for k, pose in enumerate(tracked.poses):
        if pose.undetermined:
            place = drift.place(k) if np.isfinite(drift.scatter) else pose.translation
            poses[k] = replace(pose, rotation=interpolated_rotation(tracked.poses, k), translation=place)
    return replace(tracked, poses=tuple(poses))


def _all_posed(tracked: TrackedFaces, planes: Sequence[Sequence[FittedPlane]], size: float) -> TrackedFaces:
    """Every pose from the faces that its scan sees."""
    faces = list(tracked.faces)
    poses = [
        _posed(pose, faces, m, seen, size)
        for pose, m, seen in zip(tracked.poses, tracked.matches, planes, strict=True)
    ]
    return replace(tracked, poses=tuple(poses))


def _drifting(
    faces: list[Face],
    poses: list[ScanPose],
    matches: list[tuple[int, ...]],
    planes: Sequence[Sequence[FittedPlane]],
) -> tuple[list[Face], list[ScanPose]]:
    """Face offsets and poses under a uniform drift of the origin of g.

    The drift makes that origin the centre of rotation.
    Planes alone do not tell how far apart faces are that no scan sees together. With attitudes given, n.(r + v time) + d = n.c of
    every plane is linear in r, v and the offsets d.
    """
    start, rows, values = poses[0].time, [], []
    span = poses[-1].time - start
    for pose, match, seen in zip(poses, matches, planes, strict=True):
        for plane, k in zip(seen, match, strict=True):
            n, row = pose.rotation @ faces[k].normal, np.zeros(6 + len(faces))
            row[:3], row[3:6], row[6 + k] = n, n * (pose.time - start) / span, 1.0
            rows.append(row)
            values.append(n @ plane.centroid)
    A, b = np.array(rows), np.array(values)
    before = np.array(
        [*poses[0].translation, *(poses[-1].translation - poses[0].translation), *(f.offset for f in faces)]
    )
    residual, step = b - A @ before, np.zeros(len(before))
    for _ in range(_STEPS):
        scatter = 1.4826 * float(np.median(np.abs(residual - A @ step))) + 1e-12
        weights = 1 / (1 + ((residual - A @ step) / (3 * scatter)) ** 2)
        H = (A * weights[:, None]).T @ A
        step = np.linalg.solve(H + _RIDGE * np.trace(H) / len(H) * np.eye(len(H)), A.T @ (weights * residual))
    x = before + step
    moved = [replace(pose, translation=x[:3] + x[3:6] * (pose.time - start) / span) for pose in poses]
    return [Face(face.normal, float(offset)) for face, offset in zip(faces, x[6:], strict=True)], moved


def _posed(
    pose: ScanPose, faces: list[Face], match: tuple[int, ...], seen: Sequence[FittedPlane], size: float
) -> ScanPose:
    pairs = [MatchedFace(plane, faces[k]) for plane, k in zip(seen, match, strict=True)]
    R, t = (
        _aligned(pairs, pose.rotation, pose.translation, size) if pairs else (pose.rotation, pose.translation)
    )
    covariance, lacking = pose_covariance(normal_equations(pairs, R, t)[0], R, size)
    return ScanPose(pose.time, R, t, covariance, lacking, len(pairs))


def _refitted(
    number: int,
    face: Face,
    poses: list[ScanPose],
    matches: list[tuple[int, ...]],
    planes: Sequence[Sequence[FittedPlane]],
) -> Face:
    """A face from every scan that sees it: three numbers, linear about the present ones."""
    H, b = 1e-12 * np.eye(3), np.zeros(3)
    for pose, match, seen in zip(poses, matches, planes, strict=True):
        for plane, k in zip(seen, match, strict=True):
            if k != number:
                continue
            residual, _ = residual_and_jacobian(plane, face, pose.rotation, pose.translation)
            J = face_jacobian(plane, face, pose.rotation, pose.translation)
            W = np.linalg.inv(plane.covariance)
            H += J.T @ W @ J
            b -= J.T @ W @ residual
    step = np.linalg.solve(H, b)
    normal = face.normal + face.tangents @ step[:2]
    return Face(normal / np.linalg.norm(normal), face.offset + float(step[2]))
