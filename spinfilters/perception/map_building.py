"""Poses and a map from stereo tracks alone, by turns: a frame's pose from the map so far, its sightings into the map."""

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.attitude.conversions import matrix_from_quaternion
from spinfilters.errors import InputError
from spinfilters.geometry.cameras import stereo_pair
from spinfilters.logs.measurement_log import MeasurementStream
from spinfilters.logs.track_files import KnownMap
from spinfilters.models.sensor_noise import NoiseLevel, noise_of_rows
from spinfilters.perception.map_in_progress import MapInProgress
from spinfilters.perception.matches import Matches
from spinfilters.perception.pose_fit import FittedPose, fit_pose, fit_poses
from spinfilters.perception.track_poses import find_landmarks, pose_stream, track_frames

PASSES = 4
"""Rounds over all frames after the first sweep, each with a better map."""
SMALLEST_DISPARITY_PX = 0.1
"""Below it a point is at infinity: its information has no third direction that numbers could hold."""


def poses_without_map(
    tracks: MeasurementStream,
    calibration: Float[np.ndarray, " c"],
    noise: NoiseLevel,
    frames: int | None = None,
) -> tuple[MeasurementStream, KnownMap]:
    """Poses and a map from tracks alone; frame g stands at the median of the first frame's points, axes along the camera.

    A pose is weighted by pixel noise and by how well each point is known. Errors common to many frames (slow drift of the map)
    are not in the poses' covariances; filters that hold the landmarks in their state do not have that weakness.

    Wrong associations are outvoted: a pose is what most matches of its frame agree on, a landmark what most of its sightings do.

    Parameters
    ----------
    noise: of the tracks: a standard deviation (px), or the covariance of every row (px^2).
    frames: how many of the first frames to look at; all when None.

    Raises
    ------
    InputError: when fewer than four landmarks are seen at first, or no frame can be fitted.
    """
    assert tracks.ids is not None
    chosen = track_frames(tracks)[:frames]
    ids = np.unique(tracks.ids[: chosen[-1][1].stop])
    building, fits = MapInProgress.empty(ids), {}
    for time, rows in chosen:
        fits[time] = (
            fit_pose(_matches(tracks, rows, building, noise), calibration)
            if fits
            else _first(tracks, rows, calibration)
        )
        _add_sightings(tracks, rows, fits[time], building, calibration, noise)
    for _ in range(PASSES):
        complete, building = building, MapInProgress.empty(ids)
        found = fit_poses([_matches(tracks, rows, complete, noise) for _, rows in chosen], calibration)
        for (time, rows), fitted in zip(chosen, found, strict=True):
            fits[time] = fitted
            _add_sightings(tracks, rows, fitted, building, calibration, noise)
    seen = np.flatnonzero(building.seen)
    return pose_stream(fits), KnownMap(ids[seen], building.points(seen)[0])


def _first(tracks: MeasurementStream, rows: slice, calibration: np.ndarray) -> FittedPose:
    """The pose that defines g: it is exact."""
    camera, good = _triangulated(tracks, rows, calibration)
    if np.count_nonzero(good) < 4:
        raise InputError(
            f"the first frame of the tracks shows {np.count_nonzero(good)} usable landmarks; at least 4 are needed"
        )
    pose = np.concatenate([np.median(camera[good], axis=0), [0.0, 0.0, 0.0, 1.0]])
    return FittedPose(pose, np.eye(6) * 1e-12, good)


def _matches(tracks: MeasurementStream, rows: slice, known: MapInProgress, noise: NoiseLevel) -> Matches:
    """Those of a frame with a map of which each point has its covariance."""
    assert tracks.ids is not None
    index, _ = find_landmarks(known.ids, tracks.ids[rows])
    found = known.seen[index]
    points, covariance = known.points(index[found])
    own = noise_of_rows(noise_of_rows(noise, rows), found)
    return Matches(points, tracks.values[rows][found], own, covariance)


def _add_sightings(
    tracks: MeasurementStream,
    rows: slice,
    fitted: FittedPose | None,
    building: MapInProgress,
    calibration: np.ndarray,
    noise: NoiseLevel,
) -> None:
    if fitted is None:
        return
    assert tracks.ids is not None
    camera, good = _triangulated(tracks, rows, calibration)
    R = matrix_from_quaternion(fitted.pose[3:])
    own = noise_of_rows(noise_of_rows(noise, rows), good)
    information = R.T @ _point_information(camera[good], calibration, own) @ R
    where, _ = find_landmarks(building.ids, tracks.ids[rows][good])
    building.add(where, information, (camera[good] - fitted.pose[:3]) @ R)


def _triangulated(
    tracks: MeasurementStream, rows: slice, calibration: np.ndarray
) -> tuple[Float[np.ndarray, "k 3"], Bool[np.ndarray, " k"]]:
    pixels = tracks.values[rows]
    camera = stereo_pair(calibration).points_of(pixels, calibration)
    focal_length, baseline, depth = calibration[0], calibration[4], camera[:, 2]
    near = (depth > 0) & (focal_length * baseline > SMALLEST_DISPARITY_PX * depth)
    return camera, near & np.isfinite(camera).all(axis=1)


def _point_information(
    camera: Float[np.ndarray, "k 3"], calibration: np.ndarray, noise: NoiseLevel
) -> Float[np.ndarray, "k 3 3"]:
    """Information of a triangulated point, camera frame: J' N^-1 J of (u_left, v_left, u_right) with noise N."""
    J = stereo_pair(calibration).pixels_by_point(camera, calibration)
    roots = noise if isinstance(noise, float | int) else np.linalg.cholesky(noise)
    whitened = J / roots if isinstance(roots, float | int) else np.linalg.solve(roots, J)
    return np.swapaxes(whitened, 1, 2) @ whitened
