"""Association of stereo features with landmarks.

Visual odometry, then a search limited by pose (Tweddle 2013, section 6.3).
The thesis matches all epochs with all. Here an epoch is matched with the landmarks of the latest epochs, which gives its pose
(absolute orientation within RANSAC), and then with the landmarks that this pose brings into view, of whatever revolution: the cost
of an epoch depends on what is in view and not on how many epochs went before.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.attitude.conversions import matrix_from_quaternion
from spinfilters.data.camera import StereoRig
from spinfilters.geometry.cameras import stereo_pair
from spinfilters.tracks.matches import Matches
from spinfilters.tracks.pose_fit import FittedPose, fit_pose
from spinfilters.vision.constant_rate import TimedPose, constant_rate
from spinfilters.vision.epoch_observations import EpochObservations
from spinfilters.vision.landmark_views import LandmarkViews, second_numbers
from spinfilters.vision.loss_count import LossCount
from spinfilters.vision.stereo_geometry import near_pairs, pixels_by_point, pixels_of
from spinfilters.vision.stereo_matching import StereoFeatures, clear_pairs
from spinfilters.vision.track_noise import TrackNoise

ODOMETRY: Final = "frame-to-frame matches"
GLOBAL: Final = "matches with the map"
EPOCHS: Final = "epochs"
RECENT: Final = 3
"""Epochs whose landmarks the odometry looks at."""
FEWEST: Final = 8
"""Matches that a pose must rest on."""
CLEAR_SHARE: Final = 0.2
"""Of the points that are found in the map: with fewer, poses from all landmarks are tried too."""
PLACE_FLOOR: Final = 0.3
"""px: standard deviation that a pose of a growing map adds to every match's place."""


