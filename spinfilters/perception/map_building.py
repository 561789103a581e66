"""Poses and a map from stereo tracks alone, by turns: a frame's pose from the map so far, its sightings into the map."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.attitude.conversions import matrix_from_quaternion
from spinfilters.errors import InputError
from spinfilters.geometry.triangulation import triangulate
from spinfilters.logs.measurement_log import MeasurementStream
from spinfilters.logs.track_files import KnownMap
from spinfilters.perception.pose_fit import FittedPose, fit_pose
from spinfilters.perception.track_poses import find_landmarks, pose_stream, track_frames

PASSES = 4
"""Rounds over all frames after the first sweep, each with a better map."""


@dataclass
class _MapInProgress:
    """Sums of information of every landmark: its point is the information-weighted mean of its sightings.

    A sighting is poor along its line of sight, so points seen from several sides are far better than any one sighting.
    """

    ids: Int[np.ndarray, " n"]
    information: Float[np.ndarray, "n 3 3"]
    weighted: Float[np.ndarray, "n 3"]

    @classmethod
    def empty(cls, ids: Int[np.ndarray, " n"]) -> "_MapInProgress":
        return cls(ids, np.zeros((len(ids), 3, 3)), np.zeros((len(ids), 3)))

    @property
    def seen(self) -> Bool[np.ndarray, " n"]:
        return self.information[:, 0, 0] > 0

    def add(
        self, where: np.ndarray, information: Float[np.ndarray, "k 3 3"], points: Float[np.ndarray, "k 3"]
    ) -> None:
        np.add.at(self.information, where, information)
        np.add.at(self.weighted, where, (information @ points[..., None])[..., 0])

    def points(self, where: np.ndarray) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3 3"]]:
        covariance = np.linalg.inv(self.information[where])
        return (covariance @ self.weighted[where][..., None])[..., 0], covariance


def poses_without_map(
    tracks: MeasurementStream, calibration: Float[np.ndarray, " 5"], pixel_std: float
) -> tuple[MeasurementStream, KnownMap]:
    """Poses and a map from tracks alone; frame g stands at the median of the first frame's points, axes along i.

    A pose is weighted by pixel noise and by how well each point is known. Errors common to many frames (slow drift of the map)
    are not in the poses' covariances; filters that hold the landmarks in their state do not have that weakness.

    Raises
    ------
    InputError: when fewer than four landmarks are seen at first, or no frame can be fitted.
    """
    assert tracks.ids is not None
    ids = np.unique(tracks.ids)
    frames = track_frames(tracks)
    building, fits = _MapInProgress.empty(ids), {}
    for time, rows in frames:
        fits[time] = (
            _pose(tracks, rows, building, calibration, pixel_std)
            if fits
            else _first(tracks, rows, calibration)
        )
        _add_sightings(tracks, rows, fits[time], building, calibration, pixel_std)
    for _ in range(PASSES):
        complete, building = building, _MapInProgress.empty(ids)
        for time, rows in frames:
            fits[time] = _pose(tracks, rows, complete, calibration, pixel_std)
            _add_sightings(tracks, rows, fits[time], building, calibration, pixel_std)
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


def _pose(
    tracks: MeasurementStream, rows: slice, known: _MapInProgress, calibration: np.ndarray, pixel_std: float
) -> FittedPose | None:
    assert tracks.ids is not None
    index, _ = find_landmarks(known.ids, tracks.ids[rows])
    found = known.seen[index]
    if np.count_nonzero(found) < 4:
        return None
    points, covariance = known.points(index[found])
    return fit_pose(points, tracks.values[rows][found], calibration, pixel_std, covariance)


def _add_sightings(
    tracks: MeasurementStream,
    rows: slice,
    fitted: FittedPose | None,
    building: _MapInProgress,
    calibration: np.ndarray,
    pixel_std: float,
) -> None:
    if fitted is None:
        return
    assert tracks.ids is not None
    camera, good = _triangulated(tracks, rows, calibration)
    R = matrix_from_quaternion(fitted.pose[3:])
    information = R.T @ _point_information(camera[good], calibration) @ R / pixel_std**2
    where, _ = find_landmarks(building.ids, tracks.ids[rows][good])
    building.add(where, information, (camera[good] - fitted.pose[:3]) @ R)


def _triangulated(
    tracks: MeasurementStream, rows: slice, calibration: np.ndarray
) -> tuple[Float[np.ndarray, "k 3"], Bool[np.ndarray, " k"]]:
    camera = triangulate(tracks.values[rows], calibration)
    return camera, np.isfinite(camera).all(axis=1) & (camera[:, 2] > 0)


def _point_information(
    camera: Float[np.ndarray, "k 3"], calibration: np.ndarray
) -> Float[np.ndarray, "k 3 3"]:
    """Information of a triangulated point per px^2, camera frame: J'J of (u_left, v_left, u_right)."""
    fx, fy, _, _, baseline = calibration
    x, y, z = camera.T
    J = np.zeros((len(camera), 3, 3))
    J[:, 0, 0] = J[:, 2, 0] = fx / z
    J[:, 1, 1] = fy / z
    J[:, 0, 2], J[:, 1, 2], J[:, 2, 2] = -fx * x / z**2, -fy * y / z**2, -fx * (x - baseline) / z**2
    return np.swapaxes(J, 1, 2) @ J
