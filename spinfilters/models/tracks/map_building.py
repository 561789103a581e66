"""Poses and a map from stereo tracks alone, in alternation, with the standard deviation of the pixels."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.cameras import stereo_pair
from spinfilters.core.errors import InputError
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.sensor_tables import KnownMap
from spinfilters.models.sensor_noise import NoiseLevel, noise_of_rows
from spinfilters.models.tracks.pose_consensus import Matches
from spinfilters.models.tracks.track_poses import (
    FittedPose,
    find_landmarks,
    fit_pose,
    fit_poses,
    pose_stream,
    track_epochs,
)

CHI_SQUARE_MEDIAN = 2.366
"""Of three degrees of freedom: those that a landmark seen twice leaves."""
POSE_MATCHES = 2
"""Matches that have as many components as a pose."""


@dataclass(frozen=True)
class StereoView:
    """Landmarks that one epoch shows, triangulated.

    Attributes
    ----------
    ids : Int[np.ndarray, ' k']
        (k,).
    camera : Float[np.ndarray, 'k 3']
        (k, 3) m, camera frame.
    information : Float[np.ndarray, 'k 3 3']
        (k, 3, 3) 1/m^2 of them.
    pixels : Float[np.ndarray, 'k 3']
        (k, 3) rectified.
    """

    ids: Int[np.ndarray, " k"]
    camera: Float[np.ndarray, "k 3"]
    information: Float[np.ndarray, "k 3 3"]
    pixels: Float[np.ndarray, "k 3"]
    noise: NoiseLevel

    def only(self, ids: Int[np.ndarray, " a"]) -> "StereoView":
        """The view of some landmarks alone."""
        chosen = np.isin(self.ids, ids)
        noise = noise_of_rows(self.noise, chosen)
        return StereoView(
            self.ids[chosen], self.camera[chosen], self.information[chosen], self.pixels[chosen], noise
        )

    def matches(self, later: "StereoView") -> Matches:
        """Matches of a later view with these landmarks; g is this epoch's camera frame."""
        _, here, there = np.intersect1d(self.ids, later.ids, return_indices=True)
        here, there = here[np.argsort(there)], np.sort(there)
        covariance = np.linalg.inv(self.information[here])
        noise = noise_of_rows(later.noise, np.isin(np.arange(len(later.ids)), there))
        return Matches(self.camera[here], later.pixels[there], noise, covariance)


def noise_ratio(views: Sequence[StereoView], calibration: Float[np.ndarray, " c"]) -> float | None:
    """Standard deviation of the pixels over the stated; None where no two views determine it.

    It is the median's, which wrong matches that agree by chance hardly move.
    """
    found = fit_poses([one.matches(other) for one, other in pairwise(views)], calibration)
    fits = [fit for fit in found if fit is not None and np.count_nonzero(fit.inliers) > POSE_MATCHES]
    squares = np.concatenate([np.zeros(0), *map(_inlier_squares, fits)])
    return float(np.sqrt(np.median(squares) / CHI_SQUARE_MEDIAN)) if len(squares) else None


def _inlier_squares(fit: FittedPose) -> Float[np.ndarray, " i"]:
    """Squares of the matches that agree, raised by what the fit has taken."""
    count = np.count_nonzero(fit.inliers)
    return fit.squares[fit.inliers] * count / (count - POSE_MATCHES)


AGREEMENT = 6.0
"""Mahalanobis distance within which an observation belongs to a candidate; it leaves room for the drift of poses."""
CHOSEN, ALTERNATIVE = 0, 1


