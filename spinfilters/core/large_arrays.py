"""Memory of large arrays: that of some megabytes is used again, and what is larger than memory should hold lies in a file.

Memory that is new to a process comes from the system page by page, which takes longer than to fill it. Arrays that an iteration
makes anew, of the same sizes each time, therefore get the memory of those before (`pooled_array`).

Covariance factors of a million epochs of a gyro take a gigabyte. They are written once and read in stretches, and a stretch that is
done with needs no memory (`empty_array`): they are in a temporary file that has no name.
"""

import math
import mmap
import os
import tempfile
from contextlib import suppress
from typing import Final
from weakref import WeakValueDictionary, finalize

import numpy as np

LARGEST_IN_MEMORY: Final = 256_000_000
"""Bytes of an array from which it is in a file."""
_FILES: Final = WeakValueDictionary[int, mmap.mmap]()
"""Files of arrays that are in use, by the address at which they begin."""
LARGE: Final = 1 << 15
"""Numbers from which an array is lent."""
KEPT: Final = 6
"""Arrays that are kept at most."""
ALIGNMENT: Final = 8
"""Numbers in a vector of the machine, at whose multiples an array begins."""
_pool: dict[int, np.ndarray] = {}
"""Spare arrays by identity, the oldest first.

Each step on it is one call that no other thread, nor a finalizer, can divide. A lock would not do: a finalizer that runs in the
middle of a search would wait for it in vain."""


def pooled_zeros(*shape: int) -> np.ndarray:
    """An array of zeros, aligned to vectors."""
    array = pooled_array(*shape)
    array[...] = 0.0
    return array


def pooled_array(*shape: int) -> np.ndarray:
    """An array of undefined numbers, aligned to vectors, in memory that is kept for the next such array when this one is gone."""
    count = math.prod(shape)
    raw = _take_spare(count) if count >= LARGE else None
    if raw is None:
        raw = np.empty(count + ALIGNMENT)
    first = (-_address(raw) // raw.itemsize) % ALIGNMENT
    if count < LARGE:
        return raw[first : first + count].reshape(shape)
    array = np.frombuffer(raw.data, count=count, offset=first * raw.itemsize)
    finalize(array, _give_back, raw).atexit = False
    return array.reshape(shape)


def _take_spare(count: int) -> np.ndarray | None:
    """A spare array that is long enough and not much too long."""
    for key, raw in list(_pool.items()):
        if count + ALIGNMENT <= len(raw) <= 2 * (count + ALIGNMENT) and _pool.pop(key, None) is raw:
            return raw
    return None


def _give_back(raw: np.ndarray) -> None:
    _pool[id(raw)] = raw
    for key in list(_pool)[:-KEPT]:
        _pool.pop(key, None)


def empty_array(shape: tuple[int, ...], dtype: type) -> np.ndarray:
    """An array of undefined numbers, in memory or, where it is large, in a file that goes with it."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if size > LARGEST_IN_MEMORY and hasattr(os, "posix_fallocate"):
        with suppress(OSError), tempfile.TemporaryFile(prefix="spinfilters-") as file:
            os.posix_fallocate(file.fileno(), 0, size)  # a full disk says so here, not when a page is written
            pages = mmap.mmap(file.fileno(), size)
            array = np.frombuffer(pages, dtype).reshape(shape)
            _FILES[_address(array)] = pages
            return array
    return np.empty(shape, dtype)


def release_pages(array: np.ndarray) -> None:
    """Give the memory of an array in a file back until it is read or written again; its numbers stay."""
    address = _address(array)
    for begin, pages in list(_FILES.items()):
        if begin <= address < begin + len(pages) and hasattr(mmap, "MADV_DONTNEED"):
            pages.madvise(mmap.MADV_DONTNEED)


def _address(array: np.ndarray) -> int:
    return array.__array_interface__["data"][0]
