"""Surfaces: points of like normals, grouped into clusters (Decoust 2008, section 3.4, appendices D.4 and D.5)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int
from scipy.cluster.hierarchy import fcluster, linkage

from spinfilters.reproduction.decoust.scan_features import SURFACE, Parameters, PointFeatures

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
