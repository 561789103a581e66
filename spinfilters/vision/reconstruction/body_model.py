"""Surface model of a body in principal axes, and its dimensions along them with standard deviations."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from spinfilters.errors import InputError
from spinfilters.vision.reconstruction.dimensions import Dimensions, dimensions_of
from spinfilters.vision.reconstruction.distance_volume import GROUPS, DistanceVolume
from spinfilters.vision.reconstruction.surface_nets import NetSurface, surface_of

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
    vertices: (v, 3) m from the centre of mass, principal axes.   triangles: (f, 3), anticlockwise seen from outside.
    grey: (v,) 0..255.   dimensions: extents along the principal axes.
    """

    vertices: Float[np.ndarray, "v 3"]
    triangles: Int[np.ndarray, "f 3"]
    grey: Float[np.ndarray, " v"]
    dimensions: Dimensions

    def share_near(self, points: Float[np.ndarray, "k 3"], distance: float) -> float:
        """Share of points within a distance, m, of a vertex.

        Points in m, principal axes.
        """
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
    axes_cov: rad^2, of the small rotation of the principal axes about themselves; None where they are exact.
    landmarks: m, principal axes; None to leave the surface where depth puts it.

    Raises
    ------
    InputError: the depth maps make no surface.
    """
    outward = 0.0 if landmarks is None else _depth_of_landmarks(volume, landmarks)
    surface = _largest_part(volume, outward)
    if len(surface.triangles) < FEWEST_TRIANGLES:
        raise InputError(
            f"depth of {volume.count} pair(s) makes a surface of {len(surface.triangles)} triangles; give sharper images of a "
            "textured body, or more of them"
        )
    others = np.array([_extents(volume, outward, group) for group in range(GROUPS)])
    jackknife = (GROUPS - 1) / GROUPS * ((others - others.mean(axis=0)) ** 2).sum(axis=0)
    surface_std = np.sqrt(jackknife + (ROUNDING_STD_VOXELS * volume.grid.voxel) ** 2)
    dimensions = dimensions_of(surface, surface_std, np.zeros((3, 3)) if axes_cov is None else axes_cov)
    return BodyModel(surface.vertices, surface.triangles, surface.grey, dimensions)


def _depth_of_landmarks(volume: DistanceVolume, landmarks: Float[np.ndarray, "k 3"]) -> float:
    """Median distance of landmarks outside the surface, m; zero where few are near it."""
    distance = volume.field().at(landmarks)
    near = distance[np.abs(distance) <= NEAR_VOXELS * volume.grid.voxel]
    return float(np.median(near)) if len(near) >= FEWEST_LANDMARKS else 0.0


def _extents(volume: DistanceVolume, outward: float, without: int) -> Float[np.ndarray, " 3"]:
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
