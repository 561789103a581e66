"""Geometry, light and shadow of a rendered body."""

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.lidar.mesh import TriangleMesh
from spinfilters.simulation.body_view import (
    POLYHEDRA,
    Appearance,
    SurfaceTexture,
    View,
    body_image,
    corner_normals,
    named_mesh,
)

K = np.array([[100.0, 0.0, 39.5], [0.0, 100.0, 29.5], [0.0, 0.0, 1.0]])
VIEW = View(K, (60, 80), np.eye(3), np.zeros(3))
AWAY = np.array([0.0, 0.0, 1.0])


def _plate(side: float, z: float) -> tuple[np.ndarray, np.ndarray]:
    """A square that faces the camera (towards -z)."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * side / 2
    return np.column_stack([corners, np.full(4, z)]), np.array([[0, 2, 1], [0, 3, 2]])


def _plates(*plates: tuple[float, float]) -> TriangleMesh:
    vertices, faces = zip(*(_plate(*plate) for plate in plates), strict=True)
    shifted = [face + 4 * k for k, face in enumerate(faces)]
    return TriangleMesh(np.concatenate(vertices), np.concatenate(shifted))


def test_depth_of_a_plate_is_its_distance_where_its_corners_project() -> None:
    _, depth = body_image(Appearance(_plates((0.2, 0.0))), np.eye(3), AWAY, VIEW)
    rows, columns = np.nonzero(depth)
    np.testing.assert_allclose(depth[depth > 0], 1.0)
    assert (columns.min(), columns.max(), rows.min(), rows.max()) == (
        30,
        49,
        20,
        39,
    )  # 39.5 +- 10, 29.5 +- 10


def test_depth_of_a_tilted_plate_is_that_of_the_plane() -> None:
    c, s = np.cos(0.6), np.sin(0.6)
    R = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    _, depth = body_image(Appearance(_plates((0.3, 0.0))), R, AWAY, VIEW)
    rows, columns = np.nonzero(depth)
    rays = np.stack([(columns - 39.5) / 100, (rows - 29.5) / 100, np.ones(len(rows))], axis=1)
    normal = R[:, 2]
    np.testing.assert_allclose(depth[rows, columns], (normal @ AWAY) / (rays @ normal), rtol=1e-9)


def test_the_nearer_of_two_plates_is_seen() -> None:
    for order in [((0.3, 0.2), (0.1, 0.0)), ((0.1, 0.0), (0.3, 0.2))]:
        _, depth = body_image(Appearance(_plates(*order)), np.eye(3), AWAY, VIEW)
        assert depth[29, 39] == pytest.approx(1.0)
        assert depth[29, 39 + 8] == pytest.approx(1.2)


def test_a_body_behind_the_camera_is_not_seen() -> None:
    radiance, depth = body_image(Appearance(named_mesh("box", 0.1)), np.eye(3), -AWAY, VIEW)
    assert not radiance.any()
    assert not depth.any()


def test_light_follows_the_sun_and_a_dark_side_has_the_ambient_light() -> None:
    mesh, texture = _plates((0.3, 0.0)), SurfaceTexture()
    full, _ = body_image(Appearance(mesh, texture, (0, 0, -1), 0.1), np.eye(3), AWAY, VIEW)
    slant, _ = body_image(Appearance(mesh, texture, (0, np.sqrt(3), -1), 0.1), np.eye(3), AWAY, VIEW)
    dark, _ = body_image(Appearance(mesh, texture, (0, 0, 1), 0.1), np.eye(3), AWAY, VIEW)
    seen = full > 0
    np.testing.assert_allclose(slant[seen] / full[seen], 0.6 / 1.1)
    np.testing.assert_allclose(dark[seen] / full[seen], 0.1 / 1.1)


def test_a_small_plate_throws_a_hard_shadow_on_a_large_one() -> None:
    body = Appearance(_plates((0.4, 0.0), (0.06, -0.1)), SurfaceTexture(), (1.0, 0.0, -1.0), 0.1)
    alone = Appearance(_plates((0.4, 0.0)), body.texture, body.sun, 0.1)
    with_shadow, _ = body_image(body, np.eye(3), AWAY, VIEW)
    without, _ = body_image(alone, np.eye(3), AWAY, VIEW)
    row = 29
    ratio = with_shadow[row] / np.maximum(without[row], 1e-9)
    dark = np.flatnonzero((ratio > 0) & (ratio < 0.2))  # centred at x = -0.1, 0.06 m wide
    assert abs(dark.mean() - 29.5) < 1.5
    assert 5 <= len(dark) <= 7
    assert ratio[20] == pytest.approx(1.0)


def test_texture_turns_with_the_body() -> None:
    points = np.random.default_rng(0).uniform(-0.1, 0.1, (50, 3))
    texture = SurfaceTexture(3)
    np.testing.assert_array_equal(texture.albedo(points), SurfaceTexture(3).albedo(points))
    assert np.std(texture.albedo(points)) > 0.1
    assert np.abs(texture.albedo(points) - SurfaceTexture(4).albedo(points)).max() > 0.1


def test_foil_covers_about_its_share_and_shines() -> None:
    points = np.random.default_rng(0).uniform(-0.3, 0.3, (4000, 3))
    assert not SurfaceTexture(1).is_foil(points).any()
    assert 0.1 < SurfaceTexture(1, foil=0.3).is_foil(points).mean() < 0.6
    bent = SurfaceTexture(1, 0.3).crinkled(points, np.tile([0.0, 0.0, 1.0], (len(points), 1)))
    np.testing.assert_allclose(np.linalg.norm(bent, axis=1), 1.0)


@pytest.mark.parametrize("shape", POLYHEDRA)
def test_polyhedra_are_closed_and_face_outwards(shape: str) -> None:
    mesh = named_mesh(shape, 0.11)
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    areas = np.cross(b - a, c - a)
    np.testing.assert_allclose(areas.sum(axis=0), 0.0, atol=1e-12)
    assert (np.einsum("fi,fi->f", areas, a) > 0).all()
    assert np.linalg.norm(mesh.vertices, axis=1).max() == pytest.approx(0.11)


@pytest.mark.parametrize("name", ["EROS856Vert1708Fac.txt", "eros007790.tab", "bennu.stl", "ryugu_test.obj"])
def test_meshes_of_asteroids_are_closed(name: str, shared_data) -> None:
    mesh = named_mesh(str(shared_data("asteroid_shapes") / name), 0.1)
    edges = np.sort(
        np.concatenate([mesh.triangles[:, [0, 1]], mesh.triangles[:, [1, 2]], mesh.triangles[:, [2, 0]]]),
        axis=1,
    )
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    assert np.linalg.norm(corner_normals(mesh), axis=2) == pytest.approx(1.0)


@pytest.mark.parametrize(
    "text", ["v 0 0 0\nf 1 2 3\n", "nothing", "", "v a b c\n", "v 0 0 0\n" * 4 + "f 1 2 3\n" * 4]
)
def test_a_file_that_is_no_mesh_is_refused_in_one_line(text: str, tmp_path) -> None:
    path = tmp_path / "body.obj"
    path.write_text(text)
    with pytest.raises(InputError, match=r"body\.obj") as caught:
        named_mesh(str(path), 0.1)
    assert "\n" not in str(caught.value)


def test_an_unknown_shape_is_refused_with_the_known_ones() -> None:
    with pytest.raises(InputError, match="spheres, box, octahedron"):
        named_mesh("teapot", 0.1)
