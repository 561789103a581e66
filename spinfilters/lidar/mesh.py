"""Triangle meshes: checked, read from files, and the mass properties of the body that they enclose."""

import os
import re
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.errors import InputError
from spinfilters.io.argument_checks import checked_arguments, one_of
from spinfilters.io.argument_checks import path as path_of
from spinfilters.io.input_file import parse_number, path_text, read_bytes, require_file, value_text
from spinfilters.io.ply_files import read_ply

SMALLEST_AREA: Final = 1e-14
"""Area below which a triangle is degenerate, per square of its longest edge."""
LARGEST_COORDINATE: Final = 1e12
"""m: beyond, a coordinate is no length of a body, and squares lose their meaning."""


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Vertices in m and triangles whose vertices run counterclockwise seen from outside.

    Parameters
    ----------
    vertices : ndarray of shape (v, 3)
        m.
    triangles : ndarray of shape (f, 3)
        Indices of vertices.
    name : str
        How messages name it.
    remarks : tuple[str, ...]
        What its reader left out, in words.

    Raises
    ------
    InputError
        No triangle, an index without a vertex, a coordinate that is not finite.
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


def _signed_volume(mesh: TriangleMesh) -> float:
    """Volume of a closed mesh, m^3; negative where its normals point inward."""
    a, b, c = np.moveaxis(mesh.corners - mesh.vertices.mean(axis=0), 1, 0)
    return float(np.einsum("fi,fi->", a, np.cross(b, c))) / 6


def cleaned_mesh(
    vertices: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "f 3"], name: str
) -> TriangleMesh:
    """The mesh without degenerate triangles, with equal vertices joined and outward faces; its remarks say what was found.

    Raises
    ------
    InputError
        As `TriangleMesh`.
    """
    raw = TriangleMesh(vertices, triangles, name)
    points, same = np.unique(raw.vertices, axis=0, return_inverse=True)
    joined = same.reshape(-1)[raw.triangles]
    kept = ~_degenerate(points[joined])
    remarks = []
    if not kept.all():
        remarks.append(f"{np.count_nonzero(~kept)} of {len(kept)} triangles have no area and are left out")
    mesh = TriangleMesh(points, joined[kept], name)
    if mesh.is_watertight and _signed_volume(mesh) < 0:
        remarks.append("its faces look inward and are turned around")
        mesh = TriangleMesh(points, joined[kept][:, ::-1], name)
    if not mesh.is_watertight:
        remarks.append(
            f"not watertight: {mesh.open_edges} edges do not join two triangles; both sides are seen"
        )
    return TriangleMesh(points, mesh.triangles, name, tuple(remarks))


