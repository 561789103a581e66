"""A scan: every ray of a lidar with its stamp, angles, range, intensity and flag."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.geometry.ray_angles import angles_of, unit_vectors
from spinfilters.lidar.ray_pattern import angle_tree
from spinfilters.lidar.scan_errors import DUST, RETURN

_NEIGHBOURS, _ALIKE = 8, 2  # rays beside one, and those of them whose range is like its own
_SURFACE, _APART = 0.25, 15.0  # quantile of the difference that surfaces have, and how many of it are apart
_RAYS_APART = 6.0  # distances between rays, beside them


@dataclass(frozen=True, eq=False)
class Scan:
    """Rays of one scan in the order of firing, as a lidar reports them.

    Attributes
    ----------
    time: (n,) s.   azimuth, elevation: (n,) reported, rad.   distance: (n,) reported range, m, NaN without a return.
    intensity: (n,) 0 without a return.   flag: (n,) see `spinfilters.lidar.scan_errors`.   window: (n,) 0 for the grid.
    metadata: words and numbers for the reader.
    """

    time: Float[np.ndarray, " n"]
    azimuth: Float[np.ndarray, " n"]
    elevation: Float[np.ndarray, " n"]
    distance: Float[np.ndarray, " n"]
    intensity: Float[np.ndarray, " n"]
    flag: Int[np.ndarray, " n"]
    window: Int[np.ndarray, " n"]
    name: str = "the scan"
    metadata: Mapping[str, object] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.time)

    @property
    def is_return(self) -> Bool[np.ndarray, " n"]:
        """Rays with a measured range."""
        return (self.flag == RETURN) & np.isfinite(self.distance)

    @property
    def points(self) -> Float[np.ndarray, "k 3"]:
        """Points of the returns, frame L, m."""
        rows = self.is_return
        return self.distance[rows, None] * unit_vectors(self.azimuth[rows], self.elevation[rows])

    @property
    def point_times(self) -> Float[np.ndarray, " k"]:
        """Stamps of the returns, s."""
        return self.time[self.is_return]

    @property
    def epoch(self) -> float:
        """Epoch of the scan's pose: its middle, s."""
        start, duration = self.metadata.get("start_s"), self.metadata.get("duration_s")
        if isinstance(start, int | float) and isinstance(duration, int | float):
            middle = float(start + duration / 2)
            if self.time.min() <= middle <= max(float(self.time.max()), start + duration):
                return middle
        return float((self.time.min() + self.time.max()) / 2)


def without_repeats(scan: Scan) -> Scan:
    """Scan without repetitions of a measured range and direction."""
    rays = np.stack([scan.azimuth, scan.elevation, np.nan_to_num(scan.distance)], axis=1)
    first = np.sort(np.unique(rays, axis=0, return_index=True)[1])
    if len(first) == len(scan):
        return scan
    names = ("time", "azimuth", "elevation", "distance", "intensity", "flag", "window")
    return replace(scan, **{name: getattr(scan, name)[first] for name in names})


def without_isolated(scan: Scan) -> tuple[Scan, int]:
    """The scan without isolated returns, and their number.

    Dust and clutter return beams from anywhere. A point of a surface has the range of some neighbours, up to the noise and to the
    distance between rays: along a steep surface those of one of the two angles.
    """
    rows = np.flatnonzero(scan.is_return)
    if len(rows) <= _NEIGHBOURS:
        return scan, 0
    angles = np.stack([scan.azimuth[rows], scan.elevation[rows]], axis=1)
    apart, near = angle_tree(angles).query(angles, _NEIGHBOURS + 1)
    distance = scan.distance[rows]
    by = np.sort(np.abs(distance[np.asarray(near)[:, 1:]] - distance[:, None]), axis=1)[:, _ALIKE - 1]
    most = _APART * np.quantile(by, _SURFACE) + _RAYS_APART * distance * np.median(apart[:, 1:], axis=1)
    lost = by > most
    flag = scan.flag.copy()
    flag[rows[lost]] = DUST
    return replace(scan, flag=flag), int(np.count_nonzero(lost))


def scan_of_points(points: Float[np.ndarray, "n 3"], time: float = 0.0, name: str = "the scan") -> Scan:
    """Scan of points of frame L, m, taken at one time."""
    azimuth, elevation = angles_of(points)
    n = len(points)
    distance = np.linalg.norm(points, axis=1)
    flag, window = np.full(n, RETURN), np.zeros(n, np.int64)
    return Scan(np.full(n, float(time)), azimuth, elevation, distance, np.ones(n), flag, window, name)
