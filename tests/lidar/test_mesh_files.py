"""Meshes are read from files of strangers, cleaned, and refused in one line."""

import struct
from pathlib import Path

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.io.ply_files import read_ply
from spinfilters.lidar.mesh import TriangleMesh, box, cleaned_mesh, mass_properties, read_mesh

SHAPES = Path(__file__).parents[3] / "shared" / "data" / "asteroid_shapes"


def binary_stl(mesh: TriangleMesh, told: int | None = None) -> bytes:
    facets = [
        struct.pack("<12fH", *n, *c.ravel(), 0) for n, c in zip(mesh.normals, mesh.corners, strict=True)
    ]
    return (
        b"solid lies".ljust(80) + struct.pack("<I", len(facets) if told is None else told) + b"".join(facets)
    )


def ascii_stl(mesh: TriangleMesh) -> bytes:
    lines = ["solid box"]
    for normal, corners in zip(mesh.normals, mesh.corners, strict=True):
        lines += [f"facet normal {' '.join(map(repr, normal.tolist()))}", "outer loop"]
        lines += [f"vertex {' '.join(map(repr, corner.tolist()))}" for corner in corners]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid box", ""]).encode()


def obj(mesh: TriangleMesh) -> bytes:
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
    lines += [f"f {a + 1}//1 {b - len(mesh.vertices)} {c + 1}/2/3" for a, b, c in mesh.triangles.tolist()]
    return "\n".join(lines).encode()


def tab(mesh: TriangleMesh) -> bytes:
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
    return "\n".join([*lines, *(f"f {a} {b} {c}" for a, b, c in mesh.triangles.tolist()), ""]).encode()


def counted(mesh: TriangleMesh) -> bytes:
    lines = [f"{len(mesh.vertices)} {len(mesh.triangles)}"]
    lines += [f"{x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
    return "\n".join([*lines, *(f"{a} {b} {c}" for a, b, c in (mesh.triangles + 1).tolist())]).encode()


def ply(mesh: TriangleMesh) -> bytes:
    head = f"ply\nformat ascii 1.0\nelement vertex {len(mesh.vertices)}\nproperty float x\nproperty float y\nproperty float z\n"
    head += f"element face {len(mesh.triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [f"{x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
    rows += [f"3 {a} {b} {c}" for a, b, c in mesh.triangles.tolist()]
    return (head + "\n".join(rows) + "\n").encode()


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.stl", binary_stl(box())),
        ("b.STL", ascii_stl(box())),
        ("c.obj", obj(box())),
        ("d.ply", ply(box())),
        ("e.tab", tab(box())),
        ("f.txt", counted(box())),
    ],
)
def test_every_format_gives_the_same_watertight_cube(name: str, content: bytes, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    mesh = read_mesh(tmp_path / name)
    assert mesh.is_watertight
    assert mesh.remarks == ()
    assert len(mesh.vertices) == 8
    np.testing.assert_allclose(mass_properties(mesh).inertia, np.eye(3) / 6, atol=1e-15)


def _lists_of(count: int) -> bytes:
    """A PLY of ten thousand faces, each of so many corners by its own word."""
    head = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 10000\nproperty list int int vertex_indices\nend_header\n"
    )
    return head.encode() + bytes(12) + count.to_bytes(4, "little", signed=True) * 10_000


@pytest.mark.parametrize("name", ["long.ply", "long.stl", "long.obj", "long.txt"])
def test_numbers_of_many_digits_are_read_to_the_last(name: str, tmp_path: Path) -> None:
    number = "0." + "0" * 70 + "2e71"
    rows = [f"{x * 1000} {y} {z}".replace("1000", number) for x, y, z in ((0, 0, 0), (1, 0, 0), (0, 1, 0))]
    header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    texts = {
        ".ply": [
            header + "element face 1\nproperty list uchar int vertex_index\nend_header",
            *rows,
            "3 0 1 2",
        ],
        ".stl": ["solid a\nfacet normal 0 0 1", *(f"vertex {row}" for row in rows), "endfacet\nendsolid"],
        ".obj": [*(f"v {row}" for row in rows), "f 1 2 3"],
        ".txt": ["3 1", *rows, "1 2 3"],
    }
    path = tmp_path / name
    path.write_text("\n".join([*texts[path.suffix], ""]))
    assert read_mesh(path).vertices.max() == 2.0


