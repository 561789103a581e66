"""Signs of eigenvectors, which no equation fixes."""

from typing import Final

import numpy as np
from jaxtyping import Float

EQUAL: Final = 1e-6
"""Relative difference below which components are equally large: rounding must not choose between those of (1, -1, 0)."""


def with_largest_positive(vectors: Float[np.ndarray, "*batch n"]) -> Float[np.ndarray, "*batch n"]:
    """Vectors, turned round where the first of their largest components is negative."""
    size = np.abs(vectors)
    first = (size >= (1 - EQUAL) * size.max(axis=-1, keepdims=True)).argmax(axis=-1)
    largest = np.take_along_axis(vectors, first[..., np.newaxis], axis=-1)
    return np.where(largest < 0, -vectors, vectors)
