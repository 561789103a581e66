"""A lidar scan: the pattern of its rays (Decoust 2008, section 2.2.3), ranges with their stamps, errors, and files.

Frame L of the lidar: x along its axis, y towards positive elevation, z towards positive azimuth.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, Literal

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from spinfilters.core.errors import InputError
from spinfilters.core.ray_angles import angles_of, unit_vectors
from spinfilters.io.input_file import path_text, value_text
from spinfilters.io.output_files import write_bytes
from spinfilters.io.ply_files import packed_columns, read_ply, write_ply
from spinfilters.io.stated_values import NumberRange

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
    field_of_view : tuple[float, float]
        Azimuth and elevation, deg, in all.
    rays : tuple[int, int]
        In azimuth and in elevation (the thesis' "resolution").
    windows : tuple[HighResolutionWindow, ...]
        Where the grid is ``multiplier`` times as dense in both angles.

    Raises
    ------
    InputError
        a number out of its range, a window outside the field of view.
    """

    field_of_view: tuple[float, float] = (2.0, 2.0)
    rays: tuple[int, int] = (551, 551)
    windows: tuple[HighResolutionWindow, ...] = ()
    multiplier: int = 2

    def __post_init__(self) -> None:
        for axis, view, rays in zip(("azimuth", "elevation"), self.field_of_view, self.rays, strict=True):
            FIELD_OF_VIEW.require(f"field of view in {axis}", float(view))
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
                _refine_angles(grid[i : j + 1], self.multiplier)
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
        for start, span, view, rays in spans:
            if not span > 0 or start > view / 2 or start + span < -view / 2:
                raise InputError(
                    f"the window {window} lies outside the field of view or is empty; give one inside"
                )
            step = view / max(rays - 1, 1)
            ends = np.rint((np.array([start, start + span]) + view / 2) / step)
            first, last = np.clip(ends, 0, rays - 1).astype(int).tolist()
            found.append((first, last))
        return found[0], found[1]


@dataclass(frozen=True, eq=False)
class RayDirections:
    """Angles of n rays, rad, in the order of firing.

    Attributes
    ----------
    window : ndarray of shape (n,)
        0 for the grid, k for the k-th high-resolution window.
    """

    azimuth: Float[np.ndarray, " n"]
    elevation: Float[np.ndarray, " n"]
    window: Int[np.ndarray, " n"]


def angle_tree(angles: Float[np.ndarray, "n 2"]) -> KDTree:
    """Tree over rays, split at middles.

    Medians of a grid, which has many equal angles, take three times as long.
    """
    return KDTree(angles, balanced_tree=False, compact_nodes=False)


def _refine_angles(angles: Float[np.ndarray, " k"], multiplier: int) -> Float[np.ndarray, " m"]:
    return np.linspace(angles[0], angles[-1], (len(angles) - 1) * multiplier + 1)


AngleMode = Literal["jitter", "encoder", "thesis"]
"""jitter: the beam leaves its direction unnoticed; encoder: the direction is read wrongly; thesis: the beam leaves its
direction and the encoder follows it, so that points stay on the surface (Decoust 2008, section 2.2.4)."""
MISS, RETURN, WEAK, SATURATED, DUST = 0, 1, 2, 3, 4
FLAG_WORDS: Final = {MISS: "miss", RETURN: "return", WEAK: "too weak", SATURATED: "saturated", DUST: "dust"}
"""Flags of a ray; 1 and 0 are the thesis'."""


@dataclass(frozen=True)
class LidarNoise:
    """Standard deviations and biases, m and rad.

    Attributes
    ----------
    range_std, azimuth_std, elevation_std : float
        Of white noise.
    range_bias, azimuth_bias, elevation_bias : float
        Of what is reported.
    mode : AngleMode
        Of the angles' noise, see `AngleMode`.
    """

    range_std: float = 0.0
    azimuth_std: float = 0.0
    elevation_std: float = 0.0
    range_bias: float = 0.0
    azimuth_bias: float = 0.0
    elevation_bias: float = 0.0
    mode: AngleMode = "jitter"

    def drawn_angles(
        self, count: int, generator: np.random.Generator
    ) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"]]:
        """Deviations (azimuth, elevation) of the beams from their nominal directions, and of what is reported."""
        noise = generator.standard_normal((count, 2)) * [self.azimuth_std, self.elevation_std]
        fired = np.zeros_like(noise) if self.mode == "encoder" else noise
        read = np.zeros_like(noise) if self.mode == "jitter" else noise
        return fired, read + np.array([self.azimuth_bias, self.elevation_bias])


