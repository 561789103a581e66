"""Ray patterns: a grid with denser windows (Decoust 2008, section 2.2.3).

Frame L of the lidar: x along its axis, y towards positive elevation, z towards positive azimuth.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from spinfilters.data.stated_values import NumberRange
from spinfilters.errors import InputError

FIELD_OF_VIEW: Final = NumberRange(1e-6, 179.0, "deg")
RAYS: Final = NumberRange(1, 100_000, whole=True)
MOST_RAYS: Final = 10_000_000
"""Rays of a pattern: beyond, its arrays alone take gigabytes."""


@dataclass(frozen=True)
class HighResolutionWindow:
    """A rectangle of the field of view with denser rays, deg.

    Its edges are moved to the nearest rays of the grid, and clipped to the field of view.
    """

    elevation_start: float
    elevation_span: float
    azimuth_start: float
    azimuth_span: float


@dataclass(frozen=True)
class RayPattern:
    """A grid of rays about the lidar's axis.

    Parameters
    ----------
    field_of_view: azimuth and elevation, deg, in all.   rays: in azimuth and in elevation (the thesis' "resolution").
    windows: where the grid is ``multiplier`` times as dense in both angles.

    Raises
    ------
    InputError: a number out of its range, a window beside the field of view.
    """

    field_of_view: tuple[float, float] = (2.0, 2.0)
    rays: tuple[int, int] = (551, 551)
    windows: tuple[HighResolutionWindow, ...] = ()
    multiplier: int = 2

    def __post_init__(self) -> None:
        for axis, field, rays in zip(("azimuth", "elevation"), self.field_of_view, self.rays, strict=True):
            FIELD_OF_VIEW.require(f"field of view in {axis}", float(field))
            RAYS.require(f"rays in {axis}", rays)
        NumberRange(1, 1000, whole=True).require("multiplier", self.multiplier)
        if self.rays[0] * self.rays[1] * (1 + len(self.windows) * self.multiplier**2) > MOST_RAYS:
            raise InputError(
                f"a pattern of {self.rays[0]} x {self.rays[1]} rays is too large; give at most {MOST_RAYS} in all"
            )
        for window in self.windows:
            self._indices(window)

    @property
    def grid(self) -> tuple[Float[np.ndarray, " a"], Float[np.ndarray, " e"]]:
        """Azimuths and elevations of the grid, rad."""
        halves = np.deg2rad(self.field_of_view) / 2
        azimuth, elevation = (
            np.linspace(-half, half, rays) if rays > 1 else np.zeros(1)
            for half, rays in zip(halves, self.rays, strict=True)
        )
        return azimuth, elevation

    def directions(self) -> "RayDirections":
        """All rays in the order of firing.

        The grid row by row (elevation outside), then the windows.
        Rays of the grid within a window are fired with the window.
        """
        azimuth, elevation = self.grid
        E, A = np.meshgrid(elevation, azimuth, indexing="ij")
        inside = np.zeros(E.shape, dtype=bool)
        parts = []
        for number, window in enumerate(self.windows, 1):
            (a0, a1), (e0, e1) = self._indices(window)
            fine = [
                _refined(grid[i : j + 1], self.multiplier)
                for grid, i, j in ((elevation, e0, e1), (azimuth, a0, a1))
            ]
            parts.append((number, *np.meshgrid(*fine, indexing="ij")))
            inside[e0 : e1 + 1, a0 : a1 + 1] = True
        whole = [(0, E[~inside], A[~inside]), *((k, e.ravel(), a.ravel()) for k, e, a in parts)]
        window_of = np.concatenate([np.full(len(e), k) for k, e, _ in whole])
        return RayDirections(
            np.concatenate([a for _, _, a in whole]), np.concatenate([e for _, e, _ in whole]), window_of
        )

    def _indices(self, window: HighResolutionWindow) -> tuple[tuple[int, int], tuple[int, int]]:
        """First and last ray of the grid of a window, in azimuth and in elevation."""
        spans = (
            (window.azimuth_start, window.azimuth_span, self.field_of_view[0], self.rays[0]),
            (window.elevation_start, window.elevation_span, self.field_of_view[1], self.rays[1]),
        )
        found = []
        for start, span, field, rays in spans:
            if not span > 0 or start > field / 2 or start + span < -field / 2:
                raise InputError(
                    f"the window {window} lies outside the field of view or is empty; give one inside"
                )
            step = field / max(rays - 1, 1)
            ends = np.rint((np.array([start, start + span]) + field / 2) / step)
            first, last = np.clip(ends, 0, rays - 1).astype(int).tolist()
            found.append((first, last))
        return found[0], found[1]


@dataclass(frozen=True, eq=False)
class RayDirections:
    """Angles of n rays, rad, in the order of firing.

    Attributes
    ----------
    window: 0 for the grid, k for the k-th high-resolution window.
    """

    azimuth: Float[np.ndarray, " n"]
    elevation: Float[np.ndarray, " n"]
    window: Int[np.ndarray, " n"]


def angle_tree(angles: Float[np.ndarray, "n 2"]) -> KDTree:
    """Tree over rays, split at middles.

    Medians of a grid, which has many equal angles, take three times as long.
    """
    return KDTree(angles, balanced_tree=False, compact_nodes=False)


def _refined(angles: Float[np.ndarray, " k"], multiplier: int) -> Float[np.ndarray, " m"]:
    return np.linspace(angles[0], angles[-1], (len(angles) - 1) * multiplier + 1)
