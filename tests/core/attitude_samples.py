"""Attitudes where formulas break, and hypothesis strategies for any attitude."""

from typing import Final

import numpy as np
from hypothesis import strategies as st
from jaxtyping import Float

TINY_ANGLES: Final = np.logspace(-12, -6, 7)
SERIES_SWITCH_ANGLE: Final = 2 * np.sqrt(1e-4)
"""Rotation angle in rad at which `expressions.SMALL_SQUARE` switches between series and closed form."""
ANGLES: Final = np.concatenate(
    [
        [0.0, 1e-300, 1e-160, 1e-20],
        TINY_ANGLES,
        SERIES_SWITCH_ANGLE * (1 + np.array([-1e-3, -1e-12, 0.0, 1e-12, 1e-3])),
        [0.3, np.pi / 2, 2.0, 3.0],
        np.pi - TINY_ANGLES,
        [np.pi],
        np.pi + TINY_ANGLES,
        [4.0, 3 * np.pi / 2, 6.0],
        2 * np.pi - TINY_ANGLES,
        [2 * np.pi],
    ]
)
AXES: Final = np.array(
    [[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, 0.6, -0.8], [2 / 3, -1 / 3, 2 / 3], [1e-9, 1.0, 0.0]]
)


def special_rotation_vectors() -> Float[np.ndarray, "n 3"]:
    """Every sampled angle, up to 2 pi rad, about every sampled axis."""
    return (ANGLES[:, np.newaxis, np.newaxis] * AXES).reshape(-1, 3)


def special_quaternions() -> Float[np.ndarray, "n 4"]:
    """Quaternions [n sin(a/2), cos(a/2)] of the same: beyond pi the scalar part is negative."""
    half = ANGLES[:, np.newaxis, np.newaxis] / 2
    q = np.concatenate([np.sin(half) * AXES, np.cos(half) * np.ones((1, len(AXES), 1))], axis=-1).reshape(
        -1, 4
    )
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def random_quaternions(*shape: int) -> Float[np.ndarray, "*shape 4"]:
    """Uniform attitudes, the same in every run."""
    q = np.random.default_rng(2013).normal(size=(*shape, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def vectors(size: int, bound: float) -> st.SearchStrategy[np.ndarray]:
    """Vectors with components up to ``bound`` in size."""
    return st.lists(st.floats(-bound, bound), min_size=size, max_size=size).map(np.array)


def quaternions() -> st.SearchStrategy[np.ndarray]:
    """Any unit quaternion."""
    return vectors(4, 1.0).filter(lambda q: np.linalg.norm(q) > 1e-3).map(lambda q: q / np.linalg.norm(q))
