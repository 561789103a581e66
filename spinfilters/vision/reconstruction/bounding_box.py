"""Smallest box around a surface.

Dimensions that the shape alone defines, whatever its principal axes are known to.
A box of least volume has a side in a face of the convex hull, or nearly so (O'Rourke 1985: two adjacent sides hold edges); of the
hull's faces the largest are tried, with the rectangle of least area around the hull seen along each.
"""

from typing import Final

import cv2
import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

FACES: Final = 400
"""Of the hull that are tried, the largest."""


def smallest_box(vertices: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, " 3"]:
    """Sides of the smallest box around points, m, largest first.

    They are not in one plane.
    """
    hull = ConvexHull(vertices)
    corners = vertices[hull.vertices]
    a, b, c = (vertices[hull.simplices[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    areas = np.linalg.norm(normals, axis=1)
    chosen = np.argsort(-areas)[:FACES]
    sides = np.array([_box_along(corners, n) for n in normals[chosen] / areas[chosen, None]])
    return np.sort(sides[np.argmin(sides.prod(axis=1))])[::-1]


def _box_along(corners: Float[np.ndarray, "k 3"], normal: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
    """Sides of the smallest box with one side along a unit normal, m."""
    across = np.linalg.svd(normal[None])[2][1:]
    size = cv2.minAreaRect((corners @ across.T).astype(np.float32))[1]
    return np.array([np.ptp(corners @ normal), *size])
