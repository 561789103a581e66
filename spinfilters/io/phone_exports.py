"""Exports of phones: folders with a table per sensor, and recordings of phyphox with marked segments."""

import csv
import io
import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import PHYPHOX_TABLE, Dataset, Segment
from spinfilters.io.dataset_reader import OnRefused
from spinfilters.io.input_file import path_text, printable, read_settings_text, value_text
from spinfilters.io.motion_file import motion_dataset
from spinfilters.io.motion_table import MotionTable, read_acceleration, read_motion_table
from spinfilters.io.sensor_tables import require_two_epochs
from spinfilters.io.stated_values import NOTHING_STATED, ReadingOptions

ACCELEROMETER_TABLES: Final = ("TotalAcceleration.csv", "Accelerometer.csv", "Acceleration.csv")
"""In the order in which they are looked for: Sensor Logger calls Accelerometer what is left without gravity."""


def read_phone_export(path: Path, rates: Path, options: ReadingOptions) -> Dataset:
    """Rates of the phone from the table of that path, and its accelerometer where there is one.

    The folder is of Sensor Logger, of phyphox' experiments of several sensors or of an alike app. InputError: `read_motion_table`.
    """
    table = read_motion_table(rates, options, "rate")
    dataset = motion_dataset(path, f"phone recording {path.name}", table)
    beside = next((path / name for name in ACCELEROMETER_TABLES if os.path.isfile(path / name)), None)
    if table.acceleration is not None or beside is None or options.rate is not None:
        return dataset
    return replace(dataset, acceleration=read_acceleration(beside, options))


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
    InputError
        As `spinfilters.io.motion_table.read_motion_table`; a segment that cannot be a stretch of time.
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


def read_phyphox_trial(path: Path, segment: int | None, options: ReadingOptions) -> Dataset:
    """A kept segment of an export, or the only one. InputError: `read_phyphox`, `phyphox_trial`."""
    folder, recording = _recording(path, options)
    return _trial(_dataset(folder, recording), phyphox_trial(folder, recording, segment))


def read_phyphox_whole(path: Path, options: ReadingOptions) -> Dataset:
    """The whole recording of an export, whatever is marked in it. InputError: `read_phyphox`."""
    return _dataset(*_recording(path, options))


def read_phyphox_trials(path: Path, on_refused: OnRefused | None, options: ReadingOptions) -> list[Dataset]:
    """Every kept segment of an export. InputError: `read_phyphox`, `phyphox_trials`."""
    folder, recording = _recording(path, options)
    whole = _dataset(folder, recording)
    return [_trial(whole, segment) for segment in phyphox_trials(folder, recording, on_refused)]


def _recording(path: Path, options: ReadingOptions) -> tuple[Path, PhyphoxRecording]:
    """Of a folder, or of the table in it."""
    folder = path.parent if os.path.isfile(path) else path
    return folder, read_phyphox(folder, options)


def _dataset(folder: Path, recording: PhyphoxRecording) -> Dataset:
    return motion_dataset(folder, f"phyphox recording {folder.name}", recording.table)


def _trial(whole: Dataset, segment: Segment | None) -> Dataset:
    if segment is None:
        return whole
    description = f"{whole.description}, {segment.label}: {printable(segment.comment)}"
    return replace(whole.part(segment), description=description)


_MOST_DESCRIBED = 8  # segments that an error describes; of more it gives the numbers only


def phyphox_trial(folder: Path, recording: PhyphoxRecording, number: int | None) -> Segment | None:
    """The kept segment of that number.

    Number None asks for the only one; the result is None where none is marked.

    Raises
    ------
    InputError
        Several kept segments and none chosen; no such segment; one that is not a trial; one outside the
        recording.
    """
    if number is None:
        return _only_trial(folder, recording)
    chosen = [segment for segment in recording.segments if segment.number == number]
    if not chosen:
        raise InputError(
            f"{path_text(folder)}: has no segment {number}; choose --segment from {_list_segments(recording)}"
        )
    if not chosen[0].keep:
        raise InputError(
            f"{path_text(folder)}: segment {number} is not a trial ({value_text(chosen[0].comment)}); "
            f"choose --segment from {_list_segments(recording)}"
        )
    _require_within(folder, recording, chosen[0])
    return chosen[0]


def phyphox_trials(
    folder: Path, recording: PhyphoxRecording, on_refused: OnRefused | None = None
) -> Iterator[Segment | None]:
    """Every kept segment; None alone where none is marked. InputError: as `phyphox_trial`.

    Parameters
    ----------
    on_refused : OnRefused | None
        Called with the number of a kept segment that is no trial, and why, instead of raising InputError for it.
    """
    kept = _kept_segments(recording)
    if not kept:
        yield _only_trial(folder, recording)
    for segment in kept:
        try:
            _require_within(folder, recording, segment)
        except InputError as error:
            if on_refused is None:
                raise
            on_refused(segment.number or 0, str(error))
            continue
        yield segment


def _only_trial(folder: Path, recording: PhyphoxRecording) -> Segment | None:
    kept = _kept_segments(recording)
    if not recording.segments:
        return None
    if not kept:
        raise InputError(
            f"{path_text(folder)}: meta/segments.csv keeps no segment, so there is no trial; keep one of them"
        )
    if len(kept) > 1:
        raise InputError(
            f"{path_text(folder)}: holds {len(kept)} segments; choose one with --segment: {_list_segments(recording)}; "
            "or take all of them"
        )
    _require_within(folder, recording, kept[0])
    return kept[0]


def _require_within(folder: Path, recording: PhyphoxRecording, segment: Segment) -> None:
    """Raise InputError unless a segment holds two samples of the recording."""
    start, end = float(recording.time[0]), float(recording.time[-1])
    first = start if segment.start is None else segment.start
    last = end if segment.end is None else segment.end
    count = int(((recording.time >= first) & (recording.time <= last)).sum())
    if not count:
        raise InputError(
            f"{path_text(folder)}: segment {segment.number} runs from {segment.start} s to {segment.end} s, "
            f"the recording from {start} s to {end} s; correct meta/segments.csv"
        )
    require_two_epochs(folder / f"segment {segment.number}", count)


def _kept_segments(recording: PhyphoxRecording) -> list[Segment]:
    return [segment for segment in recording.segments if segment.keep]


def _list_segments(recording: PhyphoxRecording) -> str:
    kept = _kept_segments(recording)
    if len(kept) > _MOST_DESCRIBED:
        return ", ".join(str(segment.number) for segment in kept)
    described = [f"{s.number} ({value_text(s.comment)[1:-1]}, {s.start} s to {s.end} s)" for s in kept]
    return ", ".join(described) or "none: the recording has no kept segment"
