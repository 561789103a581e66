"""Motion tables as recordings: one file whose columns are known by their names, or a folder as EuRoC or TUM lays it out."""

import itertools
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import quaternion_from_matrix
from spinfilters.core.errors import InputError
from spinfilters.io.dataset import DATASET_FILE, LANDMARK_FILE, Dataset
from spinfilters.io.headings import Quantity, heading_of
from spinfilters.io.input_file import first_text, path_text, printable
from spinfilters.io.logger_names import understood_names
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.io.motion_table import MotionTable, read_motion_table, rotations_of
from spinfilters.io.sensor_format import sensor_format, sensor_formats
from spinfilters.io.sensor_tables import LATEST_SECONDS, TUM_COLUMNS, read_tum, require_clock
from spinfilters.io.stated_values import ReadingOptions, to_state
from spinfilters.io.table_layout import PREAMBLE_LINES
from spinfilters.io.text_table import read_blank_separated
from spinfilters.io.truth import TRUTH_TABLE
from spinfilters.io.unnamed_columns import first_rows

_TABLES = (".csv", ".tsv")
"""Suffixes of tables with a header; texts have others."""
_RATE_FILES = ("gyro", "angular_velocity", "angularvelocity", "gyroscope", "rotationrate")
_HEAD = 65536
_ALONE = "gyro.csv"  # the one table of a folder that is a data set without it


def is_motion_file(path: Path) -> bool:
    """Whether a table or text is a recording by itself: no part of a data set folder, and no .txt of poses in TUM's columns."""
    return path.name not in _parts() and not (path.suffix.lower() == ".txt" and _is_poses_alone(path))


_OTHER_TEXTS: Final = (
    *(
        ".md",
        ".rst",
        ".html",
        ".py",
        ".m",
        ".c",
        ".h",
        ".cpp",
        ".toml",
        ".yaml",
        ".yml",
        ".ini",
        ".xml",
        ".urdf",
        ".sdf",
        ".svg",
    ),
    *(
        ".obj",
        ".ply",
        ".off",
        ".stl",
        ".pcd",
        ".xyz",
        ".wrl",
        ".gz",
        ".zip",
        ".pdf",
        ".png",
        ".jpg",
        ".jpeg",
        ".tif",
        ".bmp",
    ),
)
"""Suffixes of texts with numbers that are no tables of a motion, and of what is no text."""


def has_rows_of_numbers(path: Path) -> bool:
    """Whether a file of a suffix that says nothing begins as a text with rows of numbers does."""
    if path.suffix.lower() in (
        *_OTHER_TEXTS,
        *(each for form in sensor_formats().values() for each in form.suffixes),
    ):
        return False
    lines = first_text(path, _HEAD).splitlines()[:PREAMBLE_LINES]
    is_text = not any(mark in line for line in lines for mark in ("\0", "\ufffd"))
    return is_text and first_rows(lines)[0] >= 0


def read_motion_file(path: Path, options: ReadingOptions) -> Dataset:
    """Data set of the table; its columns are known by their names, those of KITTI's poses by their number."""
    if options.columns is not None:
        return motion_dataset(path, path.name, read_motion_table(path, options, bare_quantity(path)))
    if (poses := read_transforms(path, options)) is not None:
        return motion_dataset(path, path.name, poses)
    has_tum_columns = len(_first_numbers(path)) == len(TUM_COLUMNS)  # whatever the unit of the clock
    if has_tum_columns and path.suffix.lower() not in _TABLES and _named(path) is None:
        options = replace(options, columns=",".join(("t", *_TUM_NAMES)))
    return motion_dataset(path, path.name, read_motion_table(path, options, bare_quantity(path)))


_TRANSFORM: Final = (12, 16)
"""Numbers of a transformation: three rows of a matrix, or four, of which the last is 0 0 0 1."""
_TUM_NAMES: Final = ("px", "py", "pz", "qx", "qy", "qz", "qw")


def read_transforms(path: Path, options: ReadingOptions) -> MotionTable | None:
    """Poses as KITTI writes them: 12 or 16 numbers a row, [R_ib t] row by row, in m and without a clock; None of another table.

    Parameters
    ----------
    path : Path
        The table.
    options : ReadingOptions
        Have to state the rate, unless a times.txt does.

    Raises
    ------
    InputError
        Neither; a matrix that is no rotation.
    """
    first = _first_numbers(path)
    if len(first) not in _TRANSFORM or (first[12:] and first[12:] != (0.0, 0.0, 0.0, 1.0)):
        return None
    options.require_only(("rate",), "a table of poses without a clock")
    height = len(first) // 4
    table = read_blank_separated(path, [f"T{row}{column}" for row in range(height) for column in range(4)])
    matrices = table.values.reshape(-1, height, 4)
    wrong = np.flatnonzero((matrices[:, 3:] != (0.0, 0.0, 0.0, 1.0)).any(axis=(1, 2)))
    if wrong.size:
        raise table.error(
            int(wrong[0]), "the last row of its matrix is not 0 0 0 1; correct or delete the line"
        )
    matrices = matrices[:, :3]
    R = rotations_of(table, matrices[:, :, :3])
    if options.rate is not None:
        time, remark = np.arange(len(R)) / options.rate, f"clock of {options.rate:g} Hz as stated"
    else:
        time, remark = _kitti_times(path, len(R))
    stream = MeasurementStream("pose", time, np.column_stack([matrices[:, :, 3], quaternion_from_matrix(R)]))
    return MotionTable(stream, None, (remark,))


