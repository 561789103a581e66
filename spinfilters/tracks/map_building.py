"""Poses and a map from stereo tracks alone, in alternation.

An epoch's pose from the map so far, its observations into the map.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.attitude.conversions import matrix_from_quaternion
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.data.track_files import KnownMap
from spinfilters.errors import InputError
from spinfilters.geometry.cameras import stereo_pair
from spinfilters.models.sensor_noise import NoiseLevel, noise_of_rows
from spinfilters.tracks.map_in_progress import MapInProgress
from spinfilters.tracks.matches import Matches
from spinfilters.tracks.pixel_noise import StereoView, noise_ratio
from spinfilters.tracks.pose_fit import FittedPose, fit_pose, fit_poses
from spinfilters.tracks.track_poses import find_landmarks, pose_stream, track_epochs

PASSES = 2
"""Rounds over all epochs after the first sweep, each with a better map: one closes a revolution, the other settles."""
SMALLEST_DISPARITY_PX = 0.1
"""Below it a point is at infinity: its information has no third direction that numbers could hold."""


class FoundMap(NamedTuple):
    """Poses, their map, and the pixel noise over the stated.

    None where nothing tells it.
    """

    poses: MeasurementStream
    landmarks: KnownMap
    noise_ratio: float | None


def poses_without_map(
    tracks: MeasurementStream,
    calibration: Float[np.ndarray, " c"],
    noise: NoiseLevel,
    epochs: int | None = None,
) -> FoundMap:
    """Poses and a map from tracks alone.

    Frame g stands at the median of the first epoch's points, axes along the camera.
    A pose is weighted by pixel noise and by how well each point is known. Errors common to many epochs (slow drift of the map)
    are not in the poses' covariances; filters that hold the landmarks in their state do not have that weakness.

    Wrong associations are outvoted: a pose is what most matches of its epoch agree on, a landmark what most of its observations do.

    Parameters
    ----------
    noise: of the tracks: a standard deviation (px), or the covariance of every row (px^2).
    epochs: how many of the first epochs to look at; all when None.

    Raises
    ------
    InputError: when fewer than four landmarks are seen at first, or no epoch can be fitted.
    """
    assert tracks.ids is not None
    chosen = track_epochs(tracks)[:epochs]
    ids = np.unique(tracks.ids[: chosen[-1][1].stop])
    views = [_view(tracks, rows, calibration, noise) for _, rows in chosen]
    building = MapInProgress.empty(ids)
    poses: list[Float[np.ndarray, " 7"] | None] = [_first(views[0])]
    for view, (_, rows) in zip(views, chosen[1:], strict=False):
        _add(building, view, poses[-1])
        fitted = fit_pose(_matches(tracks, rows, building, noise), calibration)
        poses.append(None if fitted is None else fitted.pose)
    fits: list[FittedPose | None] = []
    for _ in range(PASSES):
        building = _built(views, poses, ids)
        fits = fit_poses([_matches(tracks, rows, building, noise) for _, rows in chosen], calibration)
        poses = [None if fitted is None else fitted.pose for fitted in fits]
    agreed = [
        view.only(_agreed_ids(tracks, rows, building, fitted))
        for view, (_, rows), fitted in zip(views, chosen, fits, strict=True)
    ]
    building = _built(views, poses, ids)
    seen = np.flatnonzero(building.seen)
    known = KnownMap(ids[seen], building.points(seen)[0])
    by_time = {time: fitted for (time, _), fitted in zip(chosen, fits, strict=True)}
    return FoundMap(pose_stream(by_time), known, noise_ratio(agreed, calibration))


def _agreed_ids(
    tracks: MeasurementStream, rows: slice, building: MapInProgress, fitted: FittedPose | None
) -> Int[np.ndarray, " a"]:
    """Landmarks whose observations at an epoch agree with its pose and the map."""
    assert tracks.ids is not None
    index, _ = find_landmarks(building.ids, tracks.ids[rows])
    ids = tracks.ids[rows][building.seen[index]]
    return ids[:0] if fitted is None else ids[fitted.inliers]


def _first(view: StereoView) -> Float[np.ndarray, " 7"]:
    """The pose that defines g."""
    if len(view.ids) < 4:
        raise InputError(
            f"the first epoch of the tracks shows {len(view.ids)} usable landmarks; at least 4 are needed"
        )
    return np.concatenate([np.median(view.camera, axis=0), [0.0, 0.0, 0.0, 1.0]])


def _matches(tracks: MeasurementStream, rows: slice, known: MapInProgress, noise: NoiseLevel) -> Matches:
    """Those of an epoch with a map of which each point has its covariance."""
    assert tracks.ids is not None
    index, _ = find_landmarks(known.ids, tracks.ids[rows])
    found = known.seen[index]
    points, covariance = known.points(index[found])
    own = noise_of_rows(noise_of_rows(noise, rows), found)
    return Matches(points, tracks.values[rows][found], own, covariance)


def _view(
    tracks: MeasurementStream, rows: slice, calibration: Float[np.ndarray, " c"], noise: NoiseLevel
) -> StereoView:
    """What one epoch shows, as far as it can be triangulated."""
    assert tracks.ids is not None
    camera, good = _triangulated(tracks, rows, calibration)
    own = noise_of_rows(noise_of_rows(noise, rows), good)
    information = _point_information(camera[good], calibration, own)
    return StereoView(tracks.ids[rows][good], camera[good], information, tracks.values[rows][good], own)


def _built(
    views: Sequence[StereoView], poses: Sequence[Float[np.ndarray, " 7"] | None], ids: Int[np.ndarray, " n"]
) -> MapInProgress:
    """The map of all views that have a pose."""
    building = MapInProgress.empty(ids)
    for view, pose in zip(views, poses, strict=True):
        _add(building, view, pose)
    return building


def _add(building: MapInProgress, view: StereoView, pose: Float[np.ndarray, " 7"] | None) -> None:
    if pose is None:
        return
    R = matrix_from_quaternion(pose[3:])
    where, _ = find_landmarks(building.ids, view.ids)
    building.add(where, R.T @ view.information @ R, (view.camera - pose[:3]) @ R)


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
    """Information J' N^-1 J of (u_left, v_left, u_right) on a triangulated point, camera frame."""
    J = stereo_pair(calibration).pixels_by_point(camera, calibration)
    whitened = np.linalg.solve(np.linalg.cholesky(noise), J) if np.ndim(noise) else J / noise
    return np.swapaxes(whitened, 1, 2) @ whitened
