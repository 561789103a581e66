"""Poses of sequences with gaps, on points whose landmarks are known."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic_points import RIG, Ball

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.vision.association import Tracker
from spinfilters.vision.batch_tracks import found_epochs
from spinfilters.vision.front_end import FrontEndOptions
from spinfilters.vision.image_folder import LossCount
from spinfilters.vision.stereo_geometry import near_pairs
from spinfilters.vision.stereo_matching import StereoFeatures
from spinfilters.vision.track_noise import TrackNoise

OPTIONS = FrontEndOptions(noise=TrackNoise((0.04, 0.0), (0.04, 0.0)))


def _sequence(degrees: Sequence[float]) -> list[tuple[float, StereoFeatures]]:
    ball = Ball()
    turns = [Rotation.from_euler("y", angle, degrees=True).as_matrix() for angle in degrees]
    return [
        (0.5 * k, ball.seen(turn, np.array([0, 0, 0.6]), pixel_std=0.2)[0]) for k, turn in enumerate(turns)
    ]


@pytest.mark.parametrize(
    ("degrees", "expected"),
    [
        ([0, 30, 60, 90], [0, 1, 2, 3]),
        ([0, 30, 180, 210, 240, 270, 300, 330, 360], range(9)),  # what comes back closes the gap
        ([0, 150, 180, 210, 240], [1, 2, 3, 4]),  # the rest is the larger part
        ([0, 20, 40, 180], [0, 1, 2]),
    ],
)
def test_epochs_after_a_gap_are_found_from_wherever_most_are(
    degrees: list[float], expected: Sequence[int]
) -> None:
    epochs = found_epochs(_sequence(degrees), RIG, OPTIONS)
    assert [epoch.epoch for epoch in epochs] == list(expected)
    first, last = (matrix_from_quaternion(epochs[k].pose[3:]) for k in (0, -1))
    turned = Rotation.from_euler("y", degrees[epochs[-1].epoch] - degrees[epochs[0].epoch], degrees=True)
    assert (Rotation.from_matrix(last @ first.T) * turned.inv()).magnitude() < np.deg2rad(1.5)


def test_five_of_fourteen_matches_that_agree_are_no_pose() -> None:
    """What so few agree on is no evidence; a search around the places that such a pose expects finds some more by chance."""
    ball, at = Ball(), np.array([0, 0, 0.6])
    tracker = Tracker(RIG, OPTIONS.noise, LossCount())
    points = ball.seen(np.eye(3), at)[0]
    assert tracker.add(0, 0.0, points) is not None
    assert tracker.landmarks is not None
    rows, few = np.arange(tracker.landmarks.count), points.part(np.arange(len(points)) < 14)
    assert tracker.pose_by_descriptors(few, rows) is not None
    mixed = np.r_[:5, np.roll(np.arange(5, 14), 1)]
    wrong = replace(few, features=replace(few.features, descriptors=few.features.descriptors[mixed]))
    assert tracker.pose_by_descriptors(wrong, rows) is None


def test_a_sequence_without_points_has_no_epochs() -> None:
    empty = _sequence([0])[0][1].part(np.zeros(len(_sequence([0])[0][1]), dtype=bool))
    assert found_epochs([(0.0, empty), (0.5, empty)], RIG, OPTIONS) == []


@pytest.mark.parametrize("dim", [2, 3])
def test_near_pairs_are_all_pairs_within_the_radius(dim: int) -> None:
    generator = np.random.default_rng(0)
    places, others = generator.uniform(0, 40, (60, dim)), generator.uniform(0, 40, (90, dim))
    apart = np.linalg.norm(places[:, None] - others, axis=2)
    found = near_pairs(places, others, 6.0)
    expected = np.argwhere(apart <= 6.0)
    np.testing.assert_array_equal(sorted(zip(found.place, found.other, strict=True)), expected)
    np.testing.assert_allclose(found.distance, apart[found.place, found.other])
    assert len(near_pairs(places, others[:0], 6.0).place) == 0
