"""The mean of attitudes: signs, weights, and the rotation nearest to the sum of the matrices."""

import numpy as np
import pytest

from spinfilters.core.absolute_orientation import mean_quaternion, nearest_rotation
from spinfilters.core.attitude_conversions import (
    angle_between,
    matrix_from_quaternion,
    multiply,
    quaternion_from_matrix,
    quaternion_from_rotation_vector,
)

COMMON = quaternion_from_rotation_vector(np.array([0.4, -2.0, 0.3]))
GENERATOR = np.random.default_rng(3)
NEAR = multiply(COMMON, quaternion_from_rotation_vector(0.05 * GENERATOR.standard_normal((3000, 3))))
WEIGHTS = GENERATOR.uniform(0.1, 3.0, 3000)


def test_signs_of_quaternions_do_not_matter() -> None:
    signs = np.where(GENERATOR.random(3000) < 0.5, -1.0, 1.0)[:, None]
    assert angle_between(mean_quaternion(NEAR), COMMON) < 0.005
    assert mean_quaternion(signs * NEAR) == pytest.approx(mean_quaternion(NEAR), abs=1e-12)


def test_it_is_the_rotation_nearest_to_the_weighted_sum_of_matrices() -> None:
    nearest = nearest_rotation(np.einsum("n,nij->ij", WEIGHTS, matrix_from_quaternion(NEAR)))
    assert angle_between(mean_quaternion(NEAR, WEIGHTS), quaternion_from_matrix(nearest)) < 1e-12
