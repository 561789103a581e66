"""Map of known landmarks (`landmarks.csv`)."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.data.measurement_log import first_repeated_landmark, freeze_arrays
from spinfilters.data.stated_values import LENGTH
from spinfilters.data.table_files import read_csv, write_csv
from spinfilters.errors import InputError, ShapeError

LANDMARK_COLUMNS: Final[tuple[str, ...]] = ("landmark_id", "x", "y", "z")
"""Whole number, m in frame g."""


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


def read_landmarks(path: Path) -> KnownMap:
    """Known map of a file with the header `landmark_id,x,y,z` (m, g). InputError: `read_csv`, an id twice."""
    table = read_csv(path, LANDMARK_COLUMNS)
    table.require(slice(1, 4), LENGTH)
    ids = table.landmark_ids(0)
    row = first_repeated_landmark(np.zeros(ids.size), ids)
    if row is not None:
        raise table.error(row, f"landmark {ids[row]} occurs twice; keep one line")
    return KnownMap(ids, table.values[:, 1:])


def write_landmarks(path: Path, known_map: KnownMap) -> None:
    """Write a known map so that reading gives the same bits. Atomic."""
    write_csv(path, LANDMARK_COLUMNS, [known_map.ids, *known_map.points.T])
