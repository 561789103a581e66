"""Which landmarks a filter holds: where they stand, what is remembered of them, and who has to go."""

import numpy as np
import pytest

from spinfilters.estimators.landmarks.landmark_map import (
    CONFIRMED,
    LARGEST_WAITING_LIST,
    MEMORY,
    USUAL_RATE,
    WORTH_REPLACING,
    WRONG_IN_A_ROW,
    LandmarkMap,
    LandmarkOptions,
)

ANCHOR = np.array([0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 1.0])


def ids_of(*values):
    return np.array(values, dtype=np.int64)


def map_of(*values, confirmed=1):
    """A map of these ids; coordinates tell them apart."""
    result = LandmarkMap()
    add(result, *values, confirmed=confirmed)
    return result


def add(landmarks, *values, confirmed=1):
    coordinates = np.stack([[0.1 * value, 0.0, 0.5] for value in values]) if values else np.zeros((0, 3))
    landmarks.append(ids_of(*values), np.tile(ANCHOR, (len(values), 1)), coordinates, confirmed)


def chosen(landmarks, ids, options):
    """Ids that come in, in order, and ids that go."""
    come, stay = landmarks.admission(ids, options)
    return ids[come].tolist(), landmarks.ids[~stay].tolist()


def watched(landmarks, seen, frames):
    """So many frames in which these landmarks of the map were seen and agreed."""
    for _ in range(frames):
        landmarks.frame += 1
        rows = landmarks.locate(seen)
        landmarks.record(rows, np.ones(len(rows), dtype=bool))


def test_an_empty_map_locates_nothing():
    assert LandmarkMap().locate(ids_of(3, 5)).tolist() == [-1, -1]
    assert LandmarkMap().locate(ids_of()).tolist() == []
    assert len(LandmarkMap()) == 0
    assert LandmarkMap().points.shape == (0, 3)


def test_landmarks_are_located_in_any_order_of_map_and_question():
    landmarks = map_of(40, 7, 300, -2)
    assert landmarks.locate(ids_of(300, 8, -2, 7, 1000, -5, 40)).tolist() == [2, -1, 3, 1, -1, -1, 0]
    assert landmarks.locate(ids_of()).tolist() == []


def test_landmarks_are_located_after_others_have_gone():
    landmarks = map_of(40, 7, 300)
    landmarks.keep(np.array([False, True, True]))
    assert landmarks.locate(ids_of(40, 300, 7)).tolist() == [-1, 1, 0]
    np.testing.assert_allclose(landmarks.coordinates[:, 0], [0.7, 30.0])
    assert len(landmarks.first) == len(landmarks.hits) == len(landmarks.since) == len(landmarks.wrong) == 2


def test_points_come_out_in_metres_in_the_frame_g():
    np.testing.assert_allclose(map_of(3).points, [[0.6, 0.0, 0.0]], atol=1e-15)


def test_a_sighting_that_agrees_wipes_out_those_that_did_not():
    landmarks = map_of(1, 2, confirmed=CONFIRMED)
    both = np.array([0, 1])
    landmarks.record(both, np.array([False, False]))
    landmarks.record(both, np.array([True, False]))
    assert landmarks.wrong.tolist() == [0, 2]
    assert landmarks.hits.tolist() == [CONFIRMED + 1, CONFIRMED]


def test_a_confirmed_landmark_is_mistaken_after_several_wrong_sightings_in_a_row():
    landmarks = map_of(1, confirmed=CONFIRMED)
    for k in range(WRONG_IN_A_ROW):
        assert not landmarks.mistaken.any(), k
        landmarks.record(np.array([0]), np.array([False]))
    assert landmarks.mistaken.all()


def test_a_landmark_is_mistaken_at_once_when_its_second_sighting_disagrees():
    landmarks = map_of(1, 2)
    assert not landmarks.mistaken.any()
    landmarks.record(np.array([0, 1]), np.array([False, True]))
    assert landmarks.mistaken.tolist() == [True, False]


def test_recording_nothing_changes_nothing():
    landmarks = map_of(1, 2)
    landmarks.record(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=bool))
    assert landmarks.hits.tolist() == [1, 1]
    assert landmarks.wrong.tolist() == [0, 0]


def test_the_first_coordinates_are_not_moved_with_the_present_ones():
    landmarks = map_of(1)
    landmarks.coordinates = landmarks.coordinates + 1.0
    np.testing.assert_array_equal(landmarks.first, [[0.1, 0.0, 0.5]])


def test_newcomers_come_in_as_long_as_there_is_room():
    landmarks, options = map_of(1, 2), LandmarkOptions(capacity=4)
    assert chosen(landmarks, ids_of(8, 9), options) == ([8, 9], [])
    assert chosen(landmarks, ids_of(), options) == ([], [])


def test_those_that_were_seen_most_often_outside_come_in_first():
    landmarks = map_of(1, 2)
    for seen in ([8, 9], [9], [9]):
        landmarks.frame += 1
        landmarks.note(ids_of(*seen))
    assert chosen(landmarks, ids_of(8, 9), LandmarkOptions(capacity=4)) == ([9, 8], [])
    assert chosen(landmarks, ids_of(7, 8, 9), LandmarkOptions(capacity=4, replaced_per_frame=1)) == (
        [9, 7],
        [],
    )


