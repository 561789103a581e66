"""Edge and boundary points by surface variation (Decoust 2008, chapter 3).

Sections 3.1 to 3.3, appendices D.1 to D.3.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, Int
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
