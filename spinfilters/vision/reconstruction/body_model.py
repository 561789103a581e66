"""Surface model of a body in principal axes, and its dimensions along them with standard deviations.

The principal axes are themselves estimated. Moments that nearly agree leave their axes hardly determined, and with them any
extent along the true axes; the extent along the axes as estimated is not touched by that. Both deviations are kept.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, KDTree
from scipy.spatial.transform import Rotation

from spinfilters.errors import InputError
from spinfilters.vision.reconstruction.distance_volume import GROUPS, DistanceVolume
from spinfilters.vision.reconstruction.surface_nets import NetSurface, surface_of

AXES_DRAWN: Final = 100
NAMES: Final = "xyz"
"""Of the principal axes, moments ascending."""


@dataclass(frozen=True, eq=False)
class Dimensions:
    """Extents along the principal axes.

    Attributes
    ----------
    extents: (3,) m, along the axes as estimated.   surface_std: (3,) m, of these extents, by the surface.
    rotation_std: (3,) rad, of the axes about each axis.   moved: (3, 3) m, by how much a rotation by one standard deviation about
    axis k changes extent j, ``moved[k, j]``.   axes_std: (3,) m, of the extents by the axes.
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
    surface_std: m, of the extents along the axes as they are.   axes_cov: rad^2, of the axes' small rotation about themselves.
    """
    corners = surface.vertices[ConvexHull(surface.vertices).vertices]
    values, vectors = np.linalg.eigh(axes_cov)
    drawn = np.random.default_rng(0).standard_normal((AXES_DRAWN, 3)) * np.sqrt(np.maximum(values, 0.0))
    rotation_std = np.sqrt(np.maximum(np.diag(axes_cov), 0.0))
    straight = np.ptp(corners, axis=0)
    single = [_turned(corners, sign * np.diag(rotation_std)) - straight for sign in (-1, 1)]
    return Dimensions(
        surface.extents,
        surface_std,
        rotation_std,
        np.abs(single).max(axis=0),
        _turned(corners, drawn @ vectors.T).std(axis=0),
    )


def _turned(
    corners: Float[np.ndarray, "v 3"], rotations: Float[np.ndarray, "s 3"]
) -> Float[np.ndarray, "s 3"]:
    """Extents along axes turned by rotation vectors, rad."""
    return np.array([np.ptp(corners @ turn.as_matrix(), axis=0) for turn in Rotation.from_rotvec(rotations)])


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
