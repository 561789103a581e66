"""Export folder of the phyphox app, whose kept segments are data sets."""

import os
from dataclasses import dataclass, replace
from pathlib import Path

from spinfilters.data.dataset import DATASET_FILE, Dataset
from spinfilters.data.dataset_reader import DatasetReader, OnRefused
from spinfilters.data.gyro_files import PHYPHOX_TABLE, PhyphoxRecording, Segment, read_phyphox
from spinfilters.data.input_file import printable
from spinfilters.data.phyphox_trials import phyphox_trial, phyphox_trials
from spinfilters.data.readers.motion_file import motion_dataset
from spinfilters.data.reading_options import NOTHING_STATED, ReadingOptions


@dataclass(frozen=True)
class PhyphoxReader(DatasetReader):
    """Reader of phyphox exports; see `spinfilters.data.phyphox_trials`.

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
    is_phyphox = os.path.isfile(path / PHYPHOX_TABLE) and not os.path.isfile(path / DATASET_FILE)
    return path if is_phyphox else None


def _dataset(folder: Path, recording: PhyphoxRecording) -> Dataset:
    return motion_dataset(folder, f"phyphox recording {folder.name}", recording.table)


def _trial(whole: Dataset, segment: Segment | None) -> Dataset:
    if segment is None:
        return whole
    description = f"{whole.description}, {segment.label}: {printable(segment.comment)}"
    return replace(whole.part(segment), description=description)


READER = PhyphoxReader()
