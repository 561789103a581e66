"""Surface of a signed distance field as a mesh: surface nets (Gibson 1998).

A cell of eight voxels with both signs has one vertex, the mean of the crossings of its edges. An edge of the grid with both
signs has one quadrilateral, of the vertices of the four cells around it.
"""

from itertools import product

import numpy as np
from jaxtyping import Float, Int

from spinfilters.vision.reconstruction.distance_volume import Field

_CORNERS = np.array(list(product((0, 1), repeat=3)))
_EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if np.abs(_CORNERS[a] - _CORNERS[b]).sum() == 1]


def surface_of(
    field: Field,
) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"], Float[np.ndarray, " v"]]:
    """Vertices (m, principal axes), triangles and grey values of a surface.

    Triangles run anticlockwise seen from outside.
    """
    cells = _crossed_cells(field.distance)
    values = field.distance[tuple((cells[:, None] + _CORNERS).transpose(2, 0, 1))]
    vertices = field.grid.places(cells + _within(values))
    number = np.full(np.array(field.distance.shape) - 1, -1)
    number[tuple(cells.T)] = np.arange(len(cells))
    near = field.grey[tuple((cells[:, None] + _CORNERS).transpose(2, 0, 1))]
    weight = 1 / (np.abs(values) + 1e-2 * field.grid.voxel)
    grey = (near * weight).sum(axis=1) / weight.sum(axis=1)
    return vertices, _triangles(field.distance, number), grey


def _crossed_cells(distance: Float[np.ndarray, "n n n"]) -> Int[np.ndarray, "k 3"]:
    """Least corner of each cell that has both signs and no unknown corner."""
    corners = [distance[tuple(slice(o, len(distance) - 1 + o) for o in corner)] for corner in _CORNERS]
    low, high = corners[0].copy(), corners[0].copy()
    for each in corners[1:]:  # NaN is passed on
        np.minimum(low, each, out=low)
        np.maximum(high, each, out=high)
    return np.argwhere((low < 0) & (high >= 0))


def _within(values: Float[np.ndarray, "k 8"]) -> Float[np.ndarray, "k 3"]:
    """Mean of the crossings of the edges of a cell, in voxels from its least corner."""
    sums, count = np.zeros((len(values), 3)), np.zeros(len(values))
    for a, b in _EDGES:
        crossed = (values[:, a] < 0) != (values[:, b] < 0)
        share = np.where(crossed, values[:, a] / np.where(crossed, values[:, a] - values[:, b], 1.0), 0.0)
        sums += crossed[:, None] * (_CORNERS[a] + share[:, None] * (_CORNERS[b] - _CORNERS[a]))
        count += crossed
    return sums / count[:, None]


def _triangles(
    distance: Float[np.ndarray, "n n n"], number: Int[np.ndarray, "m m m"]
) -> Int[np.ndarray, "f 3"]:
    """Two triangles for each grid edge that crosses the surface.

    Its ends differ in sign; out of the four cells around it.
    """
    found = []
    for axis in range(3):
        second, third = (axis + 1) % 3, (axis + 2) % 3
        end = [slice(None)] * 3
        end[axis] = slice(1, None)
        begin = [slice(None)] * 3
        begin[axis] = slice(0, -1)
        first, last = distance[tuple(begin)], distance[tuple(end)]
        edges = np.argwhere(((first < 0) & (last >= 0)) | ((first >= 0) & (last < 0)))
        edges = edges[(edges[:, [second, third]] > 0).all(axis=1)]
        edges = edges[(edges[:, [second, third]] < len(distance) - 1).all(axis=1)]
        outward = first[tuple(edges.T)] < 0
        ring = []
        for back_second, back_third in ((0, 0), (1, 0), (1, 1), (0, 1)):
            cell = edges.copy()
            cell[:, second] -= back_second
            cell[:, third] -= back_third
            ring.append(number[tuple(cell.T)])
        quads = np.stack(ring, axis=1)
        quads[~outward] = quads[~outward][:, ::-1]
        quads = quads[(quads >= 0).all(axis=1)]
        found += [quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]
    return np.concatenate(found)
