"""Gyro logs: `gyro.csv` of this project, and the folder that the phyphox app exports."""

import csv
import io
import math
import os
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.data.input_file import path_text, read_settings_text, value_text
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.data.number_range import RATE
from spinfilters.data.table_files import Table, read_csv, read_header, write_csv
from spinfilters.data.time_stamps import require_times
from spinfilters.errors import InputError

GYRO_COLUMNS: Final[tuple[str, ...]] = ("time_s", "wx", "wy", "wz")
"""Header of gyro.csv: s and rad/s, g axes."""
PHYPHOX_TABLE: Final[str] = "Raw Data.csv"
"""The file by which a phyphox folder is recognised."""
FLAT_TOP: Final[float] = 1e-3
NEAR_TOP: Final[float] = 2e-2
"""Of the largest |rate| of an axis: clipped samples lie within the first of it (offsets are corrected after clipping), and few
others within the second. A smooth peak whose top two samples lie within the first has three times as many within the second."""
FEWEST_CLIPPED: Final[int] = 3
"""Samples that can make a flat top."""

_SEGMENT_COLUMNS = ["segment", "start", "end", "keep", "comment"]
_KEEP = {"": True, "true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}
_DEGREES = re.compile(r"(?<![a-z])(deg(ree)?s?|dps|degps)(?![a-z])|°(?!\s*[CF])", re.IGNORECASE)
"""Degrees as a whole word: deg/s, deg_s, dps, but neither radps nor degC."""
_AXIS = re.compile(r"(?<![a-z])w?[xyz](?![a-z])", re.IGNORECASE)
_NAME_AND_UNIT = re.compile(r"(?P<name>.*\S)\s*\((?P<unit>[^()]*)\)")


@dataclass(frozen=True)
class Segment:
    """A marked stretch of a recording, s on its clock; without `keep` no trial, and times may be None."""

    number: int
    start: float | None
    end: float | None
    keep: bool
    comment: str


@dataclass(frozen=True, eq=False)
class PhyphoxRecording:
    """Time (s, strictly increasing), body rate (rad/s, phone axes) and the segments that were marked."""

    time: Float[np.ndarray, " n"]
    rate: Float[np.ndarray, "n 3"]
    segments: tuple[Segment, ...]


def read_gyro_csv(path: Path) -> MeasurementStream:
    """Gyro stream of a file with the header `time_s,wx,wy,wz` (s, rad/s, g axes).

    Raises
    ------
    InputError: as `read_csv` and `require_times`, or a column in degrees.
    """
    names = read_header(path)
    if names != GYRO_COLUMNS:
        refuse_degrees(path, names)
    table = read_csv(path, GYRO_COLUMNS)
    require_times(table, repeats=False)
    table.require(slice(1, 4), RATE)
    return MeasurementStream("gyro", table.values[:, 0], table.values[:, 1:])


def write_gyro_csv(path: Path, stream: MeasurementStream) -> None:
    """Write a gyro stream so that reading gives the same bits. Atomic; covariance is not part of the file."""
    write_csv(path, GYRO_COLUMNS, [stream.time, *stream.values.T])


def saturated(rate: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    """Whether a component of the rate is clipped, as its axis shows: samples pile up, side by side, at its largest |rate|.

    An axis that is there most of the time spins steadily and is not taken for clipped.
    """
    clipped = np.zeros(len(rate), dtype=bool)
    for axis in np.asarray(rate).T:
        largest = np.abs(axis).max(initial=0.0)
        top = np.abs(axis) >= (1 - FLAT_TOP) * largest
        near = np.abs(axis) >= (1 - NEAR_TOP) * largest
        together = bool(np.any(top[1:] & top[:-1] & (np.sign(axis[1:]) == np.sign(axis[:-1]))))
        count = np.count_nonzero(top)
        if together and FEWEST_CLIPPED <= count <= len(axis) / 2 and 2 * count > np.count_nonzero(near):
            clipped |= top
    return clipped


def read_phyphox(folder: Path) -> PhyphoxRecording:
    """Recording of a phyphox export, with the segments that somebody marked in it.

    It holds `Raw Data.csv` (comma, semicolon or tab; decimal point or comma) and perhaps `meta/segments.csv`
    with the header `segment,start,end,keep,comment`, where an empty keep keeps the segment.

    Raises
    ------
    InputError: as `read_csv` and `require_times`; units other than s and rad/s; a segment that cannot be a
    stretch of time.
    """
    path = folder / PHYPHOX_TABLE
    columns = _phyphox_columns(path, read_header(path))
    table = read_csv(path)
    chosen = Table(path, tuple(table.names[k] for k in columns), table.values[:, columns], table.layout)
    require_times(chosen, repeats=False)
    chosen.require(slice(1, 4), RATE)
    marked = folder / "meta" / "segments.csv"
    segments = _read_segments(marked) if os.path.lexists(marked) else ()
    return PhyphoxRecording(chosen.values[:, 0], chosen.values[:, 1:], segments)


def refuse_degrees(path: Path, names: Iterable[str]) -> None:
    """Raise InputError for a column whose heading says that it is in degrees."""
    for name in names:
        if _DEGREES.search(name):
            raise InputError(
                f"{path_text(path)}: line 1: column {value_text(name)} is in degrees; "
                "multiply it by pi/180 and name it rad/s"
            )


def _phyphox_columns(path: Path, names: tuple[str, ...]) -> list[int]:
    """Indices of time, x, y, z. Names are translated in the app, so the unit and the axis letter decide."""
    parts = [match and (match["name"], match["unit"]) for match in map(_NAME_AND_UNIT.fullmatch, names)]
    found = [[k for k, part in enumerate(parts) if part and part[1] == "s"]]
    for axis in "xyz":
        found.append(
            [
                k
                for k, part in enumerate(parts)
                if part and part[1] == "rad/s" and part[0].endswith(f" {axis}")
            ]
        )
    if any(len(indices) != 1 for indices in found):
        refuse_degrees(path, (name for name in names if _AXIS.search(name)))
        raise InputError(
            f"{path_text(path)}: line 1: the header is {value_text(', '.join(names))}, "
            "expected Time (s) and Gyroscope x, y, z (rad/s); export the gyroscope experiment of phyphox"
        )
    return [indices[0] for indices in found]


def _read_segments(path: Path) -> tuple[Segment, ...]:
    rows = csv.reader(io.StringIO(read_settings_text(path), newline=""), strict=True)
    segments: dict[int, Segment] = {}
    try:
        if [cell.strip() for cell in next(rows, [])] != _SEGMENT_COLUMNS:
            raise InputError(
                f"{path_text(path)}: line 1: expected the header '{','.join(_SEGMENT_COLUMNS)}'; add it"
            )
        for row in rows:
            if any(cell.strip() for cell in row):
                segment = _segment(f"{path_text(path)}: line {rows.line_num}: ", row)
                if segment.number in segments:
                    raise InputError(
                        f"{path_text(path)}: line {rows.line_num}: segment {segment.number} occurs twice; "
                        "renumber it"
                    )
                segments[segment.number] = segment
    except csv.Error as error:
        raise InputError(
            f"{path_text(path)}: line {rows.line_num}: is not CSV ({error}); correct the quotes"
        ) from None
    return tuple(segments.values())


def _segment(where: str, row: list[str]) -> Segment:
    if len(row) != len(_SEGMENT_COLUMNS):
        raise InputError(
            f"{where}{value_text(','.join(row))} has {len(row)} cells, expected 5; quote a comment with commas"
        )
    number, start, end, keep, comment = (cell.strip() for cell in row)
    if not number.isascii() or not number.isdigit() or len(number) > 9:
        raise InputError(f"{where}segment is {value_text(number)}, not a whole number; number it from 0")
    if keep.lower() not in _KEEP:
        raise InputError(
            f"{where}keep is {value_text(keep)}; write false for a stretch that is not a trial, else nothing"
        )
    segment = Segment(int(number), _seconds(where, start), _seconds(where, end), _KEEP[keep.lower()], comment)
    if segment.keep and (segment.start is None or segment.end is None or segment.start >= segment.end):
        raise InputError(
            f"{where}start {value_text(start)} and end {value_text(end)}: not a stretch of time; correct or drop it"
        )
    return segment


def _seconds(where: str, cell: str) -> float | None:
    if not cell:
        return None
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{where}{value_text(cell)} is not a time in seconds; correct it")
    return value
