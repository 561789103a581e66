"""Extents of a surface along principal axes that are themselves estimated.

Moments that nearly agree leave their axes hardly determined, and with them any extent along the true axes; the extent along the
axes as estimated is not touched by that. Both deviations are kept.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from spinfilters.vision.reconstruction.surface_nets import NetSurface

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
