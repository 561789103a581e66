"""Export folder of the phyphox app, whose kept segments are data sets."""

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from spinfilters.data.dataset import PHYPHOX_TABLE, Dataset, Segment
from spinfilters.data.dataset_reader import DatasetReader, OnRefused
from spinfilters.data.input_file import path_text, printable, value_text
from spinfilters.data.phyphox_files import PhyphoxRecording, read_phyphox
from spinfilters.data.readers.motion_file import motion_dataset
from spinfilters.data.sensor_files import require_two_epochs
from spinfilters.data.stated_values import NOTHING_STATED, ReadingOptions
from spinfilters.errors import InputError


@dataclass(frozen=True)
class PhyphoxReader(DatasetReader):
    """Reader of phyphox exports; see `spinfilters.data.readers.phyphox_export`.

    Attributes
    ----------
    options: what the user states of the recording.
    """

    options: ReadingOptions = NOTHING_STATED
    name, order = "phyphox", 10
    words = "a phyphox export"
    has_segments = True

    def recognises(self, path: Path) -> bool:
        """Whether a folder is phyphox' export."""
        return _phyphox_folder(path) is not None

    def read(self, path: Path, segment: int | None) -> Dataset:
        """A kept segment, or the only one."""
        folder, recording = self._recording(path)
        return _trial(_dataset(folder, recording), phyphox_trial(folder, recording, segment))

    def whole(self, path: Path) -> Dataset:
        """The whole recording, whatever is marked in it."""
        return _dataset(*self._recording(path))

    def segments(self, path: Path, on_refused: OnRefused | None) -> list[Dataset]:
        """Every kept segment."""
        folder, recording = self._recording(path)
        whole = _dataset(folder, recording)
        return [_trial(whole, segment) for segment in phyphox_trials(folder, recording, on_refused)]

    def stating(self, options: ReadingOptions) -> DatasetReader:
        """The reader with what the user states of units and clock."""
        return PhyphoxReader(options)

    def _recording(self, path: Path) -> tuple[Path, PhyphoxRecording]:
        folder = _phyphox_folder(path) or path
        return folder, read_phyphox(folder, self.options)


def _phyphox_folder(path: Path) -> Path | None:
    if path.name == PHYPHOX_TABLE and os.path.isfile(path):
        return path.parent
    return path if os.path.isfile(path / PHYPHOX_TABLE) else None


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
    InputError: several kept segments and none chosen; no such segment; one that is not a trial; one outside the recording.
    """
    if number is None:
        return _only_trial(folder, recording)
    chosen = [segment for segment in recording.segments if segment.number == number]
    if not chosen:
        raise InputError(
            f"{path_text(folder)}: has no segment {number}; choose --segment from {_listed(recording)}"
        )
    if not chosen[0].keep:
        raise InputError(
            f"{path_text(folder)}: segment {number} is not a trial ({value_text(chosen[0].comment)}); "
            f"choose --segment from {_listed(recording)}"
        )
    _require_within(folder, recording, chosen[0])
    return chosen[0]


def phyphox_trials(
    folder: Path, recording: PhyphoxRecording, on_refused: OnRefused | None = None
) -> Iterator[Segment | None]:
    """Every kept segment; None alone where none is marked. InputError: as `phyphox_trial`.

    Parameters
    ----------
    on_refused: called with the number of a kept segment that is no trial, and why, instead of raising InputError for it.
    """
    kept = _kept(recording)
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
    kept = _kept(recording)
    if not recording.segments:
        return None
    if not kept:
        raise InputError(
            f"{path_text(folder)}: meta/segments.csv keeps no segment, so there is no trial; keep one of them"
        )
    if len(kept) > 1:
        raise InputError(
            f"{path_text(folder)}: holds {len(kept)} segments; choose one with --segment: {_listed(recording)}; "
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


def _kept(recording: PhyphoxRecording) -> list[Segment]:
    return [segment for segment in recording.segments if segment.keep]


def _listed(recording: PhyphoxRecording) -> str:
    kept = _kept(recording)
    if len(kept) > _MOST_DESCRIBED:
        return ", ".join(str(segment.number) for segment in kept)
    described = [f"{s.number} ({value_text(s.comment)[1:-1]}, {s.start} s to {s.end} s)" for s in kept]
    return ", ".join(described) or "none: the recording has no kept segment"
