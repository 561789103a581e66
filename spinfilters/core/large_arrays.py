"""Arrays larger than memory should hold: in a temporary file that has no name, page by page in memory while it is worked on.

Covariance factors of a million epochs of a gyro take a gigabyte. They are written once and read in stretches, and a stretch that is
done with needs no memory.
"""

import math
import mmap
import os
import tempfile
from contextlib import suppress
from typing import Final
from weakref import WeakValueDictionary

import numpy as np

LARGEST_IN_MEMORY: Final = 256_000_000
"""Bytes of an array from which it is in a file."""
_FILES: Final = WeakValueDictionary[int, mmap.mmap]()
"""Files of arrays that are in use, by the address at which they begin."""


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
