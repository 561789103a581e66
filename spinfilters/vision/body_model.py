"""Dense model of the body: signed distances fused from depth maps, and their surface as a mesh (surface nets).

The principal axes are themselves estimated. Moments that nearly agree leave their axes hardly determined, and with them any
extent along the true axes; the extent along the axes as estimated is not touched by that. Both deviations are kept.

Depth maps are fused on a grid along the principal axes (Curless and Levoy 1996). Each depth map gives, at voxels before and
shortly behind what it sees, the distance along the ray; means are weighted by the inverse variance of the depth. Sums are kept
by groups of epochs, so that leaving out a group shows how certain the surface is.

A cell of eight voxels with both signs has one vertex, the mean of the crossings of its edges. An edge of the grid with both
signs has one quadrilateral, of the vertices of the four cells around it.
"""

from dataclasses import dataclass, replace
from itertools import product
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import map_coordinates
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, KDTree

from spinfilters.core.attitude_conversions import matrix_from_rotation_vector
from spinfilters.core.errors import InputError
from spinfilters.io.camera import StereoRig
from spinfilters.vision.depth_map import DepthMap

GROUPS: Final = 4
TRUNCATION_VOXELS: Final = 2.5
CLEARED_VOXELS: Final = 14.0
"""Before what a pixel sees, that are empty: that removes what a wrong disparity has put there."""
FEWEST_VIEWS: Final = 3
"""That a voxel needs to be taken for observed."""
REFERENCE_STD: Final = 1e-3
"""Of the depth, m, that has weight one."""


