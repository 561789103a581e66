"""Rays against triangles: the compiled hierarchy is the brute-force reference, and leaks through no edge."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from spinfilters.core.ray_angles import unit_vectors
from spinfilters.lidar.mesh import TriangleMesh, box
from spinfilters.lidar.scan import RayPattern
from spinfilters.simulation.lidar_scanner import (
    BruteForceTracer,
    LidarSettings,
    RayTracer,
    Scanner,
    Still,
    ray_tracer,
    thesis_rotation,
)
from spinfilters.simulation.lidar_sequence import spacecraft

TracerOf = Callable[[TriangleMesh], RayTracer]


@pytest.fixture(params=["fastest", "reference"])
def tracer_of(request: pytest.FixtureRequest) -> TracerOf:
    return {"fastest": ray_tracer, "reference": BruteForceTracer}[request.param]


def rays(count: int, seed: int, distance: float) -> tuple[np.ndarray, np.ndarray]:
    """From all around towards a ball of 6 m."""
    generator = np.random.default_rng(seed)
    origins = generator.standard_normal((count, 3))
    origins *= distance / np.linalg.norm(origins, axis=1, keepdims=True)
    targets = generator.uniform(-6, 6, (count, 3))
    directions = targets - origins
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


@pytest.mark.parametrize("distance", [8.0, 500.0])
def test_the_fastest_tracer_agrees_with_brute_force(distance: float) -> None:
    mesh = spacecraft()
    origins, directions = rays(5000, 1, distance)
    fast, slow = (tracer.hits(origins, directions) for tracer in (ray_tracer(mesh), BruteForceTracer(mesh)))
    np.testing.assert_array_equal(np.isfinite(fast.distance), np.isfinite(slow.distance))
    hit = np.isfinite(slow.distance)
    assert 0.1 < hit.mean() < 0.9
    np.testing.assert_allclose(fast.distance[hit], slow.distance[hit], rtol=0, atol=1e-11)
    np.testing.assert_array_equal(fast.triangle[~hit], -1)


@pytest.mark.parametrize("side", [(3, 50), (4, 4), (33, 18), (50, 7), (101, 97)])
def test_rays_in_rows_are_traced_as_each_by_itself(side: tuple[int, int]) -> None:
    mesh, angles = spacecraft(), RayPattern((40.0, 40.0), side).directions()
    directions = unit_vectors(angles.azimuth, angles.elevation)
    origins = np.broadcast_to(np.array([-12.0, 0.3, 0.1]), directions.shape)
    order = np.random.default_rng(3).permutation(len(directions))
    together = ray_tracer(mesh).hits(origins, directions)
    mixed, slow = (
        tracer.hits(origins, directions[order]) for tracer in (ray_tracer(mesh), BruteForceTracer(mesh))
    )
    assert np.isfinite(together.distance).any()
    np.testing.assert_array_equal(together.distance[order], mixed.distance)
    np.testing.assert_allclose(together.distance[order], slow.distance, rtol=0, atol=1e-11)


def test_a_hit_lies_on_its_triangle_which_faces_the_ray(tracer_of: TracerOf) -> None:
    mesh = spacecraft()
    origins, directions = rays(2000, 2, 20.0)
    hits = tracer_of(mesh).hits(origins, directions)
    hit = hits.triangle >= 0
    points = origins[hit] + hits.distance[hit, None] * directions[hit]
    normals, corners = mesh.normals[hits.triangle[hit]], mesh.corners[hits.triangle[hit], 0]
    assert np.abs(np.einsum("ni,ni->n", points - corners, normals)).max() < 1e-12
    assert np.einsum("ni,ni->n", directions[hit], normals).max() < 0


def test_the_inside_of_a_closed_body_is_not_seen_and_that_of_an_open_one_is(tracer_of: TracerOf) -> None:
    mesh, along = box(), np.array([[1.0, 0.0, 0.0]])
    assert tracer_of(mesh).hits(np.zeros((1, 3)), along).triangle.tolist() == [-1]
    opened = TriangleMesh(mesh.vertices, mesh.triangles[:-1])
    assert tracer_of(opened).hits(np.array([[0.0, 0.1, 0.2]]), along).distance[0] == pytest.approx(0.5)


def test_what_lies_behind_is_not_seen(tracer_of: TracerOf) -> None:
    tracer: RayTracer = tracer_of(box())
    assert not np.isfinite(
        tracer.hits(np.array([[3.0, 0.1, 0.1]]), np.array([[1.0, 0.0, 0.0]])).distance
    ).any()


@pytest.mark.parametrize("z", [0, 45, 90])
@pytest.mark.parametrize("y", [0, 45, 90])
@pytest.mark.parametrize("x", [0, 45])
def test_no_ray_leaks_through_an_edge_of_a_symmetric_pose(z: int, y: int, x: int) -> None:
    distance, rotation = 3.0, thesis_rotation(z, y, x)
    pattern = RayPattern((40.0, 40.0), (121, 121))
    scanner = Scanner.of(box(), LidarSettings(pattern))
    scan = scanner.scan(Still(rotation, np.array([distance, 0.0, 0.0])), 0.0, np.random.default_rng(0))
    corners = box().vertices @ rotation.T + np.array([distance, 0.0, 0.0])
    hull = ConvexHull(corners[:, 1:] / corners[:, :1]).equations
    beams = unit_vectors(scan.azimuth, scan.elevation)
    inside = (beams[:, 1:] / beams[:, :1] @ hull[:, :2].T + hull[:, 2] < -1e-9).all(axis=1)
    assert inside.sum() > 1000
    assert scan.is_return[inside].all()
