"""Truncated signed distance to the surface on a grid.

Principal axes, fused from depth maps (Curless and Levoy 1996).
Each depth map tells, at voxels before and shortly behind what it sees, the distance along the ray; means are weighted by the
inverse variance of the depth. Sums are kept by groups of epochs, so that leaving out a group tells how sure the surface is.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import map_coordinates

from spinfilters.data.camera import StereoRig
from spinfilters.vision.reconstruction.depth_map import DepthMap

GROUPS: Final = 4
TRUNCATION_VOXELS: Final = 2.5
CLEARED_VOXELS: Final = 14.0
"""Before what a pixel sees, that are empty: that removes what a wrong disparity has put there."""
FEWEST_VIEWS: Final = 3
"""That a voxel needs to be taken for observed."""
REFERENCE_STD: Final = 1e-3
"""Of the depth, m, that has weight one."""


@dataclass(frozen=True)
class Grid:
    """Voxels of a cube around the centre of mass, in principal axes.

    Attributes
    ----------
    radius: half of the cube's side, m.   count: voxels along each axis.
    """

    radius: float
    count: int

    @property
    def voxel(self) -> float:
        """Side of a voxel, m."""
        return 2 * self.radius / (self.count - 1)

    def places(self, indices: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Points (m, principal axes) of indices along x, y, z, which need not be whole."""
        return indices * self.voxel - self.radius


@dataclass(frozen=True)
class Field:
    """Fused distances.

    Attributes
    ----------
    distance: (n, n, n) m, positive outside, NaN where nothing is known.   grey: (n, n, n) of the surface nearby, 0..255.
    """

    grid: Grid
    distance: Float[np.ndarray, "n n n"]
    grey: Float[np.ndarray, "n n n"]

    def at(self, points: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, " k"]:
        """Distances at points (m, principal axes), NaN where a voxel beside is unknown."""
        index = (points + self.grid.radius) / self.grid.voxel
        return map_coordinates(self.distance, index.T, order=1, mode="constant", cval=np.nan)

    def moved(self, outward: float) -> "Field":
        """The field of a surface that lies farther out, m."""
        return replace(self, distance=self.distance - np.float32(outward))


class DistanceVolume:
    """Sums over depth maps at the voxels of a grid.

    Attributes
    ----------
    count: of depth maps.
    """

    def __init__(self, grid: Grid) -> None:
        self.grid = grid
        self._sums = np.zeros((GROUPS, 5, grid.count**3), dtype=np.float32)
        """By group: of weights, of weighted distances; of weights near the surface, of grey values weighted alike; views."""
        self.count = 0

    def add(
        self, seen: DepthMap, rig: StereoRig, R_cp: Float[np.ndarray, "3 3"], t_cp: Float[np.ndarray, " 3"]
    ) -> None:
        """Take a depth map in; the pose of the principal axes is in the camera frame."""
        row, column = np.nonzero(np.isfinite(seen.depth))
        depth, std, grey = (values[row, column] for values in (seen.depth, seen.std, seen.grey))
        u, v = column + seen.corner[0], row + seen.corner[1]
        rays = np.stack(
            [(u - rig.left.cx) / rig.left.fx, (v - rig.left.cy) / rig.left.fy, np.ones(len(u))], axis=1
        )
        points = (depth[:, None] * rays - t_cp) @ R_cp
        rays = rays @ R_cp / np.linalg.norm(rays, axis=1, keepdims=True)
        voxel, pixel, distance = self._along(points, rays)
        limit = TRUNCATION_VOXELS * self.grid.voxel
        weight = (REFERENCE_STD / std[pixel]) ** 2 * np.clip(2 + 2 * distance / limit, 0, 1)
        close = np.where(np.abs(distance) < limit / 2, weight, 0)
        sums = self._sums[self.count % GROUPS]
        for total, values in zip(
            sums, (weight, weight * np.minimum(distance, limit), close, close * grey[pixel]), strict=False
        ):
            np.add.at(total, voxel, values.astype(np.float32))
        sums[4, np.unique(voxel)] += 1
        self.count += 1

    def _along(
        self, points: Float[np.ndarray, "n 3"], rays: Float[np.ndarray, "n 3"]
    ) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"], Float[np.ndarray, " k"]]:
        """Voxels along rays near their end points.

        The rows of these come with them, and the distance before them along the ray, m.
        """
        reach = np.arange(-CLEARED_VOXELS, TRUNCATION_VOXELS + 0.5) * self.grid.voxel
        passed = points[:, None] + reach[:, None] * rays[:, None]
        index = np.rint((passed + self.grid.radius) / self.grid.voxel).astype(np.int64).reshape(-1, 3)
        inside = ((index >= 0) & (index < self.grid.count)).all(axis=1)
        index, pixel = index[inside], np.repeat(np.arange(len(points)), len(reach))[inside]
        distance = np.einsum("ki,ki->k", points[pixel] - self.grid.places(index), rays[pixel])
        strides = self.grid.count ** np.arange(2, -1, -1)
        return index @ strides, pixel, distance

    def field(self, without: int | None = None) -> Field:
        """Distances of all epochs, or of all but a group."""
        groups = [group for group in range(GROUPS) if group != without]
        weight, distance, close, grey, views = self._sums[groups].sum(axis=0)
        known = np.flatnonzero((views >= FEWEST_VIEWS) & (weight > 0))
        values = np.full((2, len(views)), np.nan, dtype=np.float32)
        values[0, known] = distance[known] / weight[known]
        values[1, known] = grey[known] / np.maximum(close[known], 1e-9)
        return Field(self.grid, *values.reshape(2, *(self.grid.count,) * 3))
