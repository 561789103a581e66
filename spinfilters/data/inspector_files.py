"""Known trajectory of the inspector: `inspector.tum`.

Poses of cam0 in i, beside the measurements of a camera.
"""

import os
from pathlib import Path
from typing import Final

import numpy as np

from spinfilters.data.input_file import path_text
from spinfilters.data.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.data.pose_files import read_tum, write_tum
from spinfilters.data.sensor_format import sensor_format
from spinfilters.errors import InputError

INSPECTOR_FILE: Final[str] = "inspector.tum"


def read_inspector(folder: Path, log: MeasurementLog) -> MeasurementStream | None:
    """Poses (t_ic m, q_ic) of the folder's inspector, None without a file.

    Raises
    ------
    InputError: as `spinfilters.data.pose_files.read_tum` and `require_cover`; the text names the file.
    """
    path = folder / INSPECTOR_FILE
    if not os.path.lexists(path):
        return None
    stream = read_tum(path)
    try:
        require_cover(stream, log)
    except InputError as error:
        raise InputError(f"{path_text(path)}: {error}") from None
    return stream


def write_inspector(folder: Path, inspector: MeasurementStream) -> None:
    """Write the file that `read_inspector` reads back bit for bit. Atomic."""
    write_tum(folder / INSPECTOR_FILE, inspector)


def require_cover(inspector: MeasurementStream, log: MeasurementLog) -> None:
    """Require that the inspector's poses cover all observations of a camera.

    InputError: a log without a camera, or observations of one before the first or after the last pose.
    """
    seen = [stream.time for stream in log.streams if sensor_format(stream.sensor).calibration is not None]
    if not seen:
        raise InputError(
            f"an inspector's trajectory is of a camera, and only {', '.join(log.sensors)} measured; leave it out, or give tracks"
        )
    first, last = np.min([time[0] for time in seen]), np.max([time[-1] for time in seen])
    if first < inspector.time[0] or last > inspector.time[-1]:
        raise InputError(
            f"the inspector's poses from {inspector.time[0]:.6f} s to {inspector.time[-1]:.6f} s do not cover the observations "
            f"from {first:.6f} s to {last:.6f} s; give those that are missing"
        )
