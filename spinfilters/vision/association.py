"""Association of stereo points with landmarks: prediction at a constant rate, matching, pose, new and retired landmarks.

Visual odometry, then a search limited by pose (Tweddle 2013, section 6.3). The thesis matches all epochs with all. Here an
epoch is matched with the landmarks of the latest epochs, which gives its pose (absolute orientation within RANSAC), and then
with the landmarks that this pose brings into view, of whatever revolution: the cost of an epoch depends on what is in view and
not on how many epochs went before.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.attitude_conversions import (
    inverse,
    matrix_from_quaternion,
    multiply,
    quaternion_from_rotation_vector,
    rotation_vector_from_quaternion,
)
from spinfilters.io.camera import StereoRig
from spinfilters.models.tracks.pose_consensus import Matches
from spinfilters.models.tracks.track_poses import FittedPose, fit_pose, refine_pose
from spinfilters.vision.image_folder import LossCount
from spinfilters.vision.stereo_geometry import near_pairs, pixels_by_point, pixels_of, points_of
from spinfilters.vision.stereo_matching import EpochObservations, StereoFeatures, clear_pairs
from spinfilters.vision.track_noise import TrackNoise

FARTHEST: Final = 2.5
"""Times of the interval between the two, beyond which no pose is predicted."""


class TimedPose(NamedTuple):
    """Time (s) and pose (t, q_ig)."""

    time: float
    pose: Float[np.ndarray, " 7"]


def constant_rate(poses: Sequence[TimedPose], time: float) -> Float[np.ndarray, " 7"] | None:
    """Pose extrapolated from two epochs at constant velocity and rate; None without two, or too long after."""
    if len(poses) < 2:
        return None
    earlier, later = poses
    share = (time - later.time) / (later.time - earlier.time)
    if not 0 < share < FARTHEST:
        return None
    turn = rotation_vector_from_quaternion(multiply(later.pose[3:], inverse(earlier.pose[3:])))
    q = multiply(quaternion_from_rotation_vector(share * turn), later.pose[3:])
    return np.concatenate([later.pose[:3] + share * (later.pose[:3] - earlier.pose[:3]), q])


VIEWS: Final = 6
"""Descriptors kept of a landmark."""
NEW_VIEW: Final = float(np.cos(np.deg2rad(12)))
"""Cosine of the angle to all kept views beyond which a view is kept too."""
WIDEST_VIEW: Final = float(np.cos(np.deg2rad(52)))
"""Cosine of the angle between directions from which a descriptor may be recognised."""


class LandmarkViews:
    """Landmarks 0, 1, 2, ... in frame g, weighted means of their observations, with descriptors by direction.

    Attributes
    ----------
    count : int
        Of landmarks.
    last_seen : ndarray of shape (k,)
        (count,) epoch.
    observations : ndarray of shape (k,)
        (count,).
    retirements : int
        How often a landmark was left out of the search: while it stays, a search finds what it found.
    """

    def __init__(self, descriptor_dim: int) -> None:
        self.count = 0
        self._information = np.zeros((0, 3, 3))
        self._vector = np.zeros((0, 3))
        self._points = np.zeros((0, 3))
        self._covariance = np.zeros((0, 3, 3))
        self._descriptors = np.zeros((0, VIEWS, descriptor_dim), dtype=np.float32)
        self._directions = np.zeros((0, VIEWS, 3))
        self._kept = np.zeros(0, dtype=int)
        self._last_seen = np.zeros(0, dtype=int)
        self._observations = np.zeros(0, dtype=int)
        self._retired = np.zeros(0, dtype=bool)
        self.retirements = 0

    @property
    def points(self) -> Float[np.ndarray, "k 3"]:
        """Positions, m."""
        return self._points[: self.count]

    @property
    def covariance(self) -> Float[np.ndarray, "k 3 3"]:
        """Covariances of the positions, m^2; errors of the poses are not in them."""
        return self._covariance[: self.count]

    @property
    def last_seen(self) -> Int[np.ndarray, " k"]:
        """Latest epoch of each."""
        return self._last_seen[: self.count]

    @property
    def observations(self) -> Int[np.ndarray, " k"]:
        """Number of observations of each."""
        return self._observations[: self.count]

    @property
    def active(self) -> Bool[np.ndarray, " k"]:
        """Landmarks to be looked for: all that are no second number of another."""
        return ~self._retired[: self.count]

    def retire(self, rows: Int[np.ndarray, " n"]) -> None:
        """Look for these no longer."""
        self._retired[rows] = True
        self.retirements += len(rows)

    def add(self, count: int) -> Int[np.ndarray, " n"]:
        """Numbers of so many new landmarks."""
        first, self.count = self.count, self.count + count
        if self.count > len(self._points):
            self._grow(max(self.count, 2 * len(self._points), 512))
        return np.arange(first, self.count)

    def observe(
        self,
        rows: Int[np.ndarray, " n"],
        epoch: int,
        points: Float[np.ndarray, "n 3"],
        covariance: Float[np.ndarray, "n 3 3"],
    ) -> None:
        """Take observations of different landmarks into their means (frame g, m)."""
        information = np.linalg.inv(covariance)
        self._information[rows] += information
        self._vector[rows] += np.einsum("nij,nj->ni", information, points)
        self._covariance[rows] = np.linalg.inv(self._information[rows])
        self._points[rows] = np.einsum("nij,nj->ni", self._covariance[rows], self._vector[rows])
        self._last_seen[rows] = epoch
        self._observations[rows] += 1

    def look(
        self,
        rows: Int[np.ndarray, " n"],
        directions: Float[np.ndarray, "n 3"],
        descriptors: Float[np.ndarray, "n d"],
    ) -> None:
        """Store descriptors seen from new viewing directions: unit vectors in frame g, from landmark to camera."""
        cosines = np.einsum("nvi,ni->nv", self._directions[rows], directions)
        new = np.where(np.arange(VIEWS) < self._kept[rows, None], cosines, -1.0).max(axis=1) < NEW_VIEW
        chosen = rows[new]
        place = self._kept[chosen] % VIEWS
        self._descriptors[chosen, place], self._directions[chosen, place] = descriptors[new], directions[new]
        self._kept[chosen] = np.where(self._kept[chosen] < VIEWS, self._kept[chosen] + 1, VIEWS)

    def views_from(
        self, rows: Int[np.ndarray, " n"], directions: Float[np.ndarray, "n 3"]
    ) -> tuple[Int[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
        """Numbers of the views nearest to these directions, and which are near enough to be recognised."""
        cosines = (self._directions[rows] @ directions[:, :, None])[..., 0]
        cosines = np.where(np.arange(VIEWS) < self._kept[rows, None], cosines, -2.0)
        best = cosines.argmax(axis=1)
        return best, cosines[np.arange(len(rows)), best] >= WIDEST_VIEW

    def descriptors(
        self, rows: Int[np.ndarray, " n"], views: Int[np.ndarray, " n"]
    ) -> Float[np.ndarray, "n d"]:
        """Descriptors of some of their views."""
        return self._descriptors[rows, views]

    def latest_view(self, rows: Int[np.ndarray, " n"]) -> Float[np.ndarray, "n d"]:
        """Descriptors of the views kept last."""
        return self._descriptors[rows, np.maximum(self._kept[rows] - 1, 0)]

    def _grow(self, size: int) -> None:
        for name, array in list(vars(self).items()):
            if isinstance(array, np.ndarray):
                larger = np.zeros((size, *array.shape[1:]), dtype=array.dtype)
                larger[: len(array)] = array
                setattr(self, name, larger)


def second_numbers(
    similarity: Float[np.ndarray, "n m"],
    rows: Int[np.ndarray, " m"],
    expected: Float[np.ndarray, "m 3"],
    least: float,
    farthest: float,
) -> Int[np.ndarray, " k"]:
    """Columns of landmarks that duplicate an older one from another side.

    Both are at one place and look like one feature.
    A point that leaves on one rim and comes back on the other is not recognised at once, and is given a second number there.

    Parameters
    ----------
    similarity : ndarray of shape (n, m)
        Of features to landmarks.
    rows : ndarray of shape (m,)
        Numbers of the landmarks.
    expected : ndarray of shape (m, 3)
        Their pixels.
    least : float
        Similarity.
    farthest : float
        Largest distance, px.
    """
    feature, column = np.nonzero(similarity >= least)
    best = similarity.argmax(axis=1)[feature]
    apart = np.abs(expected[column] - expected[best]).max(axis=1)
    same = (column != best) & (apart <= farthest)
    return np.unique(np.where(rows[column] > rows[best], column, best)[same])


ODOMETRY: Final = "frame-to-frame matches"
GLOBAL: Final = "matches with the map"
EPOCHS: Final = "epochs"
RECENT: Final = 3
"""Epochs whose landmarks the odometry looks at."""
FEWEST: Final = 8
"""Matches that a pose must rest on."""
CERTAIN_SHARE: Final = 0.5
"""Of the points that are found in the map at one pose: with so many, another one is not tried."""
CLEAR_SHARE: Final = 0.2
"""Of the points that are found in the map: with fewer, poses from all landmarks are tried too."""
SETTLED: Final = 0.01
"""Steps of a pose in standard deviations below which its iterations end: it is adjusted once more with all others."""
PLACE_FLOOR: Final = 0.3
"""px: standard deviation that a pose of a growing map adds to every match's place."""