@dataclass(frozen=True)
class Association:
    """Options of the association.

    Attributes
    ----------
    similarity, ratio: see `StereoMatching`.   search_px: around the place where a landmark of late epochs is expected.
    return_px: around that of one that comes back after a revolution, which drift has moved.   gate: largest error of a match
    in standard deviations.   crowded_px: from a landmark in view, within which a point that looks like it is no new landmark.
    same_px: between the places of two landmarks that look alike, within which they are one.
    """

    similarity: float = 0.72
    ratio: float = 0.88
    search_px: float = 6.0
    return_px: float = 12.0
    gate: float = 4.0
    crowded_px: float = 3.0
    same_px: float = 1.5


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

    def add(
        self, epoch: int, time: float, points: StereoFeatures, pose: Float[np.ndarray, " 7"] | None = None
    ) -> EpochObservations | None:
        """Observations of an epoch at the given or found pose, if any."""
        if self.landmarks is None:
            if len(points) < FEWEST:
                self._losses.lose(EPOCHS, "with too few points")
                return None
            return self._first(epoch, time, points, pose)
        if pose is None:
            pose = self._odometry(time, points)
            if pose is None:
                return None
        return self._registered(epoch, time, points, pose)

    def _first(
        self, epoch: int, time: float, points: StereoFeatures, pose: Float[np.ndarray, " 7"] | None
    ) -> EpochObservations:
        """The first map, with g at the middle of its points."""
        self.landmarks = LandmarkViews(points.features.descriptors.shape[1])
        if pose is None:
            middle = np.median(
                stereo_pair(self._rig.calibration).points_of(points.values, self._rig.calibration), axis=0
            )
            pose = np.array([*middle, 0.0, 0.0, 0.0, 1.0])
        return self._kept(epoch, time, points, pose, self.landmarks.add(len(points)))

    def _odometry(self, time: float, points: StereoFeatures) -> Float[np.ndarray, " 7"] | None:
        """Pose from landmarks of the latest epochs, or at a constant rate.

        From all landmarks where these explain little.
        The one is taken that most landmarks are found with: wrong matches may agree on a pose among themselves.
        """
        assert self.landmarks is not None
        if len(points) < FEWEST:
            self._losses.lose(EPOCHS, "with too few points")
            return None
        active = self.landmarks.active
        recent = np.flatnonzero(active & (self.landmarks.last_seen > self._latest - RECENT))
        poses = [self._matched(points, recent), constant_rate(self._poses[-2:], time)]
        best, support = self._best(points, poses)
        if support < CLEAR_SHARE * len(points):
            best, support = self._best(points, [best, self._matched(points, np.flatnonzero(active))])
        if support < FEWEST:
            self._losses.lose(EPOCHS, "whose pose was not found")
            return None
        return best

    def _best(
        self, points: StereoFeatures, poses: list[Float[np.ndarray, " 7"] | None]
    ) -> tuple[Float[np.ndarray, " 7"] | None, int]:
        """The pose with which most landmarks are found where they must be, and how many."""
        best, most = None, 0
        for pose in poses:
            support = 0 if pose is None else self._support(points, pose)
            if support > most:
                best, most = pose, support
        return best, most

    def _support(self, points: StereoFeatures, pose: Float[np.ndarray, " 7"]) -> int:
        features, rows = self._search(points, pose, 1.0, LossCount())
        fit = self._fit(points, features, rows)
        return (
            0 if fit is None else int(np.count_nonzero(self._within_gate(points, fit.pose, features, rows)))
        )

    def _matched(self, points: StereoFeatures, rows: Int[np.ndarray, " m"]) -> Float[np.ndarray, " 7"] | None:
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
        fit = self._fit(points, features, chosen)
        agreeing = 0 if fit is None else int(self._within_gate(points, fit.pose, features, chosen).sum())
        if fit is None or agreeing < FEWEST:
            self._losses.lose(ODOMETRY, "of an epoch with too few", len(pairs))
            return None
        self._losses.lose(ODOMETRY, "against the motion of the others", len(pairs) - agreeing)
        self._losses.keep(ODOMETRY, agreeing)
        return fit.pose

    def _fit(
        self, points: StereoFeatures, features: Int[np.ndarray, " n"], rows: Int[np.ndarray, " n"]
    ) -> FittedPose | None:
        """Pose that most of the matches agree on (absolute orientation within RANSAC, then Gauss-Newton)."""
        assert self.landmarks is not None
        if len(rows) < FEWEST:
            return None
        noise = self._covariance(points)[features]
        matches = Matches(
            self.landmarks.points[rows], points.values[features], noise, self.landmarks.covariance[rows]
        )
        return fit_pose(matches, self._rig.calibration)

    def _registered(
        self, epoch: int, time: float, points: StereoFeatures, pose: Float[np.ndarray, " 7"]
    ) -> EpochObservations | None:
        """Observations of an epoch whose pose is roughly known."""
        assert self.landmarks is not None
        features, rows = self._search(points, pose, 1.0, LossCount())
        fit = self._fit(points, features, rows)
        pose = pose if fit is None else fit.pose
        features, rows = self._search(points, pose, 0.6, self._losses)
        good = self._within_gate(points, pose, features, rows)
        self._losses.lose(GLOBAL, "too far from their place", int(np.count_nonzero(~good)))
        ids = np.full(len(points), -1)
        ids[features[good]] = rows[good]
        new = (ids < 0) & ~self._crowded(points, pose)
        self._losses.lose(
            GLOBAL, "beside a landmark that looks alike", int(np.count_nonzero((ids < 0) & ~new))
        )
        self._losses.keep(GLOBAL, int(np.count_nonzero(good)))
        ids[new] = self.landmarks.add(int(np.count_nonzero(new)))
        chosen = ids >= 0
        return self._kept(epoch, time, points.part(chosen), pose, ids[chosen])

    def _search(
        self, points: StereoFeatures, pose: Float[np.ndarray, " 7"], scale: float, losses: LossCount
    ) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
        """Features, and the landmarks in view that they are, within a scaled search radius."""
        rows, expected, descriptors = self._in_view(pose)
        if not len(rows):
            return np.zeros(0, dtype=int), rows
        landmarks, options = self.landmarks, self._options
        assert landmarks is not None
        late = landmarks.last_seen[rows] > self._latest - 2 * RECENT
        radius = scale * np.where(late, options.search_px, options.return_px)
        near = near_pairs(points.values, expected, scale * options.return_px)
        feature, place = (
            near.place[near.distance <= radius[near.other]],
            near.other[near.distance <= radius[near.other]],
        )
        similarity = np.full((len(points), len(rows)), -1.0, dtype=np.float32)
        similarity[feature, place] = np.einsum(
            "nd,nd->n", points.features.descriptors[feature], descriptors[place]
        )
        second = second_numbers(similarity, rows, expected, options.similarity, options.same_px)
        landmarks.retire(rows[second])
        similarity[:, second] = -1.0
        pairs = clear_pairs(similarity, options.similarity, options.ratio, losses, GLOBAL)
        return pairs[:, 0], rows[pairs[:, 1]]

    def _in_view(
        self, pose: Float[np.ndarray, " 7"]
    ) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, "n 3"], Float[np.ndarray, "n d"]]:
        """Landmarks in view from a known direction, with pixels and descriptors."""
        assert self.landmarks is not None
        R, at = matrix_from_quaternion(pose[3:]), self._at(pose, np.arange(self.landmarks.count))
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
        descriptors, known = self.landmarks.seen_from(rows, directions)
        return rows[known], pixels[rows[known]], descriptors[known]

    def _within_gate(
        self,
        points: StereoFeatures,
        pose: Float[np.ndarray, " 7"],
        features: Int[np.ndarray, " n"],
        rows: Int[np.ndarray, " n"],
    ) -> Bool[np.ndarray, " n"]:
        """Matches whose error is explained by the noise of feature and landmark."""
        assert self.landmarks is not None
        at = self._at(pose, rows)
        error = points.values[features] - pixels_of(at, self._rig)
        slope = pixels_by_point(at, self._rig) @ matrix_from_quaternion(pose[3:])
        spread = self._covariance(points)[features] + slope @ self.landmarks.covariance[rows] @ np.swapaxes(
            slope, 1, 2
        )
        spread[:, [0, 1, 2, 0, 2], [0, 1, 2, 2, 0]] += PLACE_FLOOR**2
        squared = np.einsum("ni,ni->n", error, np.linalg.solve(spread, error[..., None])[..., 0])
        return squared <= self._options.gate**2

    def _crowded(self, points: StereoFeatures, pose: Float[np.ndarray, " 7"]) -> Bool[np.ndarray, " n"]:
        """Features beside the place of a landmark that they resemble: perhaps it, and no new one."""
        rows, expected, descriptors = self._in_view(pose)
        if not len(rows):
            return np.zeros(len(points), dtype=bool)
        near = near_pairs(points.values[:, :2], expected[:, :2], self._options.crowded_px)
        alike = np.einsum("nd,nd->n", points.features.descriptors[near.place], descriptors[near.other])
        crowded = np.zeros(len(points), dtype=bool)
        crowded[near.place[alike >= self._options.similarity]] = True
        return crowded

    def _kept(
        self,
        epoch: int,
        time: float,
        points: StereoFeatures,
        pose: Float[np.ndarray, " 7"],
        ids: Int[np.ndarray, " n"],
    ) -> EpochObservations:
        """Take an epoch's observations into the map."""
        assert self.landmarks is not None
        R, camera = (
            matrix_from_quaternion(pose[3:]),
            stereo_pair(self._rig.calibration).points_of(points.values, self._rig.calibration),
        )
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

    def _at(self, pose: Float[np.ndarray, " 7"], rows: Int[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        assert self.landmarks is not None
        return self.landmarks.points[rows] @ matrix_from_quaternion(pose[3:]).T + pose[:3]
