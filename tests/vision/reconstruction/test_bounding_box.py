"""Smallest box around a surface."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spinfilters.vision.reconstruction.bounding_box import smallest_box
from spinfilters.vision.rendering.triangle_mesh import named_mesh


@pytest.mark.parametrize("seed", range(4))
def test_sides_do_not_depend_on_how_a_box_is_turned(seed: int) -> None:
    generator = np.random.default_rng(seed)
    points = generator.uniform(-0.5, 0.5, (3000, 3)) * [0.14, 0.11, 0.09]
    corners = named_mesh("box", 0.11).vertices
    sides = np.ptp(corners, axis=0)
    turned = (
        Rotation.from_quat(generator.standard_normal(4)).apply(np.concatenate([corners, points * 0.8])) + 3.0
    )
    np.testing.assert_allclose(smallest_box(turned), np.sort(sides)[::-1], atol=1e-5)


@pytest.mark.parametrize("shape", ["spheres", "octahedron"])
def test_a_body_with_several_smallest_boxes_has_the_same_sides_however_it_is_turned(shape: str) -> None:
    corners = named_mesh(shape, 0.11).vertices
    turned = Rotation.from_rotvec([0.4, -1.0, 0.7]).apply(corners)
    np.testing.assert_allclose(smallest_box(turned), smallest_box(corners), atol=1e-5)
    assert smallest_box(corners).prod() <= np.ptp(corners, axis=0).prod() * (1 + 1e-6)


def test_noise_of_the_surface_moves_sides_by_as_much() -> None:
    corners = named_mesh("box", 0.11).vertices
    generator = np.random.default_rng(0)
    shares = generator.dirichlet(np.ones(len(corners)) * 0.1, 20_000)
    surface = shares @ corners + 2e-4 * generator.standard_normal((20_000, 3))
    assert np.abs(smallest_box(surface) - np.sort(np.ptp(corners, axis=0))[::-1]).max() < 1.5e-3