@dataclass(frozen=True)
class Association:
    """Options of the association.

    Attributes
    ----------
    similarity, ratio : float
        See `StereoMatching`.
    search_px : float
        Around the place where a landmark of late epochs is expected.
    return_px : float
        Around that of one that comes back after a revolution, which drift has moved.
    gate : float
        Largest error of a match in standard deviations.
    crowded_px : float
        From a landmark in view, within which a point that looks like it is no new landmark.
    same_px : float
        Between the places of two landmarks that look alike, within which they are one.
    """

    similarity: float = 0.72
    ratio: float = 0.88
    search_px: float = 6.0
    return_px: float = 12.0
    gate: float = 4.0
    crowded_px: float = 3.0
    same_px: float = 1.5


class _LandmarksInView(NamedTuple):
    """Landmarks in view from a pose.

    Attributes
    ----------
    rows : ndarray of int, shape (n,)
        Their numbers.
    pixels : ndarray of shape (n, 3)
        Where they are expected.
    views : ndarray of int, shape (n,)
        Numbers of the views nearest to the line of sight.
    """

    rows: Int[np.ndarray, " n"]
    pixels: Float[np.ndarray, "n 3"]
    views: Int[np.ndarray, " n"]


class _Candidate(NamedTuple):
    """A pose that an epoch may have.

    Attributes
    ----------
    pose : ndarray of shape (7,)
        Where landmarks were looked for.
    state : tuple[int, int]
        Of the map after that search (`Tracker._state`).
    features, rows : ndarray of int, shape (n,)
        Matches of features and landmarks around where it expects these.
    fit : FittedPose or None
        The pose that they agree on.
    support : int
        Matches within the gate of that pose.
    """

    pose: Float[np.ndarray, " 7"]
    state: tuple[int, int]
    features: Int[np.ndarray, " n"]
    rows: Int[np.ndarray, " n"]
    fit: FittedPose | None
    support: int


