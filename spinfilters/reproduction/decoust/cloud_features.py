"""Features of a cloud: edge and boundary points, surfaces, corner (Decoust 2008, chapter 3, section 4.1, appendices D.1 to D.7).

Edges and boundaries are found by surface variation (sections 3.1 to 3.3), surfaces as clusters of points of like normals (section
3.4). The corner, labelled edges and boundary corners follow from both (section 4.1).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, Int
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial import KDTree

UNKNOWN, SURFACE, EDGE, BOUNDARY = -1, 0, 1, 2
"""Labels of points, the thesis' own."""
SMALLEST_NEIGHBORHOOD: Final = 4
"""Points, the index point among them: any three lie in a plane."""


@dataclass(frozen=True)
class Parameters:
    """Parameters of the processing; the defaults are Table 3.2.

    Attributes
    ----------
    surface_variance: threshold of the surface variation.   chi: threshold of the boundary test.
    normal_tolerance: of the components of normals of one surface.
    edge_neighbors, boundary_neighbors: largest neighbourhoods.   clusters: of one surface, at most.
    smallest_surface: points of a surface, and of a cluster of it, at least (no figure is printed).
    edge_distance: between an edge point and its line, in spacings of the cloud (no figure is printed; this one gives Table 4.1).
    """

    surface_variance: float = 1e-5
    chi: float = 0.8
    normal_tolerance: float = 1e-3
    edge_neighbors: int = 16
    boundary_neighbors: int = 25
    clusters: int = 10
    smallest_surface: int = 5
    edge_distance: float = 1.5


@dataclass(frozen=True, eq=False)
class PointFeatures:
    """Points with what the edge search found.

    Attributes
    ----------
    label: see `EDGE`.   normal: (n, 3), of either sign, of the largest neighbourhood without an edge.   variance: its variation.
    """

    points: Float[np.ndarray, "n 3"]
    label: Int[np.ndarray, " n"]
    normal: Float[np.ndarray, "n 3"]
    variance: Float[np.ndarray, " n"]


def nearestneighbour(points: Float[np.ndarray, "n 3"], count: int) -> Int[np.ndarray, "n k"]:
    """Indices of the nearest points in ascending order of distance, the point itself first."""
    _, index = KDTree(points).query(points, min(count, len(points)))
    return np.asarray(index).reshape(len(points), -1)


