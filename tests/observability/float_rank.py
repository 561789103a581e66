"""Rank in floats: singular values and null vectors."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from observability.body_model import InputSeries, flow_of_system
from observability.codistribution import gradient_rows
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
    matrix = dense(system, sensor_rows(system, point, orders, inputs), time_scale)
    matrix = matrix / np.maximum(np.linalg.norm(matrix, axis=1, keepdims=True), np.finfo(float).tiny)
    size = np.linalg.norm(matrix, axis=0)
    scale = 1 / np.where(size > 0, size, 1.0)
    _, values, vectors = np.linalg.svd(_padded(matrix * scale))
    return FloatRank(values[: matrix.shape[1]], vectors, scale)


def sensor_rows(
    system: System, point: Rationals, orders: int, inputs: InputSeries = ()
) -> list[Float[np.ndarray, "k l v n"]]:
    """Gradients in floats of every sensor, (orders, items, values, own and common unknowns)."""
    taken = list(gradient_rows(flow_of_system(system, point, Reals(), inputs), orders))
    return [np.stack([rows.families[k] for rows in taken]) for k in range(len(system.sensors))]


def dense(
    system: System, rows: Sequence[Float[np.ndarray, "k l v n"]], time_scale: float = 1.0
) -> Float[np.ndarray, "k n"]:
    """All rows as one matrix in the order of `System.names`."""
    parts, offset = [], system.chart.error_dim
    for sensor, given in zip(system.sensors, rows, strict=True):
        orders, items, values, _ = given.shape
        part = np.zeros((orders, items, values, system.dimension))
        part[..., : system.chart.error_dim] = given[..., sensor.unknown :]
        for item in range(items):
            start = offset + item * sensor.unknown
            part[:, item, :, start : start + sensor.unknown] = given[:, item, :, : sensor.unknown]
        offset += items * sensor.unknown
        scaled = part * time_scale ** np.arange(orders).reshape(-1, 1, 1, 1)
        parts.append(scaled.reshape(-1, system.dimension))
    return np.concatenate(parts)


def _padded(matrix: Float[np.ndarray, "k n"]) -> Float[np.ndarray, "l n"]:
    """With rows of 0, so that there are as many singular values as columns."""
    missing = max(0, matrix.shape[1] - matrix.shape[0])
    return np.concatenate([matrix, np.zeros((missing, matrix.shape[1]))])