class Tracker:
    """Landmarks of the epochs so far, and the association of the next one with them."""

    def __init__(
        self, rig: StereoRig, noise: TrackNoise, losses: LossCount, options: Association | None = None
    ) -> None:
        self._rig, self._noise, self._losses = rig, noise, losses
        self._options = options or Association()
        self.landmarks: LandmarkViews | None = None
        self._poses: list[TimedPose] = []
        self._latest = 0
        self._view: tuple[Float[np.ndarray, " 7"], tuple[int, int], _LandmarksInView] | None = None

    def add(
        self, epoch: int, time: float, points: StereoFeatures, pose: Float[np.ndarray, " 7"] | None = None
    ) -> EpochObservations | None:
        """Observations of an epoch at the given or found pose, if any."""
        if self.landmarks is None:
            if len(points) < FEWEST:
                self._losses.lose(EPOCHS, "with too few points")
                return None
            return self._begin_map(epoch, time, points, pose)
        if pose is not None:
            return self._register_epoch(epoch, time, points, pose)
        best = self._pose_by_odometry(time, points)
        if best is None:
            return None
        return self._register_epoch(epoch, time, points, best.pose if best.fit is None else best.fit.pose)

    def _begin_map(
        self, epoch: int, time: float, points: StereoFeatures, pose: Float[np.ndarray, " 7"] | None
    ) -> EpochObservations:
        """The first map, with g at the middle of its points."""
        self.landmarks = LandmarkViews(points.features.descriptors.shape[1])
        if pose is None:
            middle = np.median(points_of(points.values, self._rig), axis=0)
            pose = np.array([*middle, 0.0, 0.0, 0.0, 1.0])
        return self._add_to_map(epoch, time, points, pose, self.landmarks.add(len(points)))

    def _pose_by_odometry(self, time: float, points: StereoFeatures) -> _Candidate | None:
        """Pose from landmarks of the latest epochs; while it explains few points, at a constant rate, then from all landmarks.

        The one is taken that most landmarks are found with: wrong matches may agree on a pose among themselves.
        """
        assert self.landmarks is not None
        if len(points) < FEWEST:
            self._losses.lose(EPOCHS, "with too few points")
            return None
        active = self.landmarks.active
        recent = np.flatnonzero(active & (self.landmarks.last_seen > self._latest - RECENT))
        best = self._better_supported(None, points, self.pose_by_descriptors(points, recent))
        if best is None or best.support < CERTAIN_SHARE * len(points):
            best = self._better_supported(best, points, constant_rate(self._poses[-2:], time))
        if best is None or best.support < CLEAR_SHARE * len(points):
            anywhere = self.pose_by_descriptors(points, np.flatnonzero(active))
            best = self._better_supported(best, points, anywhere)
        if best is None or best.support < FEWEST:
            self._losses.lose(EPOCHS, "whose pose was not found")
            return None
        # another candidate may have retired landmarks that this one was found with
        return best if best.state == self._state else self._candidate(points, best.pose)

    def _better_supported(
        self, best: _Candidate | None, points: StereoFeatures, pose: Float[np.ndarray, " 7"] | None
    ) -> _Candidate | None:
        """The pose, or the best one so far: that with which more landmarks are found where they must be, if any is."""
        if pose is None:
            return best
        found = self._candidate(points, pose)
        return found if found.support > (0 if best is None else best.support) else best

    def _candidate(self, points: StereoFeatures, pose: Float[np.ndarray, " 7"]) -> _Candidate:
        """A pose with what is found in the map around it, and what that agrees on."""
        features, rows = self._search_landmarks(points, pose, 1.0, LossCount())
        matches = self._matches(points, features, rows)
        fit = None if matches is None else refine_pose(matches, self._rig.calibration, pose, SETTLED)
        inside = np.zeros(0) if fit is None else self._within_gate(points, fit.pose, features, rows)
        return _Candidate(pose, self._state, features, rows, fit, int(np.count_nonzero(inside)))

    @property
    def _state(self) -> tuple[int, int]:
        """Of the map: while it stays, the same is found at the same pose."""
        assert self.landmarks is not None
        return self.landmarks.retirements, len(self._poses)

    def pose_by_descriptors(
        self, points: StereoFeatures, rows: Int[np.ndarray, " m"]
    ) -> Float[np.ndarray, " 7"] | None:
        """Pose from features that look like some landmarks, wherever these are; those that disagree are counted."""
        assert self.landmarks is not None
        pairs = clear_pairs(
            points.features.descriptors @ self.landmarks.latest_view(rows).T,
            self._options.similarity,
            self._options.ratio,
            self._losses,
            ODOMETRY,
        )
        features, chosen = pairs[:, 0], rows[pairs[:, 1]]
        matches = self._matches(points, features, chosen)
        fit = None if matches is None else fit_pose(matches, self._rig.calibration, SETTLED)
        agreeing = 0 if fit is None else int(self._within_gate(points, fit.pose, features, chosen).sum())
        if fit is None or agreeing < FEWEST:
            self._losses.lose(ODOMETRY, "of an epoch with too few", len(pairs))
            return None
        self._losses.lose(ODOMETRY, "against the motion of the others", len(pairs) - agreeing)
        self._losses.keep(ODOMETRY, agreeing)
        return fit.pose

    def _matches(
        self, points: StereoFeatures, features: Int[np.ndarray, " n"], rows: Int[np.ndarray, " n"]
    ) -> Matches | None:
        """Features with their landmarks; None of fewer than a pose must rest on."""
        if len(rows) < FEWEST:
            return None
        assert self.landmarks is not None
        return Matches(
            self.landmarks.points[rows],
            points.values[features],
            self._covariance(points)[features],
            self.landmarks.covariance[rows],
        )

    def _register_epoch(
        self, epoch: int, time: float, points: StereoFeatures, pose: Float[np.ndarray, " 7"]
    ) -> EpochObservations | None:
        """Observations of an epoch whose pose is known."""
        assert self.landmarks is not None
        features, rows = self._search_landmarks(points, pose, 0.6, self._losses)
        good = self._within_gate(points, pose, features, rows)
        self._losses.lose(GLOBAL, "too far from their place", int(np.count_nonzero(~good)))
        ids = np.full(len(points), -1)
        ids[features[good]] = rows[good]
        new = (ids < 0) & ~self._is_crowded(points, pose)
        self._losses.lose(
            GLOBAL, "beside a landmark that looks alike", int(np.count_nonzero((ids < 0) & ~new))
        )
        self._losses.keep(GLOBAL, int(np.count_nonzero(good)))
        ids[new] = self.landmarks.add(int(np.count_nonzero(new)))
        chosen = ids >= 0
        return self._add_to_map(epoch, time, points.part(chosen), pose, ids[chosen])

    def _search_landmarks(
        self, points: StereoFeatures, pose: Float[np.ndarray, " 7"], scale: float, losses: LossCount
    ) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
        """Features, and the landmarks in view that they are, within a scaled search radius."""
        view = self._in_view(pose)
        if not len(view.rows):
            return np.zeros(0, dtype=int), view.rows
        rows, expected = view.rows, view.pixels
        landmarks, options = self.landmarks, self._options
        assert landmarks is not None
        late = landmarks.last_seen[rows] > self._latest - 2 * RECENT
        radius = scale * np.where(late, options.search_px, options.return_px)
        near = near_pairs(points.values, expected, scale * options.return_px)
        within = near.distance <= radius[near.other]
        feature, place = near.place[within], near.other[within]
        if not len(place):
            losses.lose(GLOBAL, "without a counterpart", len(points))
            return np.zeros(0, dtype=int), rows[:0]
        alike = self._likeness(points, feature, place, view)
        # a column for each landmark that any feature is near to, a fraction of those in view
        columns, column = np.unique(place, return_inverse=True)
        rows, expected = rows[columns], expected[columns]
        similarity = np.full((len(points), len(rows)), -1.0, dtype=np.float32)
        similarity[feature, column] = alike
        second = second_numbers(similarity, rows, expected, options.similarity, options.same_px)
        landmarks.retire(rows[second])
        similarity[:, second] = -1.0
        pairs = clear_pairs(similarity, options.similarity, options.ratio, losses, GLOBAL)
        return pairs[:, 0], rows[pairs[:, 1]]

    def _in_view(self, pose: Float[np.ndarray, " 7"]) -> _LandmarksInView:
        """Landmarks in view from a known direction, with their pixels; of the latest pose they are kept."""
        if self._view is None or self._view[0] is not pose or self._view[1] != self._state:
            self._view = pose, self._state, self._find_in_view(pose)
        return self._view[2]

    def _find_in_view(self, pose: Float[np.ndarray, " 7"]) -> _LandmarksInView:
        assert self.landmarks is not None
        at, R = self._predict_landmarks(pose, np.arange(self.landmarks.count))
        pixels = pixels_of(at, self._rig)
        size = np.array([self._rig.left.width, self._rig.left.height])
        inside = (
            self.landmarks.active
            & (at[:, 2] > 0)
            & (pixels[:, :2] > 0).all(axis=1)
            & (pixels[:, :2] < size).all(axis=1)
        )
        rows = np.flatnonzero(inside)
        directions = -(at[rows] / np.linalg.norm(at[rows], axis=1, keepdims=True)) @ R
        views, known = self.landmarks.views_from(rows, directions)
        return _LandmarksInView(rows[known], pixels[rows[known]], views[known])

    def _likeness(
        self,
        points: StereoFeatures,
        features: Int[np.ndarray, " k"],
        places: Int[np.ndarray, " k"],
        view: _LandmarksInView,
    ) -> Float[np.ndarray, " k"]:
        """Products of the descriptors of features and of landmarks in view."""
        assert self.landmarks is not None
        descriptors = self.landmarks.descriptors(view.rows[places], view.views[places])
        return np.einsum("nd,nd->n", points.features.descriptors[features], descriptors)

    def _within_gate(
        self,
        points: StereoFeatures,
        pose: Float[np.ndarray, " 7"],
        features: Int[np.ndarray, " n"],
        rows: Int[np.ndarray, " n"],
    ) -> Bool[np.ndarray, " n"]:
        """Matches whose error is explained by the noise of feature and landmark."""
        assert self.landmarks is not None
        at, R = self._predict_landmarks(pose, rows)
        error = points.values[features] - pixels_of(at, self._rig)
        slope = pixels_by_point(at, self._rig) @ R
        spread = self._covariance(points)[features] + slope @ self.landmarks.covariance[rows] @ np.swapaxes(
            slope, 1, 2
        )
        spread[:, [0, 1, 2, 0, 2], [0, 1, 2, 2, 0]] += PLACE_FLOOR**2
        squared = np.einsum("ni,ni->n", error, np.linalg.solve(spread, error[..., None])[..., 0])
        return squared <= self._options.gate**2

    def _is_crowded(self, points: StereoFeatures, pose: Float[np.ndarray, " 7"]) -> Bool[np.ndarray, " n"]:
        """Whether features lie near a landmark that they resemble: they may show it, and are no new one."""
        view, crowded = self._in_view(pose), np.zeros(len(points), dtype=bool)
        if len(view.rows):
            near = near_pairs(points.values[:, :2], view.pixels[:, :2], self._options.crowded_px)
            alike = self._likeness(points, near.place, near.other, view)
            crowded[near.place[alike >= self._options.similarity]] = True
        return crowded

    def _add_to_map(
        self,
        epoch: int,
        time: float,
        points: StereoFeatures,
        pose: Float[np.ndarray, " 7"],
        ids: Int[np.ndarray, " n"],
    ) -> EpochObservations:
        """Take an epoch's observations into the map."""
        assert self.landmarks is not None
        R, camera = matrix_from_quaternion(pose[3:]), points_of(points.values, self._rig)
        noise = self._covariance(points)
        inverse = np.linalg.inv(pixels_by_point(camera, self._rig))
        spread = inverse @ noise @ np.swapaxes(inverse, 1, 2)
        self.landmarks.observe(ids, epoch, (camera - pose[:3]) @ R, R.T @ spread @ R)
        directions = -(camera / np.linalg.norm(camera, axis=1, keepdims=True)) @ R
        self.landmarks.look(ids, directions, points.features.descriptors)
        self._poses.append(TimedPose(time, pose))
        self._latest = epoch
        self._losses.keep(EPOCHS)
        return EpochObservations(epoch, time, pose, ids, points, noise)

    def _covariance(self, points: StereoFeatures) -> Float[np.ndarray, "n 3 3"]:
        return self._noise.covariance(points.features.size, points.residual)

    def _predict_landmarks(
        self, pose: Float[np.ndarray, " 7"], rows: Int[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "3 3"]]:
        """Landmarks in the camera's frame, m, and the rotation of g to it."""
        assert self.landmarks is not None
        R = matrix_from_quaternion(pose[3:])
        return self.landmarks.points[rows] @ R.T + pose[:3], R
