"""PLY files: elements with properties, ASCII or binary, read and written."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.errors import InputError
from spinfilters.io.input_file import parse_number, path_text, read_bytes, value_text
from spinfilters.io.output_files import write_bytes

MAX_PLY_BYTES: Final = 1 << 30
"""Largest PLY that is read (1 GiB)."""
CORNERS: Final = ("vertex_indices", "vertex_index")
"""Names of the list of a face's corners."""
ASCII: Final = "="
FIRST_STRETCH: Final = 16
"""Rows that are compared with the one before them at once, at first."""
_TYPES: Final = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_ORDERS: Final = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ASCII}


@dataclass(frozen=True, eq=False)
class PlyContent:
    """Content of a PLY.

    Attributes
    ----------
    columns : dict[str, np.ndarray]
        Every property of the vertices, by name.
    triangles : Int[np.ndarray, 'f 3']
        (f, 3), polygons as fans.
    comments : tuple[str, ...]
        Without the keyword.
    """

    columns: dict[str, np.ndarray]
    triangles: Int[np.ndarray, "f 3"]
    comments: tuple[str, ...]

    @property
    def points(self) -> Float[np.ndarray, "n 3"]:
        """x, y, z of the vertices."""
        return np.stack([self.columns[axis].astype(np.float64) for axis in "xyz"], axis=1)


@dataclass(frozen=True)
class _Element:
    """An element of the header with its properties.

    Each as (name, type), or as (name, count type, item type) of a list.
    """

    name: str
    count: int
    properties: tuple[tuple[str, ...], ...]

    @property
    def is_table(self) -> bool:
        """Whether all properties are single numbers."""
        return all(len(each) == 2 for each in self.properties)

    @property
    def corners(self) -> int:
        """Index of the list of a face's corners: that of the known names, else the first one."""
        lists = [k for k, each in enumerate(self.properties) if len(each) == 3]
        return next((k for k in lists if self.properties[k][0] in CORNERS), lists[0])


def read_ply(path: Path) -> PlyContent:
    """Vertices and faces of a PLY; other elements are passed over.

    Raises
    ------
    InputError
        Missing, too large, no PLY, truncated, without x, y, z, a face that names no vertex.
    """
    data = read_bytes(path, MAX_PLY_BYTES)
    try:
        return _parse_content(data)
    except (ValueError, IndexError, KeyError, OverflowError, TypeError) as error:
        raise InputError(
            f"{path_text(path)}: is no whole PLY ({value_text(' '.join(str(error).split())[:80])}); export it again"
        ) from None


def write_ply(
    path: Path,
    columns: dict[str, np.ndarray],
    comments: tuple[str, ...],
    triangles: Int[np.ndarray, "f 3"] | None = None,
) -> None:
    """Write a binary PLY of points and triangles with float64, int32 or uint8 properties, atomically."""
    table, names = packed_columns(columns), {"f": "double", "i": "int", "u": "uchar"}
    lines = ["ply", "format binary_little_endian 1.0", *(f"comment {line}" for line in comments)]
    lines += [f"element vertex {len(table)}"]
    lines += [f"property {names[table.dtype[name].kind]} {name}" for name in columns]
    body = table.tobytes()
    if triangles is not None:
        lines += [f"element face {len(triangles)}", "property list uchar int vertex_indices"]
        faces = np.empty(len(triangles), [("count", "u1"), ("corners", "<i4", 3)])
        faces["count"], faces["corners"] = 3, triangles
        body += faces.tobytes()
    write_bytes(path, "\n".join([*lines, "end_header\n"]).encode("ascii", "replace") + body)


def packed_columns(columns: dict[str, np.ndarray]) -> np.ndarray:
    """Rows of equally long columns as records of little-endian float64, int32 and uint8."""
    kinds = {"f": "<f8", "i": "<i4", "u": "u1"}
    layout = [(name, kinds[values.dtype.kind]) for name, values in columns.items()]
    table = np.empty(len(next(iter(columns.values()))), layout)
    for name, values in columns.items():
        table[name] = values
    return table