def rvs_noise(mode: AngleMode = "jitter", long_range: bool = False, biased: bool = False) -> LidarNoise:
    """Noise of Jena-Optronik's RVS: 3-sigma figures over three (Decoust 2008, Figure 2.11; Eq. 2.6 corrected).

    Parameters
    ----------
    long_range : bool
        0.1 m (3 sigma) and a bias of 0.5 m instead of 0.01 m and 0.01 m.
    biased : bool
        With the largest biases allowed.
    """
    range_bias, angle_bias = (0.5 if long_range else 0.01, np.deg2rad(0.1)) if biased else (0.0, 0.0)
    return LidarNoise(
        range_std=(0.1 if long_range else 0.01) / 3,
        azimuth_std=float(np.deg2rad(0.01)) / 3,
        elevation_std=float(np.deg2rad(0.02)) / 3,
        range_bias=range_bias,
        azimuth_bias=float(angle_bias),
        elevation_bias=float(angle_bias),
        mode=mode,
    )


@dataclass(frozen=True)
class Losses:
    """Causes of lost returns (Decoust 2008, section 2.1.2).

    Attributes
    ----------
    reflectivity : float
        Of a surface met head-on, 0 to 1; the intensity falls with the cosine of incidence.
    weakest, strongest : float
        Received power, intensity times (reference_range / range)^2, that the detector takes.
    reference_range : float
        m.
    dust : float
        Probability that dust absorbs a beam.
    clutter : float
        Probability that dust returns it from somewhere before the surface.
    sun : tuple[float, float, float] or None
        Unit vector towards the sun, frame L, or None.
    glint_deg : float
        Half angle within which the sun, or its mirror image in the surface, blinds the detector.
    """

    reflectivity: float = 1.0
    weakest: float = 0.0
    strongest: float = np.inf
    reference_range: float = 500.0
    dust: float = 0.0
    clutter: float = 0.0
    sun: tuple[float, float, float] | None = None
    glint_deg: float = field(default=2.0)

    def flags(
        self,
        directions: Float[np.ndarray, "n 3"],
        normals: Float[np.ndarray, "n 3"],
        distance: Float[np.ndarray, " n"],
        generator: np.random.Generator,
    ) -> Int[np.ndarray, " n"]:
        """Flag of every ray from the normals of the surfaces that were hit; an infinite distance is a miss."""
        hit = np.isfinite(distance)
        power = (
            self.intensity(directions, normals)
            * (self.reference_range / np.where(hit, distance, np.inf)) ** 2
        )
        flags = np.where(hit, RETURN, MISS)
        flags[hit & (power < self.weakest)] = WEAK
        flags[hit & (power > self.strongest)] = SATURATED
        if self.sun is not None:
            flags[self._blinded_by_sun(directions, normals, hit)] = SATURATED
        flags[generator.random(len(flags)) < self.dust] = DUST
        return flags

    def intensity(
        self, directions: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
    ) -> Float[np.ndarray, " n"]:
        """Lambert's law: reflectivity times the cosine of incidence."""
        return self.reflectivity * np.abs(np.einsum("ni,ni->n", directions, normals))

    def _blinded_by_sun(
        self, directions: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"], hit: np.ndarray
    ) -> np.ndarray:
        sun = np.asarray(self.sun) / np.linalg.norm(np.asarray(self.sun))
        least = np.cos(np.deg2rad(self.glint_deg))
        mirrored = 2 * (normals @ sun)[:, None] * normals - sun
        lit = normals @ sun > 0
        glint = hit & lit & (-np.einsum("ni,ni->n", mirrored, directions) > least)
        return glint | (~hit & (directions @ sun > least))


_NEIGHBOURS, _ALIKE = 8, 2  # nearest rays, and how many of them must have a similar range
_SURFACE, _APART = 0.25, 15.0  # quantile of the difference that surfaces have, and how many of it are apart
_RAYS_APART = 6.0  # distances between rays, beside them


