"""Validated mesh files: STL (binary and ASCII), OBJ, PLY, and rows of asteroid shape models."""

import os
import re
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.data.argument_checks import checked_arguments
from spinfilters.data.argument_checks import path as path_of
from spinfilters.data.input_file import path_text, plain_number, read_bytes, require_file, value_text
from spinfilters.errors import InputError
from spinfilters.lidar.mesh import TriangleMesh, cleaned_mesh
from spinfilters.lidar.ply_files import read_ply

MAX_MESH_BYTES: Final = 1 << 30
"""Largest mesh file that is read (1 GiB): twenty million triangles of a binary STL."""
_STL_HEADER, _STL_TRIANGLE = 84, 50
_NUMBER = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)


@checked_arguments(path=path_of("a mesh"))
def read_mesh(path: str | os.PathLike[str]) -> TriangleMesh:
    """Mesh of a file of `MESH_SUFFIXES`, in its own unit.

    Triangles without area are left out and remarked upon.

    Raises
    ------
    InputError: missing, too large, truncated, of another format, a coordinate that is not finite, no triangle of positive area.
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
    told = int.from_bytes(data[80:84], "little") if len(data) >= _STL_HEADER else -1
    if told >= 0 and len(data) == _STL_HEADER + _STL_TRIANGLE * told:
        return _binary_stl(data, told)
    if data.lstrip()[:5].lower() == b"solid" and b"facet" in data[:4096].lower() + data[-4096:].lower():
        return _ascii_stl(path, data)
    if told < 0:
        raise InputError(f"{path_text(path)}: has {len(data)} bytes, too few for an STL; export it again")
    held = (len(data) - _STL_HEADER) // _STL_TRIANGLE
    raise InputError(
        f"{path_text(path)}: its header tells {told} triangles, its size is that of {held}: truncated or damaged; export it again"
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
        values = np.array([[plain_number(word) for word in vertex] for vertex in vertices])
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
                x, y, z = map(plain_number, words[1:4])
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
        vertices = np.array([[plain_number(word) for word in row] for row in rows[:count]])
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
