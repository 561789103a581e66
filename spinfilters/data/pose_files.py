"""Trajectories in the TUM format.

`timestamp tx ty tz qx qy qz qw`, blank separated, '#' for comments.
"""

from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.data.atomic_write import atomic_file
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.data.sensor_files import require_times, require_unit_quaternions
from spinfilters.data.stated_values import LENGTH
from spinfilters.data.table_files import read_blank_separated

TUM_COLUMNS: Final[tuple[str, ...]] = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
"""s, m (origin of g in i), unit quaternion q_ig, scalar last."""
_DECIMALS = 9


def read_tum(path: Path) -> MeasurementStream:
    """Pose stream of a TUM file: origin of g in i (m) and q_ig.

    Raises
    ------
    InputError: as `read_blank_separated` and `require_times`, a position beyond `LENGTH`, or a quaternion that is not a unit one.
    """
    table = read_blank_separated(path, TUM_COLUMNS)
    require_times(table, repeats=False)
    table.require(slice(1, 4), LENGTH)
    require_unit_quaternions(table, 4)
    return MeasurementStream("pose", table.values[:, 0], table.values[:, 1:])


def write_tum(path: Path, stream: MeasurementStream) -> None:
    """Write a pose stream with at least 9 decimals, atomically.

    It writes as many decimals as give the same bits when read.
    """
    write_poses(path, stream.time, stream.values[:, :3], stream.values[:, 3:])


def write_poses(
    path: Path,
    time: Float[np.ndarray, " n"],
    position: Float[np.ndarray, "n 3"],
    quaternion: Float[np.ndarray, "n 4"],
) -> None:
    """Write times (s), positions (m) and unit quaternions as `write_tum` does."""
    with atomic_file(path) as file:
        file.write(f"# {' '.join(TUM_COLUMNS)}\n".encode())
        for row in zip(time, position, quaternion, strict=True):
            file.write((" ".join(map(_decimal, np.hstack(row))) + "\n").encode())


def _decimal(number: float) -> str:
    return np.format_float_positional(number, unique=True, trim="k", min_digits=_DECIMALS)
