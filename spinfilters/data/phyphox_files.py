"""Folder that the phyphox app exports, and the segments marked in it."""

import csv
import io
import math
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from spinfilters.data.dataset import PHYPHOX_TABLE, Segment
from spinfilters.data.input_file import path_text, read_settings_text, value_text
from spinfilters.data.motion_table import MotionTable, read_motion_table
from spinfilters.data.stated_values import NOTHING_STATED, ReadingOptions
from spinfilters.errors import InputError

_SEGMENT_COLUMNS = ["segment", "start", "end", "keep", "comment"]
_KEEP = {"": True, "true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}


@dataclass(frozen=True, eq=False)
class PhyphoxRecording:
    """Sensor measurements with the segments marked in them."""

    table: MotionTable
    segments: tuple[Segment, ...]

    @property
    def time(self) -> Float[np.ndarray, " n"]:
        """s, strictly increasing."""
        return self.table.stream.time

    @property
    def rate(self) -> Float[np.ndarray, "n 3"]:
        """Body rate, rad/s, phone axes."""
        return self.table.stream.values


def read_phyphox(folder: Path, options: ReadingOptions = NOTHING_STATED) -> PhyphoxRecording:
    """Recording of a phyphox export, with the segments that somebody marked in it.

    It holds `Raw Data.csv` and perhaps `meta/segments.csv` with the header `segment,start,end,keep,comment`, where an empty keep
    keeps the segment.

    Raises
    ------
    InputError: as `spinfilters.data.motion_table.read_motion_table`; a segment that cannot be a stretch of time.
    """
    table = read_motion_table(folder / PHYPHOX_TABLE, options)
    marked = folder / "meta" / "segments.csv"
    segments = _read_segments(marked) if os.path.lexists(marked) else ()
    return PhyphoxRecording(table, segments)


def _read_segments(path: Path) -> tuple[Segment, ...]:
    rows = csv.reader(io.StringIO(read_settings_text(path), newline=""), strict=True)
    segments: dict[int | None, Segment] = {}
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
