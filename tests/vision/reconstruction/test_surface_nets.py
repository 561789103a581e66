"""Surfaces of signed distance fields."""

import numpy as np
import pytest

from spinfilters.vision.body_model import Field, Grid, surface_of

GRID = Grid(0.1, 33)


def _field(radius: float) -> Field:
    n = GRID.count
    places = GRID.places(np.stack(np.unravel_index(np.arange(n**3), (n, n, n)), axis=1).astype(float))
    distance = (np.linalg.norm(places, axis=1) - radius).reshape(n, n, n)
    return Field(GRID, distance, np.full((n, n, n), 100.0))


def test_the_surface_of_a_ball_is_closed_lies_on_it_and_looks_outwards() -> None:
    surface = surface_of(_field(0.07))
    vertices, triangles, grey = surface.vertices, surface.triangles, surface.grey
    assert np.linalg.norm(vertices, axis=1) == pytest.approx(0.07, abs=0.1 * GRID.voxel)
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    volume = np.einsum("fi,fi->", a, np.cross(b, c)) / 6
    assert volume == pytest.approx(4 / 3 * np.pi * 0.07**3, rel=0.02)
    assert grey == pytest.approx(100.0)


def test_what_is_unknown_has_no_surface() -> None:
    field = _field(0.07)
    field.distance[:16] = np.nan
    assert surface_of(field).vertices[:, 0].min() >= 0


def test_extents_reach_to_the_corners_that_vertices_round() -> None:
    """An octahedron of 70 mm: its corners are on the grid's lines, where edges cross the surface."""
    n = GRID.count
    places = GRID.places(np.stack(np.unravel_index(np.arange(n**3), (n, n, n)), axis=1).astype(float))
    distance = (np.abs(places).sum(axis=1) - 0.07).reshape(n, n, n) / np.sqrt(3)
    surface = surface_of(Field(GRID, distance, np.zeros((n, n, n))))
    assert surface.extents == pytest.approx(np.full(3, 0.14), abs=1e-6)
    assert (np.ptp(surface.vertices, axis=0) < 0.14 - 0.2 * GRID.voxel).all()