def surface_variation(
    points: Float[np.ndarray, "n k 3"],
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Surface variation, eigenvalues (ascending) and normals of neighbourhoods.

    Eqs 3.1 to 3.3, corrected: a 3 x 3 scatter.
    """
    centred = points - points.mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", centred, centred) / (points.shape[1] - 1))
    values = np.maximum(values, 0.0)
    return values[:, 0] / np.maximum(values.sum(axis=1), np.finfo(float).tiny), values, vectors[:, :, 0]


def find_edge_points(points: Float[np.ndarray, "n 3"], parameters: Parameters) -> PointFeatures:
    """Edge points: the neighbour whose arrival bends the neighbourhood of a point beyond the threshold.

    A neighbourhood of the largest size that is plane makes surface points of all its members; one that is not is grown from the
    smallest, point by point. A point that is an edge in one neighbourhood stays one.
    """
    size = min(parameters.edge_neighbors, len(points))
    neighbors = nearestneighbour(points, size)
    sizes = range(min(SMALLEST_NEIGHBORHOOD, size), size + 1)
    grown = [surface_variation(points[neighbors[:, :k]]) for k in sizes]
    variation = np.stack([each[0] for each in grown], axis=1)
    bent = variation > parameters.surface_variance
    first = np.where(bent.any(axis=1), bent.argmax(axis=1), len(sizes))
    first = np.where(bent[:, -1], first, len(sizes))  # the coarse step: the whole neighbourhood is plane
    label = np.full(len(points), UNKNOWN)
    for row, step in enumerate(first):
        label[neighbors[row, : sizes[0] + step - 1 if step < len(sizes) else size]] = SURFACE
    broken = first < len(sizes)
    label[neighbors[broken, sizes[0] + first[broken] - 1]] = EDGE
    rows, last = np.arange(len(points)), np.clip(first - 1, 0, len(sizes) - 1)
    normal = np.stack([each[2] for each in grown], axis=1)[rows, last]
    return PointFeatures(points, label, normal, variation[rows, last])


def find_bndry_points(features: PointFeatures, parameters: Parameters) -> PointFeatures:
    """Boundary points, far from the centroid of their neighbourhood.

    The neighbourhood is in its own ellipse (Eqs 3.4 to 3.7), then comes the clean-up. A boundary point whose nearest
    neighbour is an edge point becomes unknown (section 3.3.1; appendix D.3 makes it an edge point).
    """
    points = features.points
    neighbors = nearestneighbour(points, parameters.boundary_neighbors)
    around = points[neighbors]
    centred = around - around.mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", centred, centred) / (around.shape[1] - 1))
    e = np.einsum("ni,nij->nj", centred[:, 0], vectors[:, :, 1:])
    chi = np.sqrt(np.sum(e**2 / np.maximum(values[:, 1:], np.finfo(float).tiny), axis=1))
    label = features.label.copy()
    label[(label != EDGE) & (chi > parameters.chi)] = BOUNDARY
    if neighbors.shape[1] > 1:
        label[(label == BOUNDARY) & (label[neighbors[:, 1]] == EDGE)] = UNKNOWN
    return PointFeatures(points, label, features.normal, features.variance)


UNRECOGNISED = -1
GAP = 20.0
"""Distance between clusters, at least, in median distances within: rows of a face that is seen at 3 deg are so far apart."""
MOST_CLUSTERED = 3000
"""Points of a surface that are clustered: single linkage needs their square."""


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Surfaces of a cloud.

    Attributes
    ----------
    of_point: (n,) number of the surface of a point, `UNRECOGNISED` for edges, boundaries and the rest.
    """

    features: PointFeatures
    of_point: Int[np.ndarray, " n"]

    @property
    def sizes(self) -> Int[np.ndarray, " s"]:
        """Points of every surface."""
        return np.bincount(self.of_point[self.of_point >= 0])

    def largest(self, count: int = 3) -> list[int]:
        """Numbers of the surfaces with the most points."""
        return np.argsort(-self.sizes, kind="stable")[:count].tolist()


def surf_segm(features: PointFeatures, parameters: Parameters) -> Surfaces:
    """Surfaces of smooth points with like normals (in absolute value, as appendix D.4), split into clusters."""
    of_point, count = np.full(len(features.points), UNRECOGNISED), 0
    left = features.label == SURFACE
    while left.any():
        seed = int(np.argmax(left))
        alike = np.abs(np.abs(features.normal) - np.abs(features.normal[seed])).max(axis=1)
        members = np.flatnonzero(left & (alike <= parameters.normal_tolerance))
        left[members] = False
        left[seed] = False
        if len(members) < parameters.smallest_surface:
            continue
        for cluster in clusterdata(features, members, parameters):
            of_point[cluster] = count
            count += 1
    return Surfaces(features, of_point)


def clusterdata(
    features: PointFeatures, members: Int[np.ndarray, " m"], parameters: Parameters
) -> list[Int[np.ndarray, " c"]]:
    """Clusters of a surface by single linkage; those too small are discarded.

    There are as many as gaps, at most the largest number of clusters: "maxclust" alone cuts a whole face into ten pieces, and
    the thesis saw no influence of that number.
    """
    if not 1 < len(members) <= MOST_CLUSTERED:
        return [members]
    tree = linkage(features.points[members], "single")
    gap = GAP * np.median(tree[:, 2])
    count = min(parameters.clusters, 1 + int(np.count_nonzero(tree[:, 2] > gap)))
    number = fcluster(tree, count, "maxclust")
    clusters = [members[number == k] for k in np.unique(number)]
    return [each for each in clusters if len(each) >= parameters.smallest_surface]


PAIRS: Final = ((0, 1), (1, 2), (2, 0))
"""Surfaces whose intersections are the edges."""
FLATTEST: Final = 1e-9
"""Triple product of three unit normals below which they have no corner."""


@dataclass(frozen=True, eq=False)
class SnapshotFeatures:
    """Second-level features of a snapshot.

    Attributes
    ----------
    planes: of the three largest surfaces.   corner: (3,) m.
    edges: labelled points of the three edges, m, see `labelled_edges`.
    """

    surfaces: Surfaces
    planes: "ThreePlanes"
    corner: Float[np.ndarray, "3"]
    edges: tuple[Float[np.ndarray, "_ 3"], ...]

    @property
    def boundary_corners(self) -> Float[np.ndarray, "b 3"]:
        """The far ends of the labelled edges, 0 to 3 of them, m; edges without a point are left out."""
        return np.array([edge[0] for edge in self.edges if len(edge)]).reshape(-1, 3)


def snapshot_features(points: Float[np.ndarray, "n 3"], parameters: Parameters) -> SnapshotFeatures | None:
    """Features of one cloud by the whole processing.

    None where it finds less than three surfaces, or no corner.
    """
    if len(points) < parameters.boundary_neighbors:
        return None
    features = find_bndry_points(find_edge_points(points, parameters), parameters)
    surfaces = surf_segm(features, parameters)
    planes = three_planes(surfaces)
    corner = None if planes is None else find_corner(planes)
    if planes is None or corner is None:
        return None
    edges = labelled_edges(features, planes, corner, parameters)
    return SnapshotFeatures(surfaces, planes, corner, tuple(edges))


@dataclass(frozen=True, eq=False)
class ThreePlanes:
    """Planes n.X = d of the three largest surfaces (Eq. 4.1)."""

    normals: Float[np.ndarray, "3 3"]
    offsets: Float[np.ndarray, "3"]


def three_planes(surfaces: Surfaces) -> ThreePlanes | None:
    """Planes of the three largest surfaces.

    Through an arbitrary point of each, the first, with the point's own normal.
    """
    if len(surfaces.sizes) < 3:
        return None
    return planes_through(
        surfaces, [int(np.argmax(surfaces.of_point == number)) for number in surfaces.largest()]
    )


def planes_through(surfaces: Surfaces, chosen: Sequence[int]) -> ThreePlanes:
    """Planes through three points of a cloud with the points' own normals."""
    rows = list(chosen)
    normals, points = surfaces.features.normal[rows], surfaces.features.points[rows]
    return ThreePlanes(normals, np.einsum("ki,ki->k", normals, points))


def find_corner(planes: ThreePlanes) -> Float[np.ndarray, "3"] | None:
    """Goldman's intersection of three planes (Eq. 4.3); None where two are parallel."""
    n1, n2, n3 = planes.normals
    d1, d2, d3 = planes.offsets
    triple = n1 @ np.cross(n2, n3)
    if abs(triple) < FLATTEST:
        return None
    return (d1 * np.cross(n2, n3) + d2 * np.cross(n3, n1) + d3 * np.cross(n1, n2)) / triple


def labelled_edges(
    features: PointFeatures, planes: ThreePlanes, corner: Float[np.ndarray, "3"], parameters: Parameters
) -> list[Float[np.ndarray, "_ 3"]]:
    """Edge and boundary points near each of the three lines of intersection, the farthest from the corner first.

    The distance is Eq. 4.5; the lines go through the corner.
    """
    candidates = features.points[(features.label == EDGE) | (features.label == BOUNDARY)]
    w, found = candidates - corner, []
    threshold = parameters.edge_distance * spacing(features.points)
    for a, b in PAIRS:
        D = np.cross(planes.normals[a], planes.normals[b])
        D /= np.linalg.norm(D)
        distance = np.linalg.norm(w - (w @ D)[:, None] * D, axis=1)
        near = np.flatnonzero(distance < threshold)
        found.append(candidates[near[np.argsort(-np.linalg.norm(w[near], axis=1), kind="stable")]])
    return found


def spacing(points: Float[np.ndarray, "n 3"]) -> float:
    """Median distance between nearest neighbours, m."""
    return float(np.median(KDTree(points).query(points, 2)[0][:, 1]))
