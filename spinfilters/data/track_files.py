"""Stereo feature tracks (`tracks.csv`) and a map of known landmarks (`landmarks.csv`)."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.data.measurement_log import MeasurementStream, first_repeated_landmark, freeze_arrays
from spinfilters.data.number_range import LENGTH, PIXEL
from spinfilters.data.table_files import Table, read_csv, write_csv
from spinfilters.data.time_stamps import require_times
from spinfilters.errors import InputError, ShapeError

TRACK_COLUMNS: Final[tuple[str, ...]] = ("time_s", "landmark_id", "u_left_px", "v_left_px", "u_right_px")
"""s, whole number, rectified pixels."""
LANDMARK_COLUMNS: Final[tuple[str, ...]] = ("landmark_id", "x", "y", "z")
"""Whole number, m in frame g."""
SMALLEST_DISPARITY_PX: Final[float] = -3.0
"""A far point has disparity zero, with noise a little less; below this, columns or cameras are swapped."""
_LARGEST_ID = 2.0**53  # above it float64 does not tell whole numbers apart


@dataclass(frozen=True, eq=False)
class KnownMap:
    """Landmarks whose places are known: ids, sorted to ascend, and points (m, frame g).

    Raises
    ------
    InputError: an id twice, a point not finite.  ShapeError: shapes other than (k,) and (k, 3), k > 0.
    """

    ids: Int[np.ndarray, " k"]
    points: Float[np.ndarray, "k 3"]

    def __post_init__(self) -> None:
        ids, points = np.asarray(self.ids), np.asarray(self.points)
        if ids.ndim != 1 or ids.size == 0 or points.shape != (ids.size, 3):
            raise ShapeError(
                f"known map: ids {ids.shape} and points {points.shape}, expected (k,) and (k, 3)"
            )
        if not np.isfinite(points).all():
            raise InputError("known map: a point is not finite; leave out that landmark")
        row = first_repeated_landmark(np.zeros(ids.size), ids)
        if row is not None:
            raise InputError(f"known map: landmark {ids[row]} occurs twice; keep one")
        order = np.argsort(ids)
        object.__setattr__(self, "ids", ids[order])
        object.__setattr__(self, "points", points[order])
        freeze_arrays(self, ("ids",), np.int64)
        freeze_arrays(self, ("points",))


def read_tracks(path: Path) -> MeasurementStream:
    """Stereo stream of a file with the header `time_s,landmark_id,u_left_px,v_left_px,u_right_px`.

    Raises
    ------
    InputError: as `read_csv` and `require_times`; an id that is no whole number; a landmark twice at one
    time; a disparity below -3 px (a point behind the cameras). Disparities from there to zero are kept: to
    reject them is the filter's task.
    """
    table = read_csv(path, TRACK_COLUMNS)
    require_times(table, repeats=True)
    table.require(slice(2, 5), PIXEL)
    time, ids, pixels = table.values[:, 0], landmark_ids(table, 1), table.values[:, 2:]
    row = first_repeated_landmark(time, ids)
    if row is not None:
        raise table.error(row, f"landmark {ids[row]} occurs twice at {float(time[row])!r} s; keep one line")
    behind = np.flatnonzero(pixels[:, 0] - pixels[:, 2] < SMALLEST_DISPARITY_PX)
    if behind.size:
        u_left, _, u_right = pixels[behind[0]].tolist()
        raise table.error(
            int(behind[0]),
            f"u_left_px {u_left} - u_right_px {u_right} is below {SMALLEST_DISPARITY_PX} px, "
            "a point behind the cameras; swap left and right, or delete the line",
        )
    return MeasurementStream("stereo", time, pixels, ids)


def write_tracks(path: Path, stream: MeasurementStream) -> None:
    """Write a stereo stream so that reading gives the same bits, without its covariance. Atomic."""
    if stream.ids is None:
        raise InputError(f"a {stream.sensor} stream has no landmark ids; write a stereo stream")
    write_csv(path, TRACK_COLUMNS, [stream.time, stream.ids, *stream.values.T])


def read_landmarks(path: Path) -> KnownMap:
    """Known map of a file with the header `landmark_id,x,y,z` (m, g). InputError: `read_csv`, an id twice."""
    table = read_csv(path, LANDMARK_COLUMNS)
    table.require(slice(1, 4), LENGTH)
    ids = landmark_ids(table, 0)
    row = first_repeated_landmark(np.zeros(ids.size), ids)
    if row is not None:
        raise table.error(row, f"landmark {ids[row]} occurs twice; keep one line")
    return KnownMap(ids, table.values[:, 1:])


def write_landmarks(path: Path, known_map: KnownMap) -> None:
    """Write a known map so that reading gives the same bits. Atomic."""
    write_csv(path, LANDMARK_COLUMNS, [known_map.ids, *known_map.points.T])


def landmark_ids(table: Table, column: int) -> Int[np.ndarray, " n"]:
    """Landmark ids of a column. InputError: one that is no whole number."""
    ids = table.values[:, column]
    bad = np.flatnonzero((ids != np.round(ids)) | (np.abs(ids) > _LARGEST_ID))
    if bad.size:
        raise table.error(
            int(bad[0]), f"landmark_id {float(ids[bad[0]])!r} is not a whole number; renumber it"
        )
    return ids.astype(np.int64)
