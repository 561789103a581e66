"""Closed surface of triangles: built-in polyhedra, and meshes of files."""

import struct
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations, product
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import ConvexHull

from spinfilters.data.input_file import path_text, require_file, value_text
from spinfilters.errors import InputError

LARGEST_MESH_FILE: Final = 64_000_000
"""Bytes."""
MOST_FACES: Final = 500_000
SMOOTH_FACES: Final = 200
"""Of a mesh with more faces the normals are interpolated between its vertices: it approximates a curved surface."""


@dataclass(frozen=True)
class BodyMesh:
    """Triangles whose corners run anticlockwise seen from outside.

    Attributes
    ----------
    vertices: (v, 3) m.   faces: (f, 3) rows of the vertices.
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]

    @cached_property
    def normals(self) -> Float[np.ndarray, "f 3 3"]:
        """Outward unit normal at each corner of each face.

        It is that of the face, or of a smooth surface (`SMOOTH_FACES`).
        """
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        areas = np.cross(b - a, c - a)
        if len(self.faces) <= SMOOTH_FACES:
            return np.repeat(_unit(areas)[:, None], 3, axis=1)
        sums = np.zeros_like(self.vertices)
        for corner in range(3):
            np.add.at(sums, self.faces[:, corner], areas)
        return _unit(sums)[self.faces]

    def scaled_to(self, radius: float) -> "BodyMesh":
        """The mesh centred in its bounding box and scaled.

        The farthest vertex is at this distance from the centre, m.
        """
        centred = self.vertices - (self.vertices.max(axis=0) + self.vertices.min(axis=0)) / 2
        return BodyMesh(centred * (radius / np.linalg.norm(centred, axis=1).max()), self.faces)


def named_mesh(shape: str, radius: float) -> BodyMesh:
    """A polyhedron of `POLYHEDRA`, or the mesh of a file.

    .obj, binary .stl, or a table of vertices and faces.

    Raises
    ------
    InputError: no such polyhedron nor file, a file that is no mesh.
    """
    if shape in POLYHEDRA:
        return _convex(np.array(POLYHEDRA[shape], dtype=float)).scaled_to(radius)
    path = Path(shape)
    if path.suffix.lower() not in _READERS:
        raise InputError(
            f"shape {value_text(shape)} is unknown; use {', '.join(POLYHEDRA)} or a file {', '.join(_READERS)}"
        )
    require_file(path, LARGEST_MESH_FILE)
    try:
        vertices, faces = _READERS[path.suffix.lower()](path.read_bytes())
        mesh = BodyMesh(
            np.asarray(vertices, dtype=float).reshape(-1, 3), np.asarray(faces, dtype=np.int64).reshape(-1, 3)
        )
    except (ValueError, IndexError, struct.error):
        raise InputError(
            f"{path_text(path)}: is no mesh of triangles; give an OBJ, a binary STL or 'v'/'f' rows"
        ) from None
    _check(path, mesh)
    return _outward(mesh).scaled_to(radius)


def _check(path: Path, mesh: BodyMesh) -> None:
    count, faces = len(mesh.vertices), mesh.faces
    if not 4 <= len(faces) <= MOST_FACES or count < 4:
        raise InputError(
            f"{path_text(path)}: has {count} vertices and {len(faces)} faces; give 4 to {MOST_FACES} triangles"
        )
    if faces.min() < 0 or faces.max() >= count or not np.isfinite(mesh.vertices).all():
        raise InputError(
            f"{path_text(path)}: a face names a vertex that is not there, or a vertex is not finite; export it again"
        )
    if not np.ptp(mesh.vertices, axis=0).max() > 0:
        raise InputError(f"{path_text(path)}: all vertices are at one place; export it again")


def _outward(mesh: BodyMesh) -> BodyMesh:
    """The mesh with positive volume."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    volume = np.einsum("fi,fi->", a, np.cross(b, c))
    return mesh if volume >= 0 else BodyMesh(mesh.vertices, mesh.faces[:, ::-1])


def _convex(points: Float[np.ndarray, "v 3"]) -> BodyMesh:
    """Convex hull of points around the origin."""
    hull = ConvexHull(points)
    faces = hull.simplices.astype(np.int64)
    a, b, c = (points[faces[:, k]] for k in range(3))
    inward = np.einsum("fi,fi->f", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return BodyMesh(points, faces)


def _from_rows(data: bytes) -> tuple[list[list[float]], np.ndarray]:
    """Mesh of rows 'v x y z' and 'f a b c', polygons as fans.

    From 1, or from 0 where a row says so; OBJ's a/b/c keep the first.
    """
    vertices, faces = [], []
    for line in data.decode("utf-8", "replace").splitlines():
        words = line.split()
        if words[:1] == ["v"]:
            vertices.append([float(word) for word in words[1:4]])
        elif words[:1] == ["f"]:
            corners = [int(word.split("/")[0]) for word in words[1:]]
            faces += [[corners[0], corners[k], corners[k + 1]] for k in range(1, len(corners) - 1)]
    rows = np.array(faces)
    return vertices, rows - int(rows.min() > 0)


def _from_table(data: bytes) -> tuple[list[list[float]], list[list[int]]]:
    """A line with the numbers of vertices and faces, then the vertices, then the faces (1-based)."""
    lines = data.decode("utf-8", "replace").splitlines()
    count, number = (int(word) for word in lines[0].split())
    vertices = [[float(word) for word in line.split()] for line in lines[1 : count + 1]]
    return vertices, [
        [int(word) - 1 for word in line.split()] for line in lines[count + 1 : count + number + 1]
    ]


def _from_stl(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Binary STL; corners at one place are welded."""
    (count,) = struct.unpack_from("<I", data, 80)
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    corners = np.frombuffer(data, record, count, 84)["corners"].reshape(-1, 3)
    vertices, places = np.unique(corners, axis=0, return_inverse=True)
    return vertices, places.reshape(-1, 3)


def _unit(vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)


_READERS = {".obj": _from_rows, ".tab": _from_rows, ".txt": _from_table, ".stl": _from_stl}
_CUBE = list(product((-1.0, 1.0), repeat=3))
_TRUNCATED = sorted(
    {p for signs in product((-1, 1), repeat=2) for p in permutations((0, signs[0] * 1, signs[1] * 2))}
)
_RHOMBIC = sorted(
    {p for s in product((-1, 1), repeat=3) for p in permutations((s[0] * 1.0, s[1] * 1.0, s[2] * 2.414))}
)
POLYHEDRA: Final[dict[str, list[tuple[float, ...]]]] = {
    "spheres": _RHOMBIC,
    "box": [(1.0 * x, 0.8 * y, 0.65 * z) for x, y, z in _CUBE],
    "octahedron": [tuple(map(float, corner)) for corner in _TRUNCATED],
}
"""Vertices of convex bodies by name: a rhombicuboctahedron (18 squares, as on SPHERES), a box, a truncated octahedron."""
