"""Inertia of many mass distributions at once."""

import numpy as np

from spinfilters.core.mass_distribution import inertia_matrices, inertia_matrix


def test_inertia_of_many_is_that_of_each_to_the_last_bit() -> None:
    generator = np.random.default_rng(0)
    points = np.concatenate(
        [size * generator.standard_normal((20, 5)) for size in (0.0, 1e-8, 0.1, 1.0, 5.0)]
    )
    np.testing.assert_array_equal(inertia_matrices(points), [inertia_matrix(point) for point in points])