@dataclass
class MapInProgress:
    """Information sums of every landmark. Its point is the information-weighted mean of the observations that agree.

    An observation is poor along its line of sight, so points seen from several sides are far better than any one observation.
    Each landmark has two candidates. An observation joins the chosen one if it agrees with it, else the alternative, else it
    becomes the alternative of a landmark whose alternative nothing has confirmed. The one with more observations is the chosen
    one: a landmark whose first observation was a wrong association is so found again as soon as two later ones agree.

    Attributes
    ----------
    ids : Int[np.ndarray, ' n']
        (n,) ascending.
    information : Float[np.ndarray, 'n 2 3 3']
        (n, 2, 3, 3) 1/m^2, frame g.
    weighted : Float[np.ndarray, 'n 2 3']
        (n, 2, 3) information times point.
    hits : Int[np.ndarray, 'n 2']
        (n, 2) observations of each candidate.
    """

    ids: Int[np.ndarray, " n"]
    information: Float[np.ndarray, "n 2 3 3"]
    weighted: Float[np.ndarray, "n 2 3"]
    hits: Int[np.ndarray, "n 2"]

    @classmethod
    def empty(cls, ids: Int[np.ndarray, " n"]) -> "MapInProgress":
        """Map without an observation."""
        n = len(ids)
        return cls(ids, np.zeros((n, 2, 3, 3)), np.zeros((n, 2, 3)), np.zeros((n, 2), dtype=int))

    @property
    def seen(self) -> Bool[np.ndarray, " n"]:
        """Mask of landmarks that have a point."""
        return self.hits[:, CHOSEN] > 0

    def points(
        self, where: Int[np.ndarray, " k"]
    ) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3 3"]]:
        """Points (m, frame g) and covariances of landmarks that have one."""
        return self._candidates(where, CHOSEN)

    def add(
        self,
        where: Int[np.ndarray, " k"],
        information: Float[np.ndarray, "k 3 3"],
        points: Float[np.ndarray, "k 3"],
    ) -> None:
        """Observations of distinct landmarks ``where``, as points in g with their information."""
        vacant = self.hits[where] == 0
        chosen = vacant[:, CHOSEN] | self._agrees_with_candidate(where, CHOSEN, information, points)
        alternative = ~chosen & self._agrees_with_candidate(where, ALTERNATIVE, information, points)
        fresh = ~chosen & ~alternative & (self.hits[where, ALTERNATIVE] <= 1)
        self.information[where[fresh], ALTERNATIVE] = 0.0
        self.weighted[where[fresh], ALTERNATIVE] = 0.0
        self.hits[where[fresh], ALTERNATIVE] = 0
        weighted = (information @ points[..., None])[..., 0]
        for candidate, rows in ((CHOSEN, chosen), (ALTERNATIVE, alternative | fresh)):
            self.information[where[rows], candidate] += information[rows]
            self.weighted[where[rows], candidate] += weighted[rows]
            self.hits[where[rows], candidate] += 1
        # a candidate with more observations takes the place of the one that is chosen
        better = where[self.hits[where, ALTERNATIVE] > self.hits[where, CHOSEN]]
        for sums in (self.information, self.weighted, self.hits):
            sums[better] = sums[better][:, ::-1]

    def _candidates(self, where: np.ndarray, candidate: int) -> tuple[np.ndarray, np.ndarray]:
        covariance = np.linalg.inv(self.information[where, candidate])
        return (covariance @ self.weighted[where, candidate][..., None])[..., 0], covariance

    def _agrees_with_candidate(
        self, where: np.ndarray, candidate: int, information: np.ndarray, points: np.ndarray
    ) -> Bool[np.ndarray, " k"]:
        result = self.hits[where, candidate] > 0
        held = np.flatnonzero(result)
        there, covariance = self._candidates(where[held], candidate)
        away = points[held] - there
        spread = covariance + np.linalg.inv(information[held])
        distance = np.einsum("ki,ki->k", away, np.linalg.solve(spread, away[..., None])[..., 0])
        result[held] = distance < AGREEMENT**2
        return result


PASSES = 2
"""Rounds over all epochs after the first sweep, each with a better map: one closes a revolution, the other settles."""
SMALLEST_DISPARITY_PX = 0.1
"""Below it a point is at infinity: its information has no third direction that numbers could hold."""


class FoundMap(NamedTuple):
    """Poses, their map, and the ratio of the pixel noise to the stated one; None where the data do not determine it."""

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
    noise : NoiseLevel
        Of the tracks: a standard deviation (px), or the covariance of every row (px^2).
    epochs : int | None
        How many of the first epochs to look at; all when None.

    Raises
    ------
    InputError
        When fewer than four landmarks are seen at first, or no epoch can be fitted.
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
        building = _build_map(views, poses, ids)
        fits = fit_poses([_matches(tracks, rows, building, noise) for _, rows in chosen], calibration)
        poses = [None if fitted is None else fitted.pose for fitted in fits]
    agreed = [
        view.only(_agreed_ids(tracks, rows, building, fitted))
        for view, (_, rows), fitted in zip(views, chosen, fits, strict=True)
    ]
    building = _build_map(views, poses, ids)
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
    """Matches of an epoch with a map of which each point has its covariance."""
    assert tracks.ids is not None
    index, _ = find_landmarks(known.ids, tracks.ids[rows])
    found = known.seen[index]
    points, covariance = known.points(index[found])
    own = noise_of_rows(noise_of_rows(noise, rows), found)
    return Matches(points, tracks.values[rows][found], own, covariance)


def _view(
    tracks: MeasurementStream, rows: slice, calibration: Float[np.ndarray, " c"], noise: NoiseLevel
) -> StereoView:
    """View of one epoch, as far as it can be triangulated."""
    assert tracks.ids is not None
    camera, good = _triangulated(tracks, rows, calibration)
    own = noise_of_rows(noise_of_rows(noise, rows), good)
    information = _point_information(camera[good], calibration, own)
    return StereoView(tracks.ids[rows][good], camera[good], information, tracks.values[rows][good], own)


def _build_map(
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