def _kitti_times(path: Path, count: int) -> tuple[Float[np.ndarray, " n"], str]:
    """Times of KITTI's poses, s, and where they are: in times.txt beside them, or in the folder of the sequence of that number.

    InputError: none of the files, or other than a time for each pose.
    """
    places = (path.parent / "times.txt", path.parent.parent / "sequences" / path.stem / "times.txt")
    found = next((place for place in places if os.path.isfile(place)), None)
    if found is None:
        raise InputError(
            f"{path_text(path)}: twelve or sixteen numbers a row are poses without a clock, as KITTI's; give "
            f"{to_state('rate', 'HZ')}, or put the times.txt of the sequence beside them"
        )
    table = read_blank_separated(found, ["time_s"])
    require_clock(table)
    if len(table.values) != count:
        raise InputError(
            f"{path_text(found)}: has {len(table.values)} times for {count} poses; give that of the same sequence, or "
            f"{to_state('rate', 'HZ')}"
        )
    return table.values[:, 0], f"times of {printable(found.name)}"


def _first_numbers(path: Path) -> tuple[float, ...]:
    """Numbers between blanks of the first line; none of words."""
    try:
        return tuple(float(cell) for cell in first_text(path, _HEAD).partition("\n")[0].split())
    except ValueError:
        return ()


def _named(path: Path) -> Sequence[str] | None:
    """Names in the comment above the first numbers of a text, where it has as many as they and one of a rate; None of others."""
    lines = first_text(path, _HEAD).splitlines()[:PREAMBLE_LINES]
    for above, line in itertools.pairwise(lines):
        if above.lstrip().startswith("#") and line.strip() and not line.lstrip().startswith("#"):
            names = above.lstrip("# ").split()
            headings = [heading_of(name) for name in understood_names(names)]
            is_rate = any(heading is not None and heading.quantity == "rate" for heading in headings)
            return names if is_rate and len(names) == len(line.split()) else None
    return None


def bare_quantity(path: Path) -> Quantity | None:
    """Quantity of columns called x, y and z alone, as the name of their file says."""
    stem = path.stem.lower()
    return "rate" if any(word in stem for word in _RATE_FILES) else None


def _is_poses_alone(path: Path) -> bool:
    """Whether the first bytes of a text look like poses in the TUM format: eight numbers between blanks, or no numbers at all."""
    for line in first_text(path, _HEAD).splitlines()[:PREAMBLE_LINES]:
        if line.strip() and not line.lstrip().startswith("#"):
            cells = line.split()
            if len(cells) != len(TUM_COLUMNS) or any(c.isalpha() and c not in "eE" for c in line):
                return False
            return not _is_other_clock(cells[0]) and _named(path) is None
    return True


def _is_other_clock(cell: str) -> bool:
    """Whether a stamp is too large for seconds, as the nanoseconds of ORB-SLAM are."""
    try:
        return abs(float(cell)) > LATEST_SECONDS
    except ValueError:
        return False


def motion_dataset(path: Path, name: str, table: MotionTable) -> Dataset:
    """Data set of a motion table or of an export."""
    description = "; ".join((printable(name), *table.remarks))
    return Dataset(
        kind=sensor_format(table.stream.sensor).kind,
        log=MeasurementLog((table.stream,)),
        path=path,
        description=description,
        acceleration=table.acceleration,
    )


def _parts() -> set[str]:
    """Tables of data set folders, which describe nothing alone."""
    files = {form.file for form in sensor_formats().values() if not form.suffixes} - {_ALONE}
    return files | {DATASET_FILE, LANDMARK_FILE, TRUTH_TABLE}


def read_logger_folder(path: Path, table: Path, options: ReadingOptions) -> Dataset:
    """Root of a recording in the layout of EuRoC or TUM: its rates, or poses, from the table of that path in it."""
    if table.name == "groundtruth.txt":
        options.require_only((), "a folder of TUM")
        stream = read_tum(table)
        return Dataset(kind="pose", log=MeasurementLog((stream,)), path=path, description=path.name)
    measured = read_motion_table(table, options)
    return motion_dataset(path, f"{path.name}, {table.relative_to(path)}", measured)
