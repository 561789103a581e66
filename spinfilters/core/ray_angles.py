"""Angles of rays in the frame L of a lidar: x along its axis, y towards positive elevation, z towards positive azimuth."""

import numpy as np
from jaxtyping import Float


def unit_vectors(
    azimuth: Float[np.ndarray, " n"], elevation: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "n 3"]:
    """Unit vectors (cos E cos A, sin E, cos E sin A) in frame L (Decoust 2008, section 2.2.3; theta_A is the azimuth)."""
    c = np.cos(elevation)
    return np.stack([c * np.cos(azimuth), np.sin(elevation), c * np.sin(azimuth)], axis=-1)


def angles_of(points: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Azimuth and elevation, rad, of points in frame L."""
    x, y, z = np.moveaxis(points, -1, 0)
    return np.arctan2(z, x), np.arctan2(y, np.hypot(x, z))
