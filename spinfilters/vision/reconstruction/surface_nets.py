"""Surface of a signed distance field as a mesh: surface nets (Gibson 1998).

A cell of eight voxels with both signs has one vertex, the mean of the crossings of its edges. An edge of the grid with both
signs has one quadrilateral, of the vertices of the four cells around it.
"""

from itertools import product
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from spinfilters.vision.reconstruction.distance_volume import Field

_CORNERS = np.array(list(product((0, 1), repeat=3)))
_EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if np.abs(_CORNERS[a] - _CORNERS[b]).sum() == 1]


class NetSurface(NamedTuple):
    """Surface of a field.

    Attributes
    ----------
    vertices: (v, 3) m, principal axes.   triangles: (f, 3), anticlockwise seen from outside.   grey: (v,) 0..255.
    lowest, highest: (v, 3) m, of the crossings of which each vertex is the mean: so far corners of the surface reach.
    """

    vertices: Float[np.ndarray, "v 3"]
    triangles: Int[np.ndarray, "f 3"]
    grey: Float[np.ndarray, " v"]
    lowest: Float[np.ndarray, "v 3"]
    highest: Float[np.ndarray, "v 3"]

    @property
    def extents(self) -> Float[np.ndarray, " 3"]:
        """Along the axes, m."""
        return self.highest.max(axis=0) - self.lowest.min(axis=0)


def surface_of(field: Field) -> NetSurface:
    """Surface where the distance is zero."""
    cells = _crossed_cells(field.distance)
    values = field.distance[tuple((cells[:, None] + _CORNERS).transpose(2, 0, 1))]
    places = [field.grid.places(cells + within) for within in _within(values)]
    number = np.full(np.array(field.distance.shape) - 1, -1)
    number[tuple(cells.T)] = np.arange(len(cells))
    near = field.grey[tuple((cells[:, None] + _CORNERS).transpose(2, 0, 1))]
    weight = 1 / (np.abs(values) + 1e-2 * field.grid.voxel)
    grey = (near * weight).sum(axis=1) / weight.sum(axis=1)
    return NetSurface(places[0], _triangles(field.distance, number), grey, places[1], places[2])


def _crossed_cells(distance: Float[np.ndarray, "n n n"]) -> Int[np.ndarray, "k 3"]:
    """Least corner of each cell that has both signs and no unknown corner."""
    corners = [distance[tuple(slice(o, len(distance) - 1 + o) for o in corner)] for corner in _CORNERS]
    low, high = corners[0].copy(), corners[0].copy()
    for each in corners[1:]:  # NaN is passed on
        np.minimum(low, each, out=low)
        np.maximum(high, each, out=high)
    return np.argwhere((low < 0) & (high >= 0))


def _within(
    values: Float[np.ndarray, "k 8"],
) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3"]]:
    """Mean, least and largest edge crossing of a cell, voxels from its least corner."""
    sums, count = np.zeros((len(values), 3)), np.zeros(len(values))
    lowest, highest = np.ones((len(values), 3)), np.zeros((len(values), 3))
    for a, b in _EDGES:
        crossed = (values[:, a] < 0) != (values[:, b] < 0)
        share = np.where(crossed, values[:, a] / np.where(crossed, values[:, a] - values[:, b], 1.0), 0.0)
        at, there = _CORNERS[a] + share[:, None] * (_CORNERS[b] - _CORNERS[a]), crossed[:, None]
        sums += there * at
        lowest = np.where(there, np.minimum(lowest, at), lowest)
        highest = np.where(there, np.maximum(highest, at), highest)
        count += crossed
    return sums / count[:, None], lowest, highest


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
