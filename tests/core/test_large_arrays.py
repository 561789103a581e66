"""Large arrays in files: the same numbers, and no memory for what is done with."""

import mmap
import os
from pathlib import Path

import numpy as np
import pytest

from spinfilters.core import large_arrays
from spinfilters.core.large_arrays import empty_array, release_pages


def resident_pages() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1])


@pytest.mark.skipif(
    not hasattr(os, "posix_fallocate") or not Path("/proc/self/statm").exists(), reason="Linux"
)
def test_a_large_array_keeps_its_numbers_without_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(large_arrays, "LARGEST_IN_MEMORY", 1 << 20)
    rows = 1 << 20
    array = empty_array((rows, 8), float)
    array[:] = np.arange(rows)[:, np.newaxis]
    full = resident_pages()
    part = array[3:]
    release_pages(part)
    given_back = full - resident_pages()
    assert given_back * mmap.PAGESIZE > 0.8 * array.nbytes
    assert np.array_equal(part[:, 5], np.arange(3, rows))


def test_a_small_array_and_one_without_room_in_a_file_are_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: int) -> None:
        raise OSError(28, "No space left on device")

    assert empty_array((3, 2), int).base is None
    monkeypatch.setattr(large_arrays, "LARGEST_IN_MEMORY", 10)
    monkeypatch.setattr(os, "posix_fallocate", full, raising=False)
    array = empty_array((30, 2), int)
    array[:] = 7
    release_pages(array)
    assert (array == 7).all()
