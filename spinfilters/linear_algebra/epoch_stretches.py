"""Arrays of many epochs derived by stretches, so that intermediate ones stay small."""

from collections.abc import Callable

import numpy as np

STRETCH = 1024
"""Epochs whose derivatives are in memory together: they take ten times the room of what follows from them."""


def by_stretches(epochs: int, derive: Callable[[slice], dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Named arrays over so many epochs, at least one, from those of stretches of the epochs."""
    whole: dict[str, np.ndarray] = {}
    for start in range(0, epochs, STRETCH):
        rows = slice(start, min(start + STRETCH, epochs))
        for name, part in derive(rows).items():
            if name not in whole:
                whole[name] = np.empty((epochs, *part.shape[1:]), part.dtype)
            whole[name][rows] = part
    return whole
