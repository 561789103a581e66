"""Triangle mesh: validated vertices and triangles, and remarks on defects."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.errors import InputError

SMALLEST_AREA: Final = 1e-14
"""Area below which a triangle is degenerate, per square of its longest edge."""
LARGEST_COORDINATE: Final = 1e12
"""m: beyond, a coordinate is no length of a body, and squares lose their meaning."""


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Vertices in m and triangles whose vertices run counterclockwise seen from outside.

    Parameters
    ----------
    vertices: (v, 3) m.   triangles: (f, 3) indices of vertices.
    name: how messages name it.   remarks: what its reader left out, in words.

    Raises
    ------
    InputError: no triangle, an index without a vertex, a coordinate that is not finite.
    """

    vertices: Float[np.ndarray, "v 3"]
    triangles: Int[np.ndarray, "f 3"]
    name: str = "the mesh"
    remarks: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        vertices = np.array(self.vertices, dtype=np.float64).reshape(-1, 3)
        triangles = np.array(self.triangles, dtype=np.int64).reshape(-1, 3)
        if not len(triangles):
            raise InputError(f"{self.name}: holds no triangle of positive area; export the surface again")
        bad = np.flatnonzero(~(np.abs(vertices) <= LARGEST_COORDINATE).all(axis=1))
        if bad.size:
            raise InputError(
                f"{self.name}: vertex {bad[0]} is {vertices[bad[0]].tolist()}, not a finite place; export it again"
            )
        beyond = triangles[(triangles < 0) | (triangles >= len(vertices))]
        if beyond.size:
            raise InputError(
                f"{self.name}: a triangle names vertex {int(beyond[0])}, the vertices are 0 to {len(vertices) - 1}; export it again"
            )
        vertices.setflags(write=False)
        triangles.setflags(write=False)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "triangles", triangles)

    @cached_property
    def corners(self) -> Float[np.ndarray, "f 3 3"]:
        """Vertices of every triangle, m."""
        return self.vertices[self.triangles]

    @cached_property
    def area_vectors(self) -> Float[np.ndarray, "f 3"]:
        """Outward normals with the length of the area, m^2."""
        a, b, c = np.moveaxis(self.corners, 1, 0)
        return 0.5 * np.cross(b - a, c - a)

    @cached_property
    def normals(self) -> Float[np.ndarray, "f 3"]:
        """Outward unit normals."""
        return self.area_vectors / np.linalg.norm(self.area_vectors, axis=1, keepdims=True)

    @cached_property
    def open_edges(self) -> int:
        """Number of edges that do not join exactly two triangles of one orientation."""
        start, end = self.triangles.ravel(), np.roll(self.triangles, -1, axis=1).ravel()
        count = len(self.vertices)
        _, pair = np.unique(np.minimum(start, end) * count + np.maximum(start, end), return_inverse=True)
        used = np.bincount(pair)
        balance = np.bincount(pair, weights=np.where(start < end, 1.0, -1.0))
        return int(np.count_nonzero((used != 2) | (balance != 0)))

    @property
    def is_watertight(self) -> bool:
        """Whether every edge joins exactly two triangles of one orientation."""
        return self.open_edges == 0

    @cached_property
    def radius(self) -> float:
        """Largest distance of a vertex from the origin of the mesh, m."""
        return float(np.linalg.norm(self.vertices, axis=1).max())

    def scaled(self, factor: float) -> "TriangleMesh":
        """The mesh in another unit of length."""
        return TriangleMesh(self.vertices * factor, self.triangles, self.name, self.remarks)

    def moved(
        self, rotation: Float[np.ndarray, "3 3"], translation: Float[np.ndarray, "3"]
    ) -> "TriangleMesh":
        """The mesh rotated about its origin, then translated (m)."""
        return TriangleMesh(self.vertices @ rotation.T + translation, self.triangles, self.name, self.remarks)


def cleaned_mesh(
    vertices: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "f 3"], name: str
) -> TriangleMesh:
    """The mesh without degenerate triangles, with equal vertices joined; its remarks say what was found.

    Raises
    ------
    InputError: as `TriangleMesh`.
    """
    raw = TriangleMesh(vertices, triangles, name)
    points, same = np.unique(raw.vertices, axis=0, return_inverse=True)
    joined = same.reshape(-1)[raw.triangles]
    kept = ~_degenerate(points[joined])
    remarks = []
    if not kept.all():
        remarks.append(f"{np.count_nonzero(~kept)} of {len(kept)} triangles have no area and are left out")
    mesh = TriangleMesh(points, joined[kept], name)
    if not mesh.is_watertight:
        remarks.append(
            f"not watertight: {mesh.open_edges} edges do not join two triangles; both sides are seen"
        )
    return TriangleMesh(points, joined[kept], name, tuple(remarks))


def box(sides: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> TriangleMesh:
    """A box about the origin, by default the thesis' cube.

    Sides in m along x, y, z.
    """
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [(a, b, c) for a, b, c, _ in faces] + [(a, c, d) for a, _, c, d in faces]
    return TriangleMesh(corners * np.array(sides), np.array(triangles), "a box")


def _degenerate(corners: Float[np.ndarray, "f 3 3"]) -> Bool[np.ndarray, " f"]:
    edges = np.roll(corners, -1, axis=1) - corners
    longest = np.sum(edges**2, axis=2).max(axis=1)
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    return ~(area > SMALLEST_AREA * longest)
