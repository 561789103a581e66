"""Rank in floats: singular values and null vectors."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from observability.codistribution import InputSeries, SensorCodistribution, codistribution
from observability.exact_numbers import Rationals, Reals
from observability.system import System

TOLERANCE = 1e-9
"""Singular values below this part of the largest count as 0: what a float rank has to assume and an exact one need not."""


@dataclass(frozen=True)
class FloatRank:
    """Singular values and right singular vectors of scaled rows.

    Each row and column to unit size.

    Attributes
    ----------
    singular_values: descending.   vectors: (n, n) in its rows, of the unknowns divided by `scale`.   scale: (n,) of the unknowns.
    """

    singular_values: Float[np.ndarray, " n"]
    vectors: Float[np.ndarray, "n n"]
    scale: Float[np.ndarray, " n"]

    @property
    def rank(self) -> int:
        """By `TOLERANCE`."""
        return int((self.singular_values > TOLERANCE * self.singular_values[0]).sum())

    def null_vectors(self, dimension: int) -> Float[np.ndarray, "n d"]:
        """Unit vectors of the ``dimension`` least seen directions, orthonormal when scaled, in the order of `System.names`."""
        vectors = self.scale[:, np.newaxis] * self.vectors[len(self.scale) - dimension :].T
        return vectors / np.linalg.norm(vectors, axis=0, keepdims=True)


def float_rank(
    system: System, point: Rationals, orders: int, time_scale: float = 1.0, inputs: InputSeries = ()
) -> FloatRank:
    """Singular values of the rows of orders 0 to orders - 1.

    The k-th times time_scale^k (s: about a radian of the motion).
    """
    rows = codistribution(system, point, orders, Reals(), inputs)
    matrix = dense(rows, time_scale)
    matrix = matrix / np.maximum(np.linalg.norm(matrix, axis=1, keepdims=True), np.finfo(float).tiny)
    size = np.linalg.norm(matrix, axis=0)
    scale = 1 / np.where(size > 0, size, 1.0)
    _, values, vectors = np.linalg.svd(_padded(matrix * scale))
    return FloatRank(values[: matrix.shape[1]], vectors, scale)


def dense(rows: Sequence[SensorCodistribution], time_scale: float = 1.0) -> Float[np.ndarray, "k n"]:
    """All rows as one matrix in the order of `System.names`."""
    unknowns = rows[0].common.shape[-1] + sum(sensor.own[:, 0, 0].size for sensor in rows)
    parts, offset = [], rows[0].common.shape[-1]
    for sensor in rows:
        items, orders, values, own = sensor.own.shape
        part = np.zeros((items, orders, values, unknowns))
        part[..., : sensor.common.shape[-1]] = sensor.common
        for item in range(items):
            start = offset + item * own
            part[item, ..., start : start + own] = sensor.own[item]
        offset += items * own
        parts.append((part * time_scale ** np.arange(orders).reshape(1, -1, 1, 1)).reshape(-1, unknowns))
    return np.concatenate(parts)


def _padded(matrix: Float[np.ndarray, "k n"]) -> Float[np.ndarray, "l n"]:
    """With rows of 0, so that there are as many singular values as columns."""
    missing = max(0, matrix.shape[1] - matrix.shape[0])
    return np.concatenate([matrix, np.zeros((missing, matrix.shape[1]))])