def _parse_content(data: bytes) -> PlyContent:
    order, elements, comments, start = _header(data)
    source = _AsciiRows(data[start:]) if order == ASCII else _BinaryRows(data, start, order)
    columns: dict[str, np.ndarray] = {}
    triangles = np.zeros((0, 3), np.int64)
    for element in elements:
        if element.is_table:
            table = source.table(element)
            columns = table if element.name == "vertex" else columns
        else:
            polygons = source.lists(element)
            triangles = _fans(polygons) if element.name == "face" else triangles
    if any(axis not in columns for axis in "xyz"):
        raise ValueError("no vertices with x, y, z")
    if len(triangles) and (triangles.min() < 0 or triangles.max() >= len(columns["x"])):
        raise ValueError("a face names a vertex that is not there")
    return PlyContent(columns, triangles, comments)


def _header(data: bytes) -> tuple[str, list[_Element], tuple[str, ...], int]:
    """Byte order, elements, comments and where the body begins."""
    end = data.find(b"end_header", 0, 1 << 20)
    if not data.startswith(b"ply") or end < 0:
        raise ValueError("no header")
    body = data.index(b"\n", end) + 1
    order, elements, comments = "", [], []
    for line in data[:end].decode("ascii", "replace").splitlines():
        word, _, rest = line.strip().partition(" ")
        words = rest.split()
        if word == "format":
            order = _ORDERS[words[0]]
        elif word == "comment":
            comments.append(rest)
        elif word == "element":
            count = int(words[1])
            if not 0 <= count <= len(data):
                raise ValueError(f"{count} {words[0]} cannot be in {len(data)} bytes")
            elements.append(_Element(words[0], count, ()))
        elif word == "property":
            kind = (
                (words[3], _TYPES[words[1]], _TYPES[words[2]])
                if words[0] == "list"
                else (words[1], _TYPES[words[0]])
            )
            last = elements[-1]
            elements[-1] = _Element(last.name, last.count, (*last.properties, kind))
    if not order:
        raise ValueError("no line that names the format")
    for element in elements:
        names = [each[0] for each in element.properties]
        if len(set(names)) < len(names):
            raise ValueError(f"{element.name} has a property twice")
    return order, elements, tuple(comments), body


def _fans(polygons: list[np.ndarray]) -> Int[np.ndarray, "f 3"]:
    """Triangles of polygons, given in blocks (rows, corners) of equally many corners each."""
    fans = [_fan(block) for block in polygons if block.shape[1] > 2]
    return np.concatenate(fans).astype(np.int64) if fans else np.zeros((0, 3), np.int64)


def _fan(block: np.ndarray) -> np.ndarray:
    first = np.broadcast_to(block[:, :1], (len(block), block.shape[1] - 2))
    return np.stack([first, block[:, 1:-1], block[:, 2:]], axis=2).reshape(-1, 3)


class _AsciiRows:
    """Lines of an ASCII body that are not blank, taken in order."""

    def __init__(self, body: bytes) -> None:
        self._lines, self._at = [line for line in body.splitlines() if line.strip()], 0

    def _take(self, count: int) -> list[bytes]:
        lines = self._lines[self._at : self._at + count]
        self._at += count
        if len(lines) < count:
            raise ValueError("fewer lines than the header announces")
        return lines

    def table(self, element: _Element) -> dict[str, np.ndarray]:
        """Columns of an element of single numbers, by name."""
        words = b" ".join(self._take(element.count)).split()
        values = np.fromiter(map(parse_number, words), np.float64, len(words))
        values = values.reshape(element.count, len(element.properties))
        return {each[0]: values[:, k] for k, each in enumerate(element.properties)}

    def lists(self, element: _Element) -> list[np.ndarray]:
        """Corners of each row, as a block of its own."""
        return [self._list(line.split(), element)[None] for line in self._take(element.count)]

    def _list(self, words: list[bytes], element: _Element) -> np.ndarray:
        at, kept = 0, np.zeros(0, np.int64)
        for k, kinds in enumerate(element.properties):
            size = 1
            if len(kinds) == 3:
                size, at = _whole(words[at]), at + 1
            if not 0 <= size <= len(words) - at:
                raise ValueError(f"a list of {size} numbers in a row of {len(words)}")
            if k == element.corners:
                kept = np.array([_whole(word) for word in words[at : at + size]], dtype=np.int64)
            at += size
        if at != len(words):
            raise ValueError(f"a row of {len(words)} numbers, expected {at}")
        return kept