@dataclass(frozen=True, eq=False)
class Scan:
    """Rays of one scan in the order of firing, as a lidar reports them.

    Attributes
    ----------
    time : ndarray of shape (n,)
        s.
    azimuth, elevation : ndarray of shape (n,)
        Reported, rad.
    distance : ndarray of shape (n,)
        Reported range, m, NaN without a return.
    intensity : ndarray of shape (n,)
        0 without a return.
    flag : ndarray of shape (n,)
        See `spinfilters.lidar.scan`.
    window : ndarray of shape (n,)
        0 for the grid.
    metadata : Mapping[str, object]
        Words and numbers for the reader.
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


COLUMNS: Final = (
    "x",
    "y",
    "z",
    "time_s",
    "azimuth_rad",
    "elevation_rad",
    "range_m",
    "intensity",
    "flag",
    "window",
)
"""Properties of a point; a ray without a return stands at the origin with its flag."""
_COMMENT = "spinfilters-lidar "


def write_scan(path: Path, scan: Scan, misses: bool = False) -> None:
    """Write a scan as its file's ending says: .ply, .pcd (both binary) or .csv. Atomic.

    Parameters
    ----------
    misses : bool
        Whether rays without a return are written too.

    Raises
    ------
    InputError
        Another ending, disk full, no permission.
    """
    writers = {".ply": _write_ply, ".pcd": _write_pcd, ".csv": _write_csv}
    if path.suffix.lower() not in writers:
        raise InputError(
            f"{path_text(path)}: {value_text(path.suffix)} is no format of scans; use {', '.join(writers)}"
        )
    rows = np.ones(len(scan), dtype=bool) if misses else scan.is_return
    writers[path.suffix.lower()](path, _columns(scan, rows), json.dumps(dict(scan.metadata), default=str))


def read_scan(path: Path) -> Scan:
    """Scan of a PLY file.

    A file of this package gives all its rays, any other points in m taken at time 0.

    Raises
    ------
    InputError
        As `read_ply`; no point, a point that is not finite.
    """
    content = read_ply(path)
    if not len(content.points):
        raise InputError(f"{path_text(path)}: holds no point; the lidar saw nothing, leave the scan out")
    bad = np.flatnonzero(~np.isfinite(content.points).all(axis=1))
    if bad.size:
        raise InputError(f"{path_text(path)}: point {bad[0]} is not finite; leave it out")
    if not set(COLUMNS) <= set(content.columns):
        seen = content.points[np.linalg.norm(content.points, axis=1) > 0]
        return scan_of_points(seen, name=path_text(path))
    values = [content.columns[name].astype(np.float64) for name in COLUMNS[3:8]]
    time, azimuth, elevation, distance, intensity = values
    flag, window = (content.columns[name].astype(np.int64) for name in COLUMNS[8:])
    scan = Scan(
        time,
        azimuth,
        elevation,
        distance,
        intensity,
        flag,
        window,
        path_text(path),
        _metadata(content.comments),
    )
    known = np.isfinite([time, azimuth, elevation, intensity]).all(axis=0)
    if not (known & (np.isfinite(distance) | (flag != RETURN))).all():
        raise InputError(
            f"{path_text(path)}: a ray has a time, angle or range that is not finite; leave it out"
        )
    return scan


def _metadata(comments: tuple[str, ...]) -> dict[str, object]:
    """Metadata of the scanner; none where damaged."""
    for comment in comments:
        if comment.startswith(_COMMENT):
            try:
                document = json.loads(comment[len(_COMMENT) :])
            except (ValueError, RecursionError):
                return {}
            return document if isinstance(document, dict) else {}
    return {}


def _columns(scan: Scan, rows: np.ndarray) -> dict[str, np.ndarray]:
    distance = np.nan_to_num(scan.distance[rows])
    points = distance[:, None] * unit_vectors(scan.azimuth[rows], scan.elevation[rows])
    numbers = (scan.time, scan.azimuth, scan.elevation, scan.distance, scan.intensity)
    whole = (scan.flag[rows].astype(np.uint8), scan.window[rows].astype(np.int32))
    return dict(zip(COLUMNS, (*points.T, *(each[rows] for each in numbers), *whole), strict=True))


def _write_ply(path: Path, columns: dict[str, np.ndarray], metadata: str) -> None:
    write_ply(path, columns, (_COMMENT + metadata,))


def _write_pcd(path: Path, columns: dict[str, np.ndarray], metadata: str) -> None:
    """Point Cloud Data 0.7, binary."""
    table = packed_columns(columns)
    types = [table.dtype[name] for name in columns]
    lines = [
        f"# {_COMMENT}{metadata}",
        "VERSION 0.7",
        f"FIELDS {' '.join(columns)}",
        f"SIZE {' '.join(str(each.itemsize) for each in types)}",
        f"TYPE {' '.join(each.kind.upper() for each in types)}",
        f"COUNT {' '.join('1' for _ in types)}",
        f"WIDTH {len(table)}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(table)}",
        "DATA binary\n",
    ]
    write_bytes(path, "\n".join(lines).encode() + table.tobytes())


def _write_csv(path: Path, columns: dict[str, np.ndarray], metadata: str) -> None:
    lines = [f"# {_COMMENT}{metadata}", ",".join(columns)]
    lines += [",".join(map(repr, row)) for row in zip(*(c.tolist() for c in columns.values()), strict=True)]
    write_bytes(path, ("\n".join(lines) + "\n").encode())
