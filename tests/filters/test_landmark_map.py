"""Landmarks of a filter: found again by their ids, followed while unseen, and let go when they are wrong or too many."""

import numpy as np
import pytest

from spinfilters.filters.landmark_map import CONFIRMED, LARGEST_TABLE, WRONG_IN_A_ROW, LandmarkMap, RowsOfIds
from spinfilters.filters.landmark_steps import SLOTS

RANK = 4


@pytest.fixture
def generator() -> np.random.Generator:
    return np.random.default_rng(3)


def map_of(generator: np.random.Generator, count: int, confirmed: int = CONFIRMED) -> LandmarkMap:
    result = LandmarkMap(RANK)
    added(result, generator, np.arange(count), confirmed)
    return result


def added(
    landmarks: LandmarkMap, generator: np.random.Generator, ids: np.ndarray, confirmed: int = CONFIRMED
) -> None:
    count = len(ids)
    roots = np.tril(generator.standard_normal((count, 3, 3)))
    modes = generator.standard_normal((count, 3, RANK))
    landmarks.append(ids, generator.standard_normal((count, 3)), modes, roots, confirmed)


def step(generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return (
        np.eye(RANK) + 0.1 * generator.standard_normal((RANK, RANK)),
        0.1 * generator.standard_normal((RANK, 6)),
        0.1 * generator.standard_normal(RANK),
    )


def test_landmarks_are_found_by_their_ids(generator):
    landmarks = map_of(generator, 5)
    np.testing.assert_array_equal(landmarks.locate(np.array([3, 9, 0])), [3, -1, 0])
    assert landmarks.remove(np.array([1, 3])).tolist() == [1, 3]
    rows = landmarks.locate(np.array([0, 1, 2, 3, 4]))
    assert (rows >= 0).tolist() == [True, False, True, False, True]
    np.testing.assert_array_equal(landmarks.ids[rows[rows >= 0]], [0, 2, 4])


def test_rows_of_ids_are_those_noted_last_however_large_or_negative_the_ids_are(generator):
    rows, expected = RowsOfIds(), {}
    candidates = np.array([0, 1, 255, 256, 5000, LARGEST_TABLE - 1, LARGEST_TABLE, 2**62, -1, -(2**62)])
    for _ in range(200):
        chosen = generator.permutation(candidates)[: generator.integers(1, 6)]
        noted = generator.integers(0, 99, len(chosen))
        rows.note(chosen, noted)
        expected |= dict(zip(chosen.tolist(), noted.tolist(), strict=True))
        gone = np.array([key for key in expected if generator.random() < 0.3], dtype=np.int64)
        rows.forget(gone)
        for key in gone.tolist():
            del expected[key]
        asked = generator.permutation(candidates)[:4]
        assert rows.find(asked).tolist() == [expected.get(key, -1) for key in asked.tolist()]
        assert [int(rows.find(one[None])[0]) for one in asked] == rows.find(asked).tolist()
    assert rows.find(np.zeros(0, dtype=np.int64)).size == 0


@pytest.mark.parametrize("epochs", [1, SLOTS - 3, 3 * SLOTS])
def test_unseen_landmarks_follow_the_modes_as_if_they_were_touched_in_every_epoch(generator, epochs):
    landmarks = map_of(generator, 37)
    rows = np.arange(37)
    points, A, L = landmarks.points[rows].copy(), landmarks.modes[rows].copy(), landmarks.roots[rows].copy()
    P = L @ np.swapaxes(L, 1, 2)
    for _ in range(epochs):
        transform, dropped, shift = step(generator)
        points += A @ shift
        lost = A @ dropped
        A, P = A @ transform, P + lost @ np.swapaxes(lost, 1, 2)
        landmarks.advance(transform, dropped, shift)
    landmarks.refresh(rows)
    np.testing.assert_allclose(landmarks.points[rows], points, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(landmarks.modes[rows], A, rtol=1e-9, atol=1e-12)
    found = landmarks.roots[rows] @ np.swapaxes(landmarks.roots[rows], 1, 2)
    np.testing.assert_allclose(found, P, rtol=1e-9, atol=1e-12)


def test_no_landmark_falls_behind_by_more_epochs_than_there_are_slots_however_the_map_grows(generator):
    landmarks, first = map_of(generator, 3), 3
    for k in range(4 * SLOTS):
        landmarks.advance(*step(generator))
        count = 40 if k < 2 * SLOTS else 0
        added(landmarks, generator, np.arange(first, first + count))
        first += count
        if k % 7 == 0:
            landmarks.remove(generator.choice(len(landmarks), 2, replace=False))
        assert landmarks.now - landmarks.epoch[: len(landmarks)].min() < SLOTS


def test_a_landmark_is_wrong_when_it_is_refused_thrice_in_a_row_or_at_its_second_observation(generator):
    landmarks = map_of(generator, 3)
    added(landmarks, generator, np.array([7]), confirmed=1)
    rows = np.arange(4)
    assert landmarks.refuse(rows[[1, 3]]).tolist() == [3]
    for _ in range(WRONG_IN_A_ROW - 2):
        assert landmarks.refuse(rows[1:2]).tolist() == []
    assert landmarks.refuse(rows[:2]).tolist() == [1]


def test_the_stalest_landmarks_go_first(generator):
    landmarks = map_of(generator, 40)
    landmarks.advance(*step(generator))
    landmarks.refuse(np.arange(8, 40))
    assert landmarks.stalest(40).size == 0
    assert landmarks.stalest(36).tolist() == [0, 1, 2, 3, 4, 5]


def test_a_restored_map_goes_on_to_the_same_bits(generator):
    landmarks = map_of(generator, 30)
    for _ in range(5):
        landmarks.advance(*step(generator))
    other = LandmarkMap.restored({key: value.copy() for key, value in landmarks.snapshot().items()})
    assert other.locate(np.array([29, 31])).tolist() == [29, -1]
    for _ in range(SLOTS):
        moved = step(generator)
        landmarks.advance(*moved)
        other.advance(*moved)
    for key, array in landmarks.snapshot().items():
        np.testing.assert_array_equal(other.snapshot()[key], array, strict=True)
