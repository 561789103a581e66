"""The corner, labelled edges and boundary corners (Decoust 2008, section 4.1, appendices D.6 and D.7)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from spinfilters.reproduction.decoust.scan_features import (
    BOUNDARY,
    EDGE,
    Parameters,
    PointFeatures,
    find_bndry_points,
    find_edge_points,
)
from spinfilters.reproduction.decoust.surfaces import Surfaces, surf_segm

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
