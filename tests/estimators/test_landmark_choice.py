"""Which landmarks of a start go on."""

import numpy as np

from spinfilters.estimators.landmark_start.choice import covering


def test_a_side_that_is_seldom_seen_is_not_left_bare():
    seen = np.zeros((5, 9))
    seen[:4, :6] = 1.0
    seen[4, 6:] = 1.0
    assert covering(seen, 3).tolist() == [0, 1, 4]


def test_where_all_are_seen_together_the_one_seen_most_often_comes_first():
    assert covering(np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 1.0]]), 1).tolist() == [1]


def test_all_go_on_where_there_is_room():
    assert covering(np.eye(3), 10).tolist() == [0, 1, 2]


def test_of_nothing_nothing_is_chosen():
    assert covering(np.zeros((0, 4)), 10).tolist() == []