def test_a_face_with_other_numbers_before_its_corners_is_read(tmp_path: Path) -> None:
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    face = "element face 1\nproperty uchar flags\nproperty list uchar float weights\nproperty list uchar int vertex_index\n"
    path = tmp_path / "a.ply"
    path.write_text(f"{head}{face}end_header\n0 0 0\n1 0 0\n0 1 0\n7 2 0.5 0.5 3 0 1 2\n")
    assert len(read_mesh(path).triangles) == 1


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("short.stl", binary_stl(box())[:-7], "its header states 12 triangles, its size is that of 11"),
        (
            "lying.stl",
            binary_stl(box(), 4_000_000_000),
            "states 4000000000 triangles, its size is that of 12",
        ),
        ("tiny.stl", b"solid", "too few for an STL"),
        ("cut.stl", ascii_stl(box())[:-200], "truncated"),
        ("words.stl", ascii_stl(box()).replace(b"vertex 0.5", b"vertex nil", 1), "no number"),
        ("nan.stl", ascii_stl(box()).replace(b"vertex 0.5", b"vertex nan", 1), "not a finite place"),
        ("bad.obj", b"v 1 2\nf 1 2 3\n", "line 1"),
        ("far.obj", obj(box()) + b"\nf 1 2 99\n", "a face names vertex 99, the file has 8 from 1 on"),
        ("none-yet.obj", b"f 1 2 3\n", "a face names vertex 1, the file has 0 from 1 on"),
        ("none.obj", b"v 0 0 0\n", "no triangle of positive area"),
        ("flat.obj", b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "no triangle of positive area"),
        ("cut.ply", ply(box())[:-40], "no whole PLY"),
        ("cloud.ply", ply(box()).replace(b"element face 12", b"element face 0 "), "a scan, not a mesh"),
        ("big.ply", ply(box()).replace(b"element vertex 8", b"element vertex 99999999999"), "no whole PLY"),
        ("mesh.step", b"x", "no known kind of mesh"),
        ("words.txt", b"some notes\n", "no table of vertices and faces"),
        ("empty.stl", b"", "is empty"),
        ("beyond.obj", obj(box()) + b"\nf 1 2 9223372036854775808\n", "no vertex or face"),
        ("python.obj", obj(box()) + b"\nv 1_0 2 3\n", "no vertex or face"),
        ("beyond.txt", counted(box())[:-1] + b"9" * 30 + b"\n", "no table of vertices and faces"),
        ("minus.txt", b"-1 " + counted(box()), "no table of vertices and faces"),
        ("minus.ply", _lists_of(-1), "numbers do not fit in"),
        ("many.ply", _lists_of(2**31 - 1), "numbers do not fit in"),
        ("format.ply", ply(box()).replace(b"format", b"comment", 1), "names the format"),
        ("twice.ply", ply(box()).replace(b" y\n", b" x\n", 1), "property twice"),
    ],
)
def test_a_file_that_is_no_mesh_is_refused_in_one_line(
    name: str, content: bytes, says: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError) as raised:
        read_mesh(tmp_path / name)
    assert says in str(raised.value)
    assert name in str(raised.value)
    assert "\n" not in str(raised.value)


def test_triangles_without_area_are_left_out_and_remarked_upon(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_bytes(obj(box()) + b"\nf 1 1 2\n")
    mesh = read_mesh(tmp_path / "a.obj")
    assert len(mesh.triangles) == 12
    assert mesh.remarks == ("1 of 13 triangles have no area and are left out",)


def test_a_mesh_with_a_hole_is_remarked_upon_and_has_no_mass(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_bytes(obj(box()).rsplit(b"\n", 1)[0])
    mesh = read_mesh(tmp_path / "a.obj")
    assert "not watertight: 3 edges" in mesh.remarks[0]
    with pytest.raises(InputError, match="no volume"):
        mass_properties(mesh)


def test_a_mesh_inside_out_has_no_mass() -> None:
    mesh = box()
    with pytest.raises(InputError, match="inwards"):
        mass_properties(TriangleMesh(mesh.vertices, mesh.triangles[:, ::-1]))


def test_mass_properties_move_with_the_mesh() -> None:
    sides, place = np.array([1.0, 2.0, 3.0]), np.array([100.0, -50.0, 7.0])
    body = mass_properties(box((1.0, 2.0, 3.0)).moved(np.eye(3), place))
    assert body.volume == pytest.approx(6.0)
    np.testing.assert_allclose(body.center_of_mass, place, atol=1e-12)
    second = sides**2 / 12 * 6
    np.testing.assert_allclose(body.principal_moments, np.sort(second.sum() - second), rtol=1e-12)
    assert np.linalg.det(body.principal_axes) == pytest.approx(1.0)


@pytest.mark.skipif(not SHAPES.is_dir(), reason="the shapes are not beside this checkout")
def test_toutatis_has_the_published_ratios_of_moments() -> None:
    moments = mass_properties(read_mesh(SHAPES / "toutatis_from_cmod.obj")).principal_moments
    assert (moments / moments[0]).round(3).tolist() == [1.0, 2.997, 3.178]


def test_binary_faces_of_mixed_lengths_are_read_in_their_order(tmp_path: Path) -> None:
    generator = np.random.default_rng(0)
    lengths = [*[3] * 200, *generator.integers(1, 6, 100), *[4] * 77]
    faces = [generator.integers(0, 50, length).astype("<i4") for length in lengths]
    head = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 50\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar float weights\nproperty list uchar int vertex_index\nend_header\n"
    )
    rows = b"".join(
        bytes([len(face) % 3]) + bytes(4 * (len(face) % 3)) + bytes([len(face)]) + face.tobytes()
        for face in faces
    )
    path = tmp_path / "mixed.ply"
    path.write_bytes(head.encode() + bytes(600) + rows)
    expected = [(face[0], face[k], face[k + 1]) for face in faces for k in range(1, len(face) - 1)]
    assert read_ply(path).triangles.tolist() == [list(map(int, each)) for each in expected]
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(InputError, match="numbers do not fit in"):
        read_ply(path)


def test_a_closed_mesh_inside_out_is_turned_around_and_remarked_upon() -> None:
    cube = box()
    outward = cleaned_mesh(cube.vertices, cube.triangles, "cube")
    inward = cleaned_mesh(cube.vertices, cube.triangles[:, ::-1], "cube")
    assert outward.remarks == ()
    assert inward.remarks == ("its faces look inward and are turned around",)
    assert (
        np.einsum("fi,fi->f", inward.area_vectors, inward.corners.mean(axis=1) - inward.vertices.mean(axis=0))
        > 0
    ).all()
