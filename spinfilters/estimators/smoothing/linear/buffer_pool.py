"""Buffer pool for large arrays that every iteration needs anew.

A fresh array of megabytes costs more in page faults than the work that is done in it. An array from here returns by itself when
nothing refers to it or to any view of it.
"""

import weakref
from math import prod

import numpy as np

from spinfilters.symbolic.compiled import address

LARGE = 1 << 15
"""Numbers from which an array is lent."""
KEPT = 6
"""Arrays that are kept at most."""
ALIGNMENT = 8
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
    """An array of any numbers, aligned to vectors."""
    count = prod(shape)
    raw = _taken(count) if count >= LARGE else None
    if raw is None:
        raw = np.empty(count + ALIGNMENT)
    first = (-address(raw) // raw.itemsize) % ALIGNMENT
    if count < LARGE:
        return raw[first : first + count].reshape(shape)
    array = np.frombuffer(raw.data, count=count, offset=first * raw.itemsize)
    weakref.finalize(array, _give_back, raw).atexit = False
    return array.reshape(shape)


def _taken(count: int) -> np.ndarray | None:
    """A spare array that is long enough and not much too long."""
    for key, raw in list(_pool.items()):
        if count + ALIGNMENT <= len(raw) <= 2 * (count + ALIGNMENT) and _pool.pop(key, None) is raw:
            return raw
    return None


def _give_back(raw: np.ndarray) -> None:
    _pool[id(raw)] = raw
    for key in list(_pool)[:-KEPT]:
        _pool.pop(key, None)
