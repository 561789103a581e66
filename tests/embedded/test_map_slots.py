"""Places of landmarks in the embedded map."""

import numpy as np

from spinfilters.embedded.embedded_estimator import MapSlots


def test_a_full_map_gives_the_place_of_the_landmark_observed_longest_ago() -> None:
    slots = MapSlots(3)
    first, fresh = slots.places(np.array([-1, 7, 8]))
    assert sorted(first.tolist()) == sorted(fresh.tolist()) == [0, 1, 2]
    slots.places(np.array([-1, 8]))
    again, fresh = slots.places(np.array([9, -1]))
    assert again[0] == fresh[0] == first[1]
    assert again[1] == first[0]
    back, fresh = slots.places(np.array([7]))
    assert back.tolist() == fresh.tolist() == [first[2]]


def test_slots_go_on_from_a_snapshot() -> None:
    slots, other = MapSlots(4), MapSlots(4)
    slots.places(np.array([5, -3]))
    other.restore(slots.snapshot())
    expected, fresh = slots.places(np.array([-3, 6]))
    places, also_fresh = other.places(np.array([-3, 6]))
    assert places.tolist() == expected.tolist()
    assert fresh.tolist() == also_fresh.tolist()
