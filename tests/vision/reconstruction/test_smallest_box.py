"""Smallest box around points."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spinfilters.vision.reconstruction.smallest_box import box_near, smallest_box
from spinfilters.vision.rendering.triangle_mesh import named_mesh

SIDES = np.array([0.06, 0.1, 0.15])


def _surface(generator: np.random.Generator, noise: float) -> np.ndarray:
    """Points on the six faces of a box, in its axes."""
    points = SIDES * (generator.random((6000, 3)) - 0.5)
    face = generator.integers(0, 3, len(points))
    points[np.arange(len(points)), face] = SIDES[face] / 2 * generator.choice([-1, 1], len(points))
    return points + noise * generator.standard_normal(points.shape)


@pytest.mark.parametrize("seed", range(5))
def test_a_box_is_found_whatever_its_orientation(seed: int) -> None:
    generator = np.random.default_rng(seed)
    R = Rotation.random(random_state=seed).as_matrix()
    found = smallest_box(_surface(generator, 0.0) @ R.T)
    np.testing.assert_allclose(found.extents, SIDES, atol=2e-4)
    np.testing.assert_allclose(np.abs(found.axes @ R), np.eye(3), atol=5e-3)


def test_noise_of_the_surface_widens_the_sides_by_its_extremes_only() -> None:
    R = Rotation.from_rotvec([0.3, -0.5, 0.9]).as_matrix()
    found = smallest_box(_surface(np.random.default_rng(0), 1e-4) @ R.T)
    np.testing.assert_allclose(found.extents, SIDES + 7e-4, atol=4e-4)


@pytest.mark.parametrize("shape", ["spheres", "octahedron"])
def test_no_box_of_drawn_axes_is_smaller(shape: str) -> None:
    points = named_mesh(shape, 0.11).vertices
    found = smallest_box(points)
    for axes in Rotation.random(3000, random_state=1).as_matrix():
        assert np.ptp(points @ axes.T, axis=0).prod() > 0.999 * found.extents.prod()


def test_a_box_near_axes_stays_near_them() -> None:
    points = _surface(np.random.default_rng(0), 0.0)
    near = Rotation.from_rotvec([0.02, -0.03, 0.01]).as_matrix()
    np.testing.assert_allclose(box_near(points, near).extents, SIDES, atol=2e-4)
