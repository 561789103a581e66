"""Smallest box around points: dimensions of a body along axes of its shape, whatever its principal axes."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

NORMALS: Final = 250
"""Directions of a side that are tried, evenly over half the sphere: some 9 degrees apart."""
ANGLES: Final = np.deg2rad(np.arange(0.0, 90.0, 5.0))
"""Of the others about it."""
REFINED: Final = 8
"""Boxes from which the search for a smaller one goes on."""
FIRST_STEP_RAD: Final = 0.05
SETTLED: Final = 1e-5
"""Of the orientation, rad, and share of the volume."""


@dataclass(frozen=True, eq=False)
class SmallestBox:
    """A box around points.

    Attributes
    ----------
    axes: (3, 3), rows are unit vectors along its sides.   extents: (3,) along them, ascending, in the points' unit.
    """

    axes: Float[np.ndarray, "3 3"]
    extents: Float[np.ndarray, " 3"]


def smallest_box(points: Float[np.ndarray, "n 3"]) -> SmallestBox:
    """Of points that are not all in one plane."""
    corners = points[ConvexHull(points).vertices]
    tried = [_around(corners, normal) for normal in _normals()]
    found = [box_near(corners, box.axes) for box in sorted(tried, key=_volume)[:REFINED]]
    return min(found, key=_volume)


def box_near(points: Float[np.ndarray, "n 3"], axes: Float[np.ndarray, "3 3"]) -> SmallestBox:
    """Smallest box with axes near these (rows)."""

    def turned(turn: Float[np.ndarray, " 3"]) -> SmallestBox:
        return _along(points, axes @ Rotation.from_rotvec(turn).as_matrix())

    simplex = np.vstack([np.zeros(3), FIRST_STEP_RAD * np.eye(3)])
    first = _volume(turned(simplex[0]))
    options = {"initial_simplex": simplex, "xatol": SETTLED, "fatol": SETTLED * first}
    least = minimize(lambda turn: _volume(turned(turn)), simplex[0], method="Nelder-Mead", options=options)
    return turned(least.x)


def _volume(box: SmallestBox) -> float:
    return float(box.extents.prod())


def _along(points: Float[np.ndarray, "n 3"], axes: Float[np.ndarray, "3 3"]) -> SmallestBox:
    extents = _widths(points, axes)
    order = np.argsort(extents)
    return SmallestBox(axes[order], extents[order])


def _widths(
    points: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "k 3"]
) -> Float[np.ndarray, " k"]:
    return np.ptp(directions @ points.T, axis=1)


def _normals() -> Float[np.ndarray, "k 3"]:
    """Even directions over half the sphere (Fibonacci's lattice)."""
    z = (np.arange(NORMALS) + 0.5) / NORMALS
    longitude, radius = np.pi * (1 + np.sqrt(5)) * np.arange(NORMALS), np.sqrt(1 - z**2)
    return np.column_stack([radius * np.cos(longitude), radius * np.sin(longitude), z])


def _around(corners: Float[np.ndarray, "n 3"], normal: Float[np.ndarray, " 3"]) -> SmallestBox:
    """The smallest of the boxes with a side across a normal."""
    across = np.linalg.svd(normal[None])[2][1:]
    both = np.concatenate([ANGLES, ANGLES + np.pi / 2])
    directions = np.column_stack([np.cos(both), np.sin(both)]) @ across
    one, other = _widths(corners, directions).reshape(2, -1)
    best = int((one * other).argmin())
    return _along(corners, np.array([normal, directions[best], directions[best + len(ANGLES)]]))
