"""Scan files: PLY, PCD and CSV with metadata out, PLY of any origin in."""

import json
from pathlib import Path
from typing import Final

import numpy as np

from spinfilters.data.atomic_write import write_bytes
from spinfilters.data.input_file import path_text, value_text
from spinfilters.errors import InputError
from spinfilters.geometry.ray_angles import unit_vectors
from spinfilters.lidar.ply_files import read_ply, write_ply
from spinfilters.lidar.scan import Scan, scan_of_points
from spinfilters.lidar.scan_errors import RETURN

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
    misses: whether rays without a return are written too.

    Raises
    ------
    InputError: another ending, disk full, no permission.
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
    InputError: as `read_ply`; no point, a point that is not finite.
    """
    content = read_ply(path)
    if not len(content.points):
        raise InputError(f"{path_text(path)}: holds no point; the lidar has seen nothing, leave the scan out")
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
    told = np.isfinite([time, azimuth, elevation, intensity]).all(axis=0)
    if not (told & (np.isfinite(distance) | (flag != RETURN))).all():
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
    kinds = {"f": ("8", "F", "<f8"), "i": ("4", "I", "<i4"), "u": ("1", "U", "u1")}
    told = [kinds[values.dtype.kind] for values in columns.values()]
    count = len(next(iter(columns.values())))
    table = np.empty(count, [(name, kind[2]) for name, kind in zip(columns, told, strict=True)])
    for name, values in columns.items():
        table[name] = values
    lines = [
        f"# {_COMMENT}{metadata}",
        "VERSION 0.7",
        f"FIELDS {' '.join(columns)}",
        f"SIZE {' '.join(kind[0] for kind in told)}",
        f"TYPE {' '.join(kind[1] for kind in told)}",
        f"COUNT {' '.join('1' for _ in told)}",
        f"WIDTH {count}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {count}",
        "DATA binary\n",
    ]
    write_bytes(path, "\n".join(lines).encode() + table.tobytes())


def _write_csv(path: Path, columns: dict[str, np.ndarray], metadata: str) -> None:
    lines = [f"# {_COMMENT}{metadata}", ",".join(columns)]
    lines += [",".join(map(repr, row)) for row in zip(*(c.tolist() for c in columns.values()), strict=True)]
    write_bytes(path, ("\n".join(lines) + "\n").encode())
