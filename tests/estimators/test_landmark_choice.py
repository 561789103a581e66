"""Which landmarks of a start go on."""

from types import SimpleNamespace

import numpy as np

from spinfilters.estimators.landmark_start.choice import most_useful


def start_of(*frames):
    """A start whose frames saw these landmarks, all of them believed."""
    timeline = [SimpleNamespace(measurements=[SimpleNamespace(ids=np.array(ids))]) for ids in frames]
    used = tuple(np.ones(len(ids), dtype=bool) for ids in frames)
    every = np.unique(np.concatenate(frames))
    return timeline, SimpleNamespace(ids=every, used=used)


def test_a_side_that_is_seldom_seen_is_not_left_bare():
    crowded = [[1, 2, 3, 4]] * 6
    timeline, smoothing = start_of(*crowded, [7], [7], [7])
    assert most_useful(timeline, smoothing, 3).tolist() == [1, 2, 7]


def test_where_all_are_seen_together_the_one_seen_most_often_comes_first():
    timeline, smoothing = start_of([5, 9], [5, 9], [9])
    assert most_useful(timeline, smoothing, 1).tolist() == [9]


def test_all_go_on_where_there_is_room():
    timeline, smoothing = start_of([5, 9], [3, 9])
    assert most_useful(timeline, smoothing, 10).tolist() == [3, 5, 9]


def test_sightings_that_were_not_believed_do_not_count():
    timeline, smoothing = start_of([5, 9], [5, 9], [5, 9])
    smoothing.used = (np.array([False, True]), np.array([False, True]), np.array([True, True]))
    assert most_useful(timeline, smoothing, 1).tolist() == [9]
