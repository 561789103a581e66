"""Arrays that are lent: zeroed, aligned, never two of the same memory at once, and lent again when nobody looks any more."""

import numpy as np

from spinfilters.core import large_arrays as buffer_pool
from spinfilters.core.large_arrays import ALIGNMENT, LARGE, pooled_array, pooled_zeros

BIG = (200, LARGE // 200 + 1)


def test_it_is_zero_even_where_another_has_written() -> None:
    first = pooled_zeros(*BIG)
    first[...] = 7.0
    del first
    np.testing.assert_array_equal(pooled_zeros(*BIG), 0.0)


def test_it_begins_where_a_vector_does() -> None:
    for count in (1, 100, LARGE, 3 * LARGE + 1):
        assert pooled_array(count).ctypes.data % (8 * ALIGNMENT) == 0


def test_what_is_still_seen_through_a_view_is_not_lent_again() -> None:
    first = pooled_zeros(*BIG)
    view = first[3:5].T
    address = first.ctypes.data
    view[...] = 3.0
    del first
    others = [pooled_zeros(*BIG) for _ in range(2 * buffer_pool.KEPT)]
    assert all(other.ctypes.data != address for other in others)
    np.testing.assert_array_equal(view, 3.0)


def test_what_nobody_sees_is_lent_again() -> None:
    first = pooled_array(*BIG)
    address = first.ctypes.data
    del first
    others = [pooled_array(*BIG) for _ in range(buffer_pool.KEPT + 1)]
    assert any(other.ctypes.data == address for other in others)


def test_no_more_is_kept_than_a_few() -> None:
    many = [pooled_array(*BIG) for _ in range(3 * buffer_pool.KEPT)]
    many.clear()
    assert len(buffer_pool._pool) <= buffer_pool.KEPT