@dataclass(frozen=True)
class Grid:
    """Voxels of a cube around the centre of mass, in principal axes.

    Attributes
    ----------
    radius : float
        Half of the cube's side, m.
    count : int
        Voxels along each axis.
    """

    radius: float
    count: int

    @property
    def voxel(self) -> float:
        """Side of a voxel, m."""
        return 2 * self.radius / (self.count - 1)

    def places(self, indices: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Points (m, principal axes) of indices along x, y, z, which need not be whole."""
        return indices * self.voxel - self.radius


@dataclass(frozen=True)
class Field:
    """Fused distances.

    Attributes
    ----------
    distance : ndarray of shape (n, n, n)
        m, positive outside, NaN where nothing is known.
    grey : ndarray of shape (n, n, n)
        Of the surface nearby, 0..255.
    """

    grid: Grid
    distance: Float[np.ndarray, "n n n"]
    grey: Float[np.ndarray, "n n n"]

    def at(self, points: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, " k"]:
        """Distances at points (m, principal axes), NaN where a neighbouring voxel is unknown."""
        index = (points + self.grid.radius) / self.grid.voxel
        return map_coordinates(self.distance, index.T, order=1, mode="constant", cval=np.nan)

    def moved(self, outward: float) -> "Field":
        """The field of a surface that lies farther out, m."""
        return replace(self, distance=self.distance - np.float32(outward))


class DistanceVolume:
    """Sums over depth maps at the voxels of a grid.

    Attributes
    ----------
    count : int
        Of depth maps.
    """

    def __init__(self, grid: Grid) -> None:
        self.grid = grid
        self._sums = np.zeros((GROUPS, 5, grid.count**3), dtype=np.float32)
        """By group: of weights, of weighted distances; of weights near the surface, of grey values weighted alike; views."""
        self.count = 0

    def add(
        self, seen: DepthMap, rig: StereoRig, R_cp: Float[np.ndarray, "3 3"], t_cp: Float[np.ndarray, " 3"]
    ) -> None:
        """Take a depth map in; the pose of the principal axes is in the camera frame."""
        row, column = np.nonzero(np.isfinite(seen.depth))
        depth, std, grey = (values[row, column] for values in (seen.depth, seen.std, seen.grey))
        u, v = column + seen.corner[0], row + seen.corner[1]
        rays = np.stack(
            [(u - rig.left.cx) / rig.left.fx, (v - rig.left.cy) / rig.left.fy, np.ones(len(u))], axis=1
        )
        points = (depth[:, None] * rays - t_cp) @ R_cp
        rays = rays @ R_cp / np.linalg.norm(rays, axis=1, keepdims=True)
        voxel, pixel, distance = self._voxels_along_rays(points, rays)
        limit = TRUNCATION_VOXELS * self.grid.voxel
        weight = (REFERENCE_STD / std[pixel]) ** 2 * np.clip(2 + 2 * distance / limit, 0, 1)
        close = np.where(np.abs(distance) < limit / 2, weight, 0)
        sums = self._sums[self.count % GROUPS]
        for total, values in zip(
            sums, (weight, weight * np.minimum(distance, limit), close, close * grey[pixel]), strict=False
        ):
            np.add.at(total, voxel, values.astype(np.float32))
        sums[4, np.unique(voxel)] += 1
        self.count += 1

    def _voxels_along_rays(
        self, points: Float[np.ndarray, "n 3"], rays: Float[np.ndarray, "n 3"]
    ) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"], Float[np.ndarray, " k"]]:
        """Voxels along rays near their end points.

        The rows of these come with them, and the distance before them along the ray, m.
        """
        reach = np.arange(-CLEARED_VOXELS, TRUNCATION_VOXELS + 0.5) * self.grid.voxel
        passed = points[:, None] + reach[:, None] * rays[:, None]
        index = np.rint((passed + self.grid.radius) / self.grid.voxel).astype(np.int64).reshape(-1, 3)
        inside = ((index >= 0) & (index < self.grid.count)).all(axis=1)
        index, pixel = index[inside], np.repeat(np.arange(len(points)), len(reach))[inside]
        distance = np.einsum("ki,ki->k", points[pixel] - self.grid.places(index), rays[pixel])
        strides = self.grid.count ** np.arange(2, -1, -1)
        return index @ strides, pixel, distance

    def field(self, without: int | None = None) -> Field:
        """Distances of all epochs, or of all but a group."""
        groups = [group for group in range(GROUPS) if group != without]
        weight, distance, close, grey, views = self._sums[groups].sum(axis=0)
        known = np.flatnonzero((views >= FEWEST_VIEWS) & (weight > 0))
        values = np.full((2, len(views)), np.nan, dtype=np.float32)
        values[0, known] = distance[known] / weight[known]
        values[1, known] = grey[known] / np.maximum(close[known], 1e-9)
        return Field(self.grid, *values.reshape(2, *(self.grid.count,) * 3))


_CORNERS = np.array(list(product((0, 1), repeat=3)))
_EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if np.abs(_CORNERS[a] - _CORNERS[b]).sum() == 1]


class NetSurface(NamedTuple):
    """Surface of a field.

    Attributes
    ----------
    vertices : ndarray of shape (v, 3)
        m, principal axes.
    triangles : ndarray of shape (f, 3)
        Anticlockwise seen from outside.
    grey : ndarray of shape (v,)
        0..255.
    lowest, highest : ndarray of shape (v, 3)
        m, of the crossings of which each vertex is the mean: so far corners of the surface reach.
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
    places = [field.grid.places(cells + within) for within in _edge_crossings(values)]
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


def _edge_crossings(
    values: Float[np.ndarray, "k 8"],
) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3"]]:
    """Mean, least and largest edge crossing of a cell, voxels from its least corner."""
    sums, count = np.zeros((len(values), 3)), np.zeros(len(values))
    lowest, highest = np.ones((len(values), 3)), np.zeros((len(values), 3))
    for a, b in _EDGES:  # crossing at the zero of the linear interpolation between both corners
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
        # edges along this axis whose ends differ in sign, without those on the outer faces, which have fewer than four cells
        edges = np.argwhere(((first < 0) & (last >= 0)) | ((first >= 0) & (last < 0)))
        edges = edges[(edges[:, [second, third]] > 0).all(axis=1)]
        edges = edges[(edges[:, [second, third]] < len(distance) - 1).all(axis=1)]
        outward = first[tuple(edges.T)] < 0
        ring = []  # the four cells around an edge, in order about the axis
        for back_second, back_third in ((0, 0), (1, 0), (1, 1), (0, 1)):
            cell = edges.copy()
            cell[:, second] -= back_second
            cell[:, third] -= back_third
            ring.append(number[tuple(cell.T)])
        quads = np.stack(ring, axis=1)
        # reversed where the distance falls along the axis, so that all look outwards; none where a cell is unknown
        quads[~outward] = quads[~outward][:, ::-1]
        quads = quads[(quads >= 0).all(axis=1)]
        found += [quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]
    return np.concatenate(found)


AXES_DRAWN: Final = 100
NAMES: Final = "xyz"
"""Of the principal axes, moments ascending."""


@dataclass(frozen=True, eq=False)
class Dimensions:
    """Extents along the principal axes.

    Attributes
    ----------
    extents : ndarray of shape (3,)
        m, along the axes as estimated.
    surface_std : ndarray of shape (3,)
        m, of these extents, by the surface.
    rotation_std : ndarray of shape (3,)
        rad, of the axes about each axis.
    moved : ndarray of shape (3, 3)
        m, by how much a rotation by one standard deviation about axis k changes extent j, ``moved[k, j]``.
    axes_std : ndarray of shape (3,)
        m, of the extents by the axes.
    """

    extents: Float[np.ndarray, " 3"]
    surface_std: Float[np.ndarray, " 3"]
    rotation_std: Float[np.ndarray, " 3"]
    moved: Float[np.ndarray, "3 3"]
    axes_std: Float[np.ndarray, " 3"]

    @property
    def std(self) -> Float[np.ndarray, " 3"]:
        """Standard deviations (m) as extents along the true principal axes."""
        return np.hypot(self.surface_std, self.axes_std)

    @property
    def sentences(self) -> list[str]:
        """Pairs of axes whose uncertainty moves an extent by more than the surface leaves open."""
        found = []
        for k in np.flatnonzero((self.moved > self.surface_std).any(axis=1)).tolist():
            i, j = (each for each in range(3) if each != k)
            own, true = (
                f"{1e3 * std[i]:.1f} and {1e3 * std[j]:.1f} mm" for std in (self.surface_std, self.std)
            )
            found.append(
                f"axes {NAMES[i]} and {NAMES[j]} are known to {np.degrees(self.rotation_std[k]):.1f} deg about {NAMES[k]}: extents "
                f"along them are within {own} for the axes as estimated, {true} for the true ones"
            )
        return found


def dimensions_of(
    surface: NetSurface, surface_std: Float[np.ndarray, " 3"], axes_cov: Float[np.ndarray, "3 3"]
) -> Dimensions:
    """Dimensions of a surface.

    Parameters
    ----------
    surface_std : ndarray of shape (3,)
        m, of the extents along the axes as they are.
    axes_cov : ndarray of shape (3, 3)
        rad^2, of the axes' small rotation about themselves.
    """
    corners = surface.vertices[ConvexHull(surface.vertices).vertices]
    values, vectors = np.linalg.eigh(axes_cov)
    drawn = np.random.default_rng(0).standard_normal((AXES_DRAWN, 3)) * np.sqrt(np.maximum(values, 0.0))
    rotation_std = np.sqrt(np.maximum(np.diag(axes_cov), 0.0))
    straight = np.ptp(corners, axis=0)
    single = [
        _extents_along_turned_axes(corners, sign * np.diag(rotation_std)) - straight for sign in (-1, 1)
    ]
    return Dimensions(
        surface.extents,
        surface_std,
        rotation_std,
        np.abs(single).max(axis=0),
        _extents_along_turned_axes(corners, drawn @ vectors.T).std(axis=0),
    )


def _extents_along_turned_axes(
    corners: Float[np.ndarray, "v 3"], rotations: Float[np.ndarray, "s 3"]
) -> Float[np.ndarray, "s 3"]:
    """Extents along axes turned by rotation vectors, rad."""
    return np.ptp(corners @ matrix_from_rotation_vector(rotations), axis=1)


FEWEST_TRIANGLES: Final = 100
FEWEST_LANDMARKS, NEAR_VOXELS = 20, 1.0
"""Landmarks that place the surface, and how near to it they must be."""
ROUNDING_STD_VOXELS: Final = 0.25
"""Standard deviation of an extent, in voxels, by which fusion rounds or widens edges whatever the number of epochs."""


@dataclass(frozen=True, eq=False)
class BodyModel:
    """The largest connected surface.

    Attributes
    ----------
    vertices : ndarray of shape (v, 3)
        m from the centre of mass, principal axes.
    triangles : ndarray of shape (f, 3)
        Anticlockwise seen from outside.
    grey : ndarray of shape (v,)
        0..255.
    dimensions : Dimensions
        Extents along the principal axes.
    """

    vertices: Float[np.ndarray, "v 3"]
    triangles: Int[np.ndarray, "f 3"]
    grey: Float[np.ndarray, " v"]
    dimensions: Dimensions

    def share_near(self, points: Float[np.ndarray, "k 3"], distance: float) -> float:
        """Share of points (m, principal axes) that lie within a distance, m, of a vertex."""
        return float(np.mean(KDTree(self.vertices).query(points)[0] <= distance))


def body_model(
    volume: DistanceVolume,
    axes_cov: Float[np.ndarray, "3 3"] | None = None,
    landmarks: Float[np.ndarray, "k 3"] | None = None,
) -> BodyModel:
    """Model of all depth maps.

    Windows that straddle an edge put the surface a tenth of a millimetre too deep; it is moved to where the landmarks lie, whose
    patches have a slope. The variance of an extent by the surface is that of models that leave out a group of epochs each
    (jackknife), and that of rounded edges.

    Parameters
    ----------
    axes_cov : ndarray of shape (3, 3) or None
        rad^2, of the small rotation of the principal axes about themselves; None where they are exact.
    landmarks : ndarray of shape (k, 3) or None
        m, principal axes; None to leave the surface where depth puts it.

    Raises
    ------
    InputError
        The depth maps make no surface.
    """
    outward = 0.0 if landmarks is None else _depth_of_landmarks(volume, landmarks)
    surface = _largest_part(volume, outward)
    if len(surface.triangles) < FEWEST_TRIANGLES:
        raise InputError(
            f"depth of {volume.count} pair(s) makes a surface of {len(surface.triangles)} triangles; give sharper images of a "
            "textured body, or more of them"
        )
    others = np.array([_extents_without_group(volume, outward, group) for group in range(GROUPS)])
    jackknife = (GROUPS - 1) / GROUPS * ((others - others.mean(axis=0)) ** 2).sum(axis=0)
    surface_std = np.sqrt(jackknife + (ROUNDING_STD_VOXELS * volume.grid.voxel) ** 2)
    dimensions = dimensions_of(surface, surface_std, np.zeros((3, 3)) if axes_cov is None else axes_cov)
    return BodyModel(surface.vertices, surface.triangles, surface.grey, dimensions)


def _depth_of_landmarks(volume: DistanceVolume, landmarks: Float[np.ndarray, "k 3"]) -> float:
    """Median distance of landmarks outside the surface, m; zero where few are near it."""
    distance = volume.field().at(landmarks)
    near = distance[np.abs(distance) <= NEAR_VOXELS * volume.grid.voxel]
    return float(np.median(near)) if len(near) >= FEWEST_LANDMARKS else 0.0


def _extents_without_group(volume: DistanceVolume, outward: float, without: int) -> Float[np.ndarray, " 3"]:
    """Along the axes, m, without a group of epochs; NaN where they make no surface."""
    surface = _largest_part(volume, outward, without)
    return surface.extents if len(surface.vertices) else np.full(3, np.nan)


def _largest_part(volume: DistanceVolume, outward: float, without: int | None = None) -> NetSurface:
    surface = surface_of(volume.field(without).moved(outward))
    if not len(surface.triangles):
        return NetSurface(*(each[:0] for each in surface))
    ends = surface.triangles[:, [0, 1, 2]].ravel(), surface.triangles[:, [1, 2, 0]].ravel()
    links = coo_matrix((np.ones(len(ends[0])), ends), shape=(len(surface.vertices),) * 2)
    part = connected_components(links, directed=False)[1]
    kept = part == np.bincount(part).argmax()
    triangles = (np.cumsum(kept) - 1)[surface.triangles[kept[surface.triangles[:, 0]]]]
    vertices, _, grey, lowest, highest = surface
    return NetSurface(vertices[kept], triangles, grey[kept], lowest[kept], highest[kept])