def box(sides: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> TriangleMesh:
    """A box about the origin with sides in m along x, y, z; by default the unit cube of the thesis."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [(a, b, c) for a, b, c, _ in faces] + [(a, c, d) for a, _, c, d in faces]
    return TriangleMesh(corners * np.array(sides), np.array(triangles), "a box")


def _degenerate(corners: Float[np.ndarray, "f 3 3"]) -> Bool[np.ndarray, " f"]:
    edges = np.roll(corners, -1, axis=1) - corners
    longest = np.sum(edges**2, axis=2).max(axis=1)
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    return ~(area > SMALLEST_AREA * longest)


MAX_MESH_BYTES: Final = 1 << 30
"""Largest mesh file that is read (1 GiB): twenty million triangles of a binary STL."""
_STL_HEADER, _STL_TRIANGLE = 84, 50
_NUMBER = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)


@checked_arguments(path=path_of("a mesh"))
def read_mesh(path: str | os.PathLike[str]) -> TriangleMesh:
    """Mesh of a file of `MESH_SUFFIXES`, in its own unit; triangles without area are left out with a remark.

    Parameters
    ----------
    path : str or os.PathLike[str]
        The file.

    Returns
    -------
    TriangleMesh
        Vertices and triangles.

    Raises
    ------
    InputError
        Missing, too large, truncated, of another format, a coordinate that is not finite, no triangle of
        positive area.
    """
    path = Path(path)
    require_file(path, MAX_MESH_BYTES)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(
            f"{path_text(path)}: {value_text(path.suffix)} is no known kind of mesh; give a {', '.join(MESH_SUFFIXES)}"
        )
    vertices, triangles = reader(path)
    return cleaned_mesh(vertices, triangles, path_text(path))


_Surface = tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]


def _read_stl(path: Path) -> _Surface:
    data = read_bytes(path, MAX_MESH_BYTES)
    stated = int.from_bytes(data[80:84], "little") if len(data) >= _STL_HEADER else -1
    if stated >= 0 and len(data) == _STL_HEADER + _STL_TRIANGLE * stated:
        return _binary_stl(data, stated)
    if data.lstrip()[:5].lower() == b"solid" and b"facet" in data[:4096].lower() + data[-4096:].lower():
        return _ascii_stl(path, data)
    if stated < 0:
        raise InputError(f"{path_text(path)}: has {len(data)} bytes, too few for an STL; export it again")
    held = (len(data) - _STL_HEADER) // _STL_TRIANGLE
    raise InputError(
        f"{path_text(path)}: its header states {stated} triangles, its size is that of {held}: truncated or damaged; "
        "export it again"
    )


def _binary_stl(data: bytes, count: int) -> _Surface:
    """Little-endian facets: normal, three vertices (float32), two bytes of attributes."""
    layout = np.dtype([("normal", "<f4", 3), ("vertices", "<f4", (3, 3)), ("attribute", "<u2")])
    facets = np.frombuffer(data, layout, count, _STL_HEADER)
    return facets["vertices"].astype(np.float64).reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)


def _ascii_stl(path: Path, data: bytes) -> _Surface:
    text = data.lower()
    opened, closed = text.count(b"facet normal"), text.count(b"endfacet")
    vertices = _NUMBER.findall(data)
    if b"endsolid" not in text or opened != closed or len(vertices) != 3 * opened:
        raise InputError(
            f"{path_text(path)}: {opened} facets begin, {closed} end, with {len(vertices)} vertices: truncated; export it again"
        )
    try:
        values = np.array([[parse_number(word) for word in vertex] for vertex in vertices])
    except ValueError:
        raise InputError(f"{path_text(path)}: a vertex is no number; export it again") from None
    return values.reshape(-1, 3), np.arange(len(values)).reshape(-1, 3)


def _read_obj(path: Path, first: int = 1) -> _Surface:
    """Triangles of OBJ lines ``v x y z`` and ``f a b c ...``.

    Indices from ``first``, or from the end where negative; polygons become fans. Vertices may come after the faces that name them.
    """
    vertices: list[list[float]] = []
    triangles: list[tuple[int, int, int]] = []
    for number, line in enumerate(
        read_bytes(path, MAX_MESH_BYTES).decode("utf-8", "replace").splitlines(), 1
    ):
        words = line.split()
        try:
            if words[:1] == ["v"]:
                x, y, z = map(parse_number, words[1:4])
                vertices.append([x, y, z])
            elif words[:1] == ["f"]:
                corners = [_obj_index(word, len(vertices), first) for word in words[1:]]
                triangles += [(corners[0], b, c) for b, c in pairwise(corners[1:])]
        except (ValueError, IndexError):
            raise InputError(
                f"{path_text(path)}: line {number}: {value_text(line.strip())} is no vertex or face; export it again"
            ) from None
    faces = np.array(triangles, dtype=np.int64).reshape(-1, 3)
    beyond = faces[faces >= len(vertices)]
    if beyond.size:
        raise InputError(
            f"{path_text(path)}: a face names vertex {beyond[0] + first}, the file has {len(vertices)} from {first} on; "
            "export it again"
        )
    return np.array(vertices).reshape(-1, 3), faces


def _obj_index(word: str, count: int, first: int) -> int:
    index = int(word.split("/", 1)[0])
    place = index - first if index >= first else count + index
    if not 0 <= place < MAX_MESH_BYTES or (
        index < first and index >= 0
    ):  # of as many bytes, no file holds more
        raise IndexError(word)
    return place


def _read_tab(path: Path) -> _Surface:
    """Rows as of an OBJ, whose indices begin at 0 where a face says so."""
    return _read_obj(
        path, 0 if re.search(rb"^f(\s+\d+)*\s+0\s", read_bytes(path, MAX_MESH_BYTES), re.MULTILINE) else 1
    )


def _read_counted(path: Path) -> _Surface:
    """A line with the numbers of vertices and faces, then their rows; indices from 1."""
    head, *lines = read_bytes(path, MAX_MESH_BYTES).decode("utf-8", "replace").splitlines()
    try:
        count, faces = (int(word) for word in head.split())
        if not 0 < count <= len(lines) or not 0 < faces <= len(lines) - count:
            raise ValueError(f"{count} vertices and {faces} faces in {len(lines)} lines")
        rows = [line.split() for line in lines[: count + faces]]
        vertices = np.array([[parse_number(word) for word in row] for row in rows[:count]])
        corners = [[int(word) for word in row] for row in rows[count:]]
        if any(not 1 <= corner <= count for row in corners for corner in row):
            raise ValueError("a face names a vertex that is not there")
        return vertices.reshape(count, 3), np.array(corners, dtype=np.int64).reshape(faces, 3) - 1
    except ValueError:
        raise InputError(
            f"{path_text(path)}: is no table of vertices and faces below their numbers; export it again"
        ) from None


def _read_ply_mesh(path: Path) -> _Surface:
    content = read_ply(path)
    if not len(content.triangles):
        raise InputError(f"{path_text(path)}: holds points but no faces: a scan, not a mesh; give a mesh")
    return content.points, content.triangles


_READERS: Final = {
    ".stl": _read_stl,
    ".obj": _read_obj,
    ".ply": _read_ply_mesh,
    ".tab": _read_tab,
    ".txt": _read_counted,
}
MESH_SUFFIXES: Final = tuple(_READERS)


@dataclass(frozen=True, eq=False)
class MassProperties:
    """Mass properties for density one, in mesh axes.

    Attributes
    ----------
    volume : float
        m^3.
    center_of_mass : ndarray of shape (3,)
        m.
    inertia : ndarray of shape (3, 3)
        About the centre of mass, m^5 (times the density, kg/m^3: kg m^2).
    principal_moments : ndarray of shape (3,)
        Ascending, m^5.
    principal_axes : ndarray of shape (3, 3)
        Rows, right-handed.
    """

    volume: float
    center_of_mass: Float[np.ndarray, "3"]
    inertia: Float[np.ndarray, "3 3"]
    principal_moments: Float[np.ndarray, "3"]
    principal_axes: Float[np.ndarray, "3 3"]


@checked_arguments(mesh=one_of(TriangleMesh, cure="a mesh, such as spinfilters.read_mesh gives"))
def mass_properties(mesh: TriangleMesh) -> MassProperties:
    """Mass properties by the divergence theorem: signed tetrahedra from the mesh's middle to every triangle.

    A tetrahedron (0, a, b, c) of volume V has the first moment V (a + b + c) / 4 and the second moment
    V / 20 (s s' + a a' + b b' + c c') with s = a + b + c.

    Parameters
    ----------
    mesh : TriangleMesh
        Watertight, its normals outward.

    Returns
    -------
    MassProperties
        Volume, centre, and second moments and inertia of a body of density one.

    Raises
    ------
    InputError
        a mesh that is not watertight, or inside out.
    """
    if not mesh.is_watertight:
        raise InputError(
            f"{mesh.name}: {mesh.open_edges} edges do not join two triangles, so it has no volume; close the mesh"
        )
    middle = mesh.vertices.mean(axis=0)
    corners = mesh.corners - middle
    volumes = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    volume = float(volumes.sum())
    if not volume > 0:
        raise InputError(
            f"{mesh.name}: its volume is {volume:.3g} m^3, so its normals point inwards; turn them"
        )
    total = corners.sum(axis=1)
    center = volumes @ total / (4 * volume)
    second = np.einsum("f,fi,fj->ij", volumes, total, total)
    second += np.einsum("f,fki,fkj->ij", volumes, corners, corners)
    second = second / 20 - volume * np.outer(center, center)
    inertia = np.trace(second) * np.eye(3) - second
    moments, axes = np.linalg.eigh(inertia)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    return MassProperties(volume, center + middle, inertia, moments, axes.T)