def _whole(word: bytes) -> int:
    number = parse_number(word)
    if not number.is_integer():
        raise ValueError(f"{value_text(word)} is no whole number")
    return int(number)


class _BinaryRows:
    """Records of a binary body, taken in order."""

    def __init__(self, data: bytes, start: int, order: str) -> None:
        self._data, self._at, self._order = data, start, order

    def _take(self, layout: np.dtype, count: int) -> np.ndarray:
        if not 0 <= count * layout.itemsize <= len(self._data) - self._at:
            raise ValueError(f"{count} numbers do not fit in {len(self._data) - self._at} bytes")
        taken = np.frombuffer(self._data, layout, count, self._at) if count else np.empty(0, layout)
        self._at += count * layout.itemsize
        return taken

    def table(self, element: _Element) -> dict[str, np.ndarray]:
        """Columns of an element of single numbers, by name."""
        layout = np.dtype([(name, self._order + kind) for name, kind in element.properties])
        rows = self._take(layout, element.count)
        return {name: rows[name] for name, _ in element.properties}

    def lists(self, element: _Element) -> list[np.ndarray]:
        """Corners of all rows, in blocks (rows, corners) of neighbours that have equally many."""
        types = [tuple(np.dtype(self._order + kind) for kind in each[1:]) for each in element.properties]
        blocks, left = [], element.count
        while left:
            rows = self._take_equal(self._next_row(types), left)
            blocks.append(rows[f"items {element.corners}"])
            _require_indices(blocks[-1])
            left -= len(rows)
        return blocks

    def _next_row(self, types: list[tuple[np.dtype, ...]]) -> np.dtype:
        """Layout of the next row, by the lengths that its lists state; it is not taken yet."""
        begin, fields = self._at, []
        for k, kinds in enumerate(types):
            size = 1
            if len(kinds) == 2:
                size = int(self._take(kinds[0], 1)[0])
                fields.append((f"length {k}", kinds[0]))
            self._take(kinds[-1], size)  # a length below zero, or beyond the end, is refused here
            fields.append((f"items {k}", kinds[-1], (size,)))
        self._at = begin
        return np.dtype(fields)

    def _take_equal(self, layout: np.dtype, most: int) -> np.ndarray:
        """The next rows, as many as follow with the lengths of the first.

        Stretches double, so that a file of equal rows is looked through once, and one of unequal rows not again and again.
        """
        lengths = [name for name in layout.names or () if name.startswith("length")]
        most = min(most, (len(self._data) - self._at) // layout.itemsize)
        first = np.frombuffer(self._data, layout, 1, self._at)
        found, stretch = 1, FIRST_STRETCH
        while found < most:
            begin = self._at + found * layout.itemsize
            rows = np.frombuffer(self._data, layout, min(stretch, most - found), begin)
            same = np.logical_and.reduce([rows[name] == first[name] for name in lengths])
            if not same.all():
                found += int(same.argmin())
                break
            found, stretch = found + len(rows), 2 * stretch
        return self._take(layout, found)


def _require_indices(items: np.ndarray) -> None:
    """ValueError: an index that is no whole number, or beyond all vertices."""
    if items.dtype.kind == "f" and not (np.isfinite(items).all() and (items == np.round(items)).all()):
        raise ValueError("a face names a vertex by a number that is not whole")
    if items.size and float(np.abs(items.astype(np.float64)).max()) > MAX_PLY_BYTES:
        raise ValueError("a face names a vertex that is not there")