def test_a_landmark_that_is_hardly_seen_gives_way_and_one_that_is_seen_stays():
    landmarks, options = map_of(1, 2, 3, 4), LandmarkOptions(capacity=4)
    watched(landmarks, ids_of(1, 2, 3), 40)
    assert chosen(landmarks, ids_of(9), options) == ([9], [4])
    watched(landmarks, ids_of(4), 40)
    assert chosen(landmarks, ids_of(9), options) == ([], [])


def test_no_more_are_replaced_in_a_frame_than_allowed():
    landmarks = map_of(1, 2, 3, 4, 5)
    watched(landmarks, ids_of(1), 100)
    come, go = chosen(landmarks, ids_of(*range(10, 20)), LandmarkOptions(capacity=5, replaced_per_frame=2))
    assert come == [10, 11]
    assert go == [2, 3]


def test_what_is_free_is_filled_before_anything_is_replaced():
    landmarks = map_of(1, 2, 3)
    watched(landmarks, ids_of(1), 100)
    come, go = chosen(landmarks, ids_of(10, 11, 12), LandmarkOptions(capacity=4, replaced_per_frame=1))
    assert come == [10, 11]
    assert go == [2]


@pytest.mark.parametrize(("worse", "go"), [(0.99, [4]), (1.01, [])])
def test_a_landmark_gives_way_just_below_the_share_that_is_worth_it(worse, go):
    landmarks = map_of(1, 2, 3, 4)
    landmarks.frame = 1000
    rival = landmarks.expected_rate(np.array([1]), np.array([1000])).item()
    due = WORTH_REPLACING * rival * (1001 + MEMORY) - USUAL_RATE * MEMORY
    landmarks.hits = np.array([1000, 1000, 1000, round(worse * due)])
    assert chosen(landmarks, ids_of(9), LandmarkOptions(capacity=4))[1] == go


def test_the_expected_rate_goes_from_what_is_usual_to_the_landmarks_own():
    landmarks = map_of(1)
    assert landmarks.expected_rate(np.array([0]), np.array([1])) == pytest.approx([USUAL_RATE])
    landmarks.frame = 100_000
    assert landmarks.expected_rate(np.array([70_000]), np.array([0])) == pytest.approx([0.7], abs=1e-3)
    rates = landmarks.expected_rate(np.array([5, 10]), np.array([0, 0]))
    assert rates[0] < rates[1]


def test_the_waiting_list_counts_first_and_last_sightings():
    landmarks = map_of(1)
    for frame, seen in ((3, [8, 9]), (5, [9]), (9, [9, 10])):
        landmarks.frame = frame
        landmarks.note(ids_of(*seen))
    assert landmarks.waiting.tolist() == [[8, 1, 3, 3], [9, 3, 3, 9], [10, 1, 9, 9]]
    landmarks.note(ids_of())
    assert len(landmarks.waiting) == 3


def test_a_landmark_that_comes_in_leaves_the_waiting_list_and_keeps_its_first_frame():
    landmarks = map_of(1)
    for frame in (3, 5):
        landmarks.frame = frame
        landmarks.note(ids_of(8, 9))
    add(landmarks, 9)
    assert landmarks.waiting[:, 0].tolist() == [8]
    assert landmarks.since[landmarks.locate(ids_of(9))].tolist() == [3]


def test_a_landmark_nobody_waited_for_counts_from_now_on():
    landmarks = map_of(1)
    landmarks.frame = 6
    add(landmarks, 9)
    assert landmarks.since.tolist() == [0, 6]
    assert landmarks.hits.tolist() == [1, 1]


def test_the_waiting_list_is_bounded_and_forgets_those_seen_longest_ago():
    landmarks = LandmarkMap()
    landmarks.note(np.arange(LARGEST_WAITING_LIST))
    landmarks.frame = 1
    landmarks.note(np.arange(100))
    landmarks.frame = 2
    landmarks.note(np.arange(10_000, 10_050))
    assert len(landmarks.waiting) == LARGEST_WAITING_LIST
    kept = set(landmarks.waiting[:, 0].tolist())
    assert set(range(100)) <= kept
    assert set(range(10_000, 10_050)) <= kept
    landmarks.frame = 3
    landmarks.note(np.arange(20_000, 20_000 + 2 * LARGEST_WAITING_LIST))
    assert len(landmarks.waiting) == LARGEST_WAITING_LIST
    assert (landmarks.waiting[:, 0] >= 20_000).all()


def test_a_full_map_without_newcomers_stays_as_it_is():
    landmarks = map_of(1, 2, 3, 4)
    watched(landmarks, ids_of(1), 100)
    assert chosen(landmarks, ids_of(), LandmarkOptions(capacity=4)) == ([], [])


def test_a_map_that_started_beyond_its_capacity_takes_nobody_in_without_room():
    """A belief may bring more landmarks than the options allow: they are not thrown out, and the map does not grow."""
    landmarks = map_of(*range(8))
    come, go = chosen(landmarks, ids_of(*range(20, 30)), LandmarkOptions(capacity=5))
    assert len(come) <= len(go)
