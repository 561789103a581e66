"""Rows of measurements weighed and multiplied in C as in NumPy."""

import numpy as np
import pytest
from jaxtyping import Float

from spinfilters.core.c_library import LANES
from spinfilters.smoother.epoch_rows import EpochRows, weigh_rows, weigh_rows_in_numpy

SHAPES = [
    (40, 3, 6),
    (20, 3, 1),
    (40, 2, 6),
    (25, 3, 3),
    (25, 6, 6),
    (30, 1, 2),
    (30, 3, LANES + 2),
    (12, 3, 3 * LANES),
]
"""Measurements, components of each, and columns: narrower and wider than the vectors of the loops, too."""


def drawn(count: int, dim: int, columns: int) -> tuple[np.ndarray, ...]:
    """Innovations, Jacobians, weights with zeros among them, and epochs of which some have no measurement."""
    generator = np.random.default_rng(count + columns)
    weight = generator.choice([0.0, 0.5, 1.0], count)
    epoch = np.sort(generator.choice([0, 1, 4, 5], count))
    return (
        generator.standard_normal((count, dim)),
        generator.standard_normal((count, dim, columns)),
        weight,
        epoch,
    )


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("is_scaled", [False, True])
def test_rows_are_weighed_in_c_as_in_numpy(shape: tuple[int, int, int], is_scaled: bool) -> None:
    y, J, weight, epoch = drawn(*shape)
    scale = np.linspace(0.5, 2.0, shape[1]) if is_scaled else None
    J[weight == 0] = np.nan  # of what does not count
    made = weigh_rows(y, J, scale, weight, epoch)
    expected = weigh_rows_in_numpy(y, J, scale, weight)
    np.testing.assert_allclose(made.rows, expected, rtol=1e-14)
    np.testing.assert_allclose(made.information, products(expected, epoch), rtol=1e-12, atol=1e-12)
    again = EpochRows(made.rows, epoch).information
    np.testing.assert_allclose(again, made.information, rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("shape", SHAPES)
def test_variances_of_rows_are_the_diagonal_of_their_products(shape: tuple[int, int, int]) -> None:
    y, J, weight, epoch = drawn(*shape)
    made = weigh_rows(y, J, None, weight, epoch)
    root = np.random.default_rng(1).standard_normal((6, shape[2], shape[2]))
    covariance = root @ root.swapaxes(1, 2)
    expected = np.einsum("rij,rjk,rik->ri", made.jacobian, covariance[epoch], made.jacobian)
    np.testing.assert_allclose(made.variances(covariance), expected, rtol=1e-12, atol=1e-12)


def products(rows: Float[np.ndarray, "r i c1"], epoch: np.ndarray) -> Float[np.ndarray, "f c1 c1"]:
    """Sum of the products of the rows of every epoch that has any."""
    every = rows.swapaxes(1, 2) @ rows
    return np.array([every[epoch == k].sum(axis=0) for k in np.unique(epoch)])
