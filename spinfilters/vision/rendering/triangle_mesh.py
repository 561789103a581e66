"""Meshes of rendered bodies: built-in polyhedra, and files, of a given size."""

from itertools import permutations, product
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

from spinfilters.data.input_file import path_text, value_text
from spinfilters.errors import InputError
from spinfilters.lidar.mesh import TriangleMesh
from spinfilters.lidar.mesh_files import MESH_SUFFIXES, read_mesh

MOST_FACES: Final = 500_000
SMOOTH_FACES: Final = 200
"""Of a mesh with more faces the normals are interpolated between its vertices: it approximates a curved surface."""


def corner_normals(mesh: TriangleMesh) -> Float[np.ndarray, "f 3 3"]:
    """Outward unit normal at each corner of each face.

    It is that of the face, or of a smooth surface (`SMOOTH_FACES`).
    """
    if len(mesh.triangles) <= SMOOTH_FACES:
        return np.repeat(mesh.normals[:, None], 3, axis=1)
    sums = np.zeros_like(mesh.vertices)
    for corner in range(3):
        np.add.at(sums, mesh.triangles[:, corner], mesh.area_vectors)
    lengths = np.linalg.norm(sums, axis=-1, keepdims=True)
    return (sums / np.maximum(lengths, np.finfo(float).tiny))[mesh.triangles]


def named_mesh(shape: str, radius: float) -> TriangleMesh:
    """A polyhedron of `POLYHEDRA`, or the mesh of a file, centred in its bounding box.

    The farthest vertex is at ``radius`` m from the centre, and triangles face outwards.

    Raises
    ------
    InputError: no such polyhedron nor file; as `read_mesh`; too few or too many triangles.
    """
    if shape in POLYHEDRA:
        points = np.array(POLYHEDRA[shape], dtype=float)
        hull = ConvexHull(points)
        faces = hull.simplices.astype(np.int64)
        a, b, c = (points[faces[:, k]] for k in range(3))
        inward = np.einsum("fi,fi->f", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
        faces[inward] = faces[inward][:, ::-1]
        return _scaled_to(TriangleMesh(points, faces), radius)
    path = Path(shape)
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise InputError(
            f"shape {value_text(shape)} is unknown; use {', '.join(POLYHEDRA)} or a file {', '.join(MESH_SUFFIXES)}"
        )
    mesh = read_mesh(path)
    if not 4 <= len(mesh.triangles) <= MOST_FACES:
        raise InputError(
            f"{path_text(path)}: has {len(mesh.triangles)} faces; give 4 to {MOST_FACES} triangles"
        )
    volume = np.einsum("fi,fi->", mesh.corners[:, 0], mesh.area_vectors)
    return _scaled_to(mesh if volume >= 0 else TriangleMesh(mesh.vertices, mesh.triangles[:, ::-1]), radius)


def _scaled_to(mesh: TriangleMesh, radius: float) -> TriangleMesh:
    centred = mesh.vertices - (mesh.vertices.max(axis=0) + mesh.vertices.min(axis=0)) / 2
    return TriangleMesh(centred * (radius / np.linalg.norm(centred, axis=1).max()), mesh.triangles)


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
