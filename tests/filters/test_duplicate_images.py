"""Repeated images are recognised by their values."""

import numpy as np
import pytest

from spinfilters.filters.outlier_rejection import DuplicateImages


def _frame(seed: int, count: int = 20) -> tuple[np.ndarray, np.ndarray]:
    return np.arange(count), np.random.default_rng(seed).standard_normal((count, 3))


@pytest.mark.parametrize(("changed", "frozen"), [(0, True), (2, True), (3, False), (20, False)])
def test_an_epoch_nearly_all_of_whose_values_are_the_same_is_a_repeated_image(
    changed: int, frozen: bool
) -> None:
    ids, values = _frame(0)
    other = values.copy()
    other[:changed] += 1e-12
    epochs = DuplicateImages()
    assert not epochs.is_duplicate(ids, values)
    epochs.pass_time()
    assert epochs.is_duplicate(np.append(ids, 99), np.append(other, [[0, 0, 0]], axis=0)) is frozen


def test_few_or_other_landmarks_do_not_make_a_repeated_image() -> None:
    ids, values = _frame(0)
    epochs = DuplicateImages()
    epochs.is_duplicate(ids[:3], values[:3])
    epochs.pass_time()
    assert not epochs.is_duplicate(ids[:3], values[:3])
    epochs.pass_time()
    epochs.is_duplicate(ids, values)
    epochs.pass_time()
    assert not epochs.is_duplicate(ids + 100, values)


def test_at_one_instant_only_rows_that_are_all_there_already_repeat() -> None:
    ids, values = _frame(0)
    epochs = DuplicateImages()
    assert not epochs.is_duplicate(ids[:1], values[:1])
    assert not epochs.is_duplicate(ids[1:2], values[1:2])
    assert epochs.is_duplicate(ids[:1], values[:1])
    assert not epochs.is_duplicate(ids[:3], values[:3])
    assert not epochs.is_duplicate(ids[5:6], values[5:6])
    copy = DuplicateImages()
    copy.restore(epochs.snapshot())
    assert copy.is_duplicate(ids[2:3], values[2:3])


def test_values_of_another_width_are_another_frame() -> None:
    """Two sensors of one name: nothing of the one is repeated by the other."""
    epochs, (ids, values) = DuplicateImages(), _frame(0)
    assert not epochs.is_duplicate(ids, values)
    assert not epochs.is_duplicate(ids, values[:, :2])
    assert epochs.is_duplicate(ids, values[:, :2])
