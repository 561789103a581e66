"""Association of stereo points with landmarks, on points whose landmarks are known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic_points import RIG, Ball

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.vision.association import EPOCHS, Tracker
from spinfilters.vision.image_folder import LossCount
from spinfilters.vision.stereo_matching import StereoFeatures
from spinfilters.vision.track_noise import TrackNoise

AXIS = np.array([0.2, 0.95, 0.1]) / np.linalg.norm([0.2, 0.95, 0.1])


def _pose(degrees: float) -> tuple[np.ndarray, np.ndarray]:
    return Rotation.from_rotvec(np.deg2rad(degrees) * AXIS).as_matrix(), np.array([0.0, 0.0, 0.6])


def _tracker(losses: LossCount | None = None) -> Tracker:
    return Tracker(RIG, TrackNoise((0.04, 0.0), (0.04, 0.0)), losses or LossCount())


def test_a_landmark_keeps_its_number_through_a_revolution_and_after_it() -> None:
    ball, tracker, number, of_epoch = Ball(), _tracker(), {}, []
    for epoch in range(16):
        points, landmarks = ball.seen(*_pose(30.0 * epoch), pixel_std=0.2)
        observed = tracker.add(epoch, 0.5 * epoch, points)
        assert observed is not None
        place = {tuple(value): landmark for value, landmark in zip(points.values, landmarks, strict=True)}
        of_epoch.append({})
        for value, own in zip(observed.points.values, observed.ids.tolist(), strict=True):
            number.setdefault(place[tuple(value)], set()).add(own)
            of_epoch[-1][place[tuple(value)]] = own
    counts = np.array([len(own) for own in number.values()])
    assert counts.sum() == len(set.union(*number.values()))  # two landmarks never share a number
    assert counts.max() <= 2  # a second one where it comes back on the other rim, seen as never before
    for before, after in zip(of_epoch[:4], of_epoch[12:], strict=True):
        again = [before[landmark] == after[landmark] for landmark in before.keys() & after.keys()]
        assert np.mean(again) > 0.95
        assert len(again) > 0.9 * len(before)


def test_poses_follow_the_motion() -> None:
    ball, tracker = Ball(), _tracker()
    for epoch in range(8):
        R, t = _pose(25.0 * epoch)
        observed = tracker.add(epoch, 0.5 * epoch, ball.seen(R, t)[0])
        assert observed is not None
        turned = matrix_from_quaternion(observed.pose[3:])
        assert Rotation.from_matrix(turned.T @ R).magnitude() < 1e-3  # g begins with the axes of i


def test_wrong_descriptors_are_outvoted_and_counted() -> None:
    ball, losses = Ball(), LossCount()
    tracker = _tracker(losses)
    for epoch in range(6):
        R, t = _pose(20.0 * epoch)
        observed = tracker.add(epoch, 0.5 * epoch, ball.seen(R, t, 0.2, wrong=0.3)[0])
        assert observed is not None
        error = Rotation.from_matrix(matrix_from_quaternion(observed.pose[3:]).T @ R).magnitude()
        assert error < np.deg2rad(1.0)
    assert losses.lost["frame-to-frame matches", "against the motion of the others"] > 50


def test_a_gap_of_a_revolution_is_bridged_by_the_map() -> None:
    ball, tracker = Ball(), _tracker()
    for epoch in range(13):
        assert tracker.add(epoch, 0.5 * epoch, ball.seen(*_pose(30.0 * epoch), pixel_std=0.1)[0]) is not None
    count = tracker.landmarks.count if tracker.landmarks is not None else 0
    R, t = _pose(30.0 * 31)
    observed = tracker.add(31, 15.5, ball.seen(R, t, 0.1)[0])
    assert observed is not None
    assert np.mean(observed.ids < count) > 0.95
    assert Rotation.from_matrix(matrix_from_quaternion(observed.pose[3:]).T @ R).magnitude() < np.deg2rad(1.5)


@pytest.mark.parametrize("count", [0, 5])
def test_an_epoch_without_points_is_counted_and_loses_nothing_else(count: int) -> None:
    ball, losses = Ball(), LossCount()
    tracker = _tracker(losses)
    few = ball.seen(*_pose(0.0))[0].part(np.arange(len(ball.seen(*_pose(0.0))[0])) < count)
    assert tracker.add(0, 0.0, few) is None
    assert tracker.add(1, 0.5, ball.seen(*_pose(0.0))[0]) is not None
    assert tracker.add(2, 1.0, few) is None
    assert tracker.add(3, 1.5, ball.seen(*_pose(20.0))[0]) is not None
    assert losses.lost[EPOCHS, "with too few points"] == 2


def test_another_body_has_no_pose() -> None:
    losses = LossCount()
    tracker = _tracker(losses)
    assert tracker.add(0, 0.0, Ball(seed=0).seen(*_pose(0.0))[0]) is not None
    assert tracker.add(1, 0.5, Ball(seed=1).seen(*_pose(0.0))[0]) is None
    assert losses.lost[EPOCHS, "whose pose was not found"] == 1


def test_cost_of_an_epoch_does_not_grow_with_the_landmarks_out_of_view() -> None:
    """Candidates of the search are those in view from a direction they are known from, however many revolutions went before."""
    ball, tracker = Ball(180), _tracker()
    candidates = []
    for epoch in range(25):
        points: StereoFeatures = ball.seen(*_pose(30.0 * epoch), pixel_std=0.2)[0]
        observed = tracker.add(epoch, 0.5 * epoch, points)
        assert observed is not None
        candidates.append(len(tracker._in_view(observed.pose)[0]))
    assert max(candidates) < 0.7 * 180  # after two revolutions all landmarks are in the map
