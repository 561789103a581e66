"""Poses of a body from stereo tracks, with a known map or with a map built on the way."""

from itertools import pairwise

import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.geometry.triangulation import triangulate
from spinfilters.logs.measurement_log import MeasurementStream
from spinfilters.logs.track_files import KnownMap
from spinfilters.perception.pose_fit import FittedPose, fit_pose

PASSES = 3
"""Rounds of poses from the map and map from the poses, when no map is given."""


def poses_with_map(
    tracks: MeasurementStream, known: KnownMap, calibration: Float[np.ndarray, " 5"], pixel_std: float
) -> MeasurementStream:
    """One pose per frame that sees at least four landmarks of the map.

    Raises
    ------
    InputError: when no frame does.
    """
    times, poses, covariances = [], [], []
    for time, rows in _frames(tracks):
        fitted = _fit_frame(tracks, rows, known, calibration, pixel_std)
        if fitted is not None:
            times.append(time)
            poses.append(fitted.pose)
            covariances.append(fitted.covariance)
    if not times:
        raise InputError("no frame of tracks.csv sees four landmarks of the map; check landmark ids and the calibration")
    return MeasurementStream("pose", np.array(times), np.array(poses), None, np.array(covariances))


def poses_without_map(
    tracks: MeasurementStream, calibration: Float[np.ndarray, " 5"], pixel_std: float
) -> tuple[MeasurementStream, KnownMap]:
    """Poses and a map from tracks alone; frame g stands at the centroid of the first frame's points, axes along i.

    A first sweep through time poses each frame against the landmarks seen before and adds its new ones; further rounds fit the
    points to all their sightings and the poses to the points. The covariances hold for a perfect map, so they are scaled by what
    the pixels' residuals say; slow drift between far-apart frames is not in them.
    """
    frames = _frames(tracks)
    points = _sweep(tracks, frames, calibration, pixel_std)
    stream = poses_with_map(tracks, points, calibration, pixel_std)
    for _ in range(PASSES):
        points = _points_from_poses(tracks, frames, stream, calibration)
        stream = poses_with_map(tracks, points, calibration, pixel_std)
    return stream, points


def _frames(tracks: MeasurementStream) -> list[tuple[float, slice]]:
    """Each time stamp and the rows that carry it."""
    offsets = tracks.frame_offsets.tolist()
    return [(float(tracks.time[a]), slice(a, b)) for a, b in pairwise(offsets)]


def _fit_frame(
    tracks: MeasurementStream, rows: slice, known: KnownMap, calibration: np.ndarray, pixel_std: float
) -> FittedPose | None:
    assert tracks.ids is not None
    ids = tracks.ids[rows]
    index = np.clip(np.searchsorted(known.ids, ids), 0, len(known.ids) - 1)
    found = known.ids[index] == ids
    return fit_pose(known.points[index[found]], tracks.values[rows][found], calibration, pixel_std)


def _sweep(
    tracks: MeasurementStream, frames: list[tuple[float, slice]], calibration: np.ndarray, pixel_std: float
) -> KnownMap:
    assert tracks.ids is not None
    seen: dict[int, np.ndarray] = {}
    for index, (_, rows) in enumerate(frames):
        camera = triangulate(tracks.values[rows], calibration)
        good = np.isfinite(camera).all(axis=1) & (camera[:, 2] > 0)
        if index == 0:
            pose = np.concatenate([np.median(camera[good], axis=0), [0.0, 0.0, 0.0, 1.0]])
        else:
            fitted = _fit_frame(tracks, rows, _as_map(seen), calibration, pixel_std)
            if fitted is None:
                continue
            pose = fitted.pose
        body = _to_body(pose, camera)
        for landmark, point in zip(tracks.ids[rows][good].tolist(), body[good], strict=True):
            seen.setdefault(landmark, point)
    if len(seen) < 4:
        raise InputError(f"tracks.csv shows {len(seen)} landmarks in its first frames; at least 4 are needed for a pose")
    return _as_map(seen)


def _points_from_poses(
    tracks: MeasurementStream,
    frames: list[tuple[float, slice]],
    poses: MeasurementStream,
    calibration: np.ndarray,
) -> KnownMap:
    """Each landmark as the information-weighted mean of its triangulations: a sighting is poor along its line of sight."""
    assert tracks.ids is not None
    pose_at = dict(zip(poses.time.tolist(), poses.values, strict=True))
    ids = np.unique(tracks.ids)
    information, weighted = np.zeros((len(ids), 3, 3)), np.zeros((len(ids), 3))
    for time, rows in frames:
        if time not in pose_at:
            continue
        camera = triangulate(tracks.values[rows], calibration)
        good = np.isfinite(camera).all(axis=1) & (camera[:, 2] > 0)
        pose = pose_at[time]
        R = _matrix(pose[3:])
        W = R.T @ _point_information(camera[good], calibration) @ R
        where = np.searchsorted(ids, tracks.ids[rows][good])
        np.add.at(information, where, W)
        np.add.at(weighted, where, (W @ _to_body(pose, camera[good])[..., None])[..., 0])
    known = np.linalg.det(information) > 0
    return KnownMap(ids[known], np.linalg.solve(information[known], weighted[known][..., None])[..., 0])


def _point_information(camera: Float[np.ndarray, "k 3"], calibration: np.ndarray) -> Float[np.ndarray, "k 3 3"]:
    """Information of a triangulated point (per px^2) in the camera frame: J'J of (u_left, v_left, u_right)."""
    fx, fy, _, _, baseline = calibration
    x, y, z = camera.T
    J = np.zeros((len(camera), 3, 3))
    J[:, 0, 0] = J[:, 2, 0] = fx / z
    J[:, 1, 1] = fy / z
    J[:, 0, 2], J[:, 1, 2], J[:, 2, 2] = -fx * x / z**2, -fy * y / z**2, -fx * (x - baseline) / z**2
    return np.swapaxes(J, 1, 2) @ J


def _matrix(q: Float[np.ndarray, " 4"]) -> Float[np.ndarray, "3 3"]:
    return np.stack([_rotate(q, axis) for axis in np.eye(3)], axis=1)


def _rotate(q: Float[np.ndarray, " 4"], v: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    u = 2 * np.cross(q[:3], v)
    return v + q[3] * u + np.cross(q[:3], u)


def _to_body(pose: Float[np.ndarray, " 7"], camera: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3"]:
    return (camera - pose[:3]) @ _matrix(pose[3:])


def _as_map(points: dict[int, np.ndarray]) -> KnownMap:
    ids = np.array(sorted(points), dtype=np.int64)
    return KnownMap(ids, np.array([points[i] for i in ids.tolist()]).reshape(-1, 3))
