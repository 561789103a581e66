"""Data sets read from a path: interface of readers, the table of all, and who reads."""

import os
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Final

from spinfilters.data.dataset import Dataset
from spinfilters.data.input_file import path_text
from spinfilters.data.repeated_rates import without_repeated_rates
from spinfilters.data.sensor_format import sensor_format
from spinfilters.data.stated_values import NOTHING_STATED, ReadingOptions
from spinfilters.errors import InputError
from spinfilters.plugins import PluginGroup, by_name

OnRefused = Callable[[int, str], None]
"""Called with the number of a segment that cannot be used, and why."""


class DatasetReader(ABC):
    """Reader of one format. A subclass states its attributes, and writes `recognises` and `read`.

    Attributes
    ----------
    name: of the format.   words: what a path of it is called, with article and extension.
    order: in which readers are asked; the first that recognises a path reads it. Ours are at 0, other folders at 90, files at 100.
    has_segments: whether a recording may hold several data sets, told by number.
    """

    name: str
    words: str
    order: int = 50
    has_segments: bool = False

    @abstractmethod
    def recognises(self, path: Path) -> bool:
        """Whether a path, which need not exist, is of this format.

        Name or first bytes decide, without reading it all.
        """

    @abstractmethod
    def read(self, path: Path, segment: int | None) -> Dataset:
        """The data set. InputError: names file, line or value, and the cure."""

    def whole(self, path: Path) -> Dataset:
        """The whole recording, whatever segments are marked in it.

        Without segments it is the data set. InputError: as `read`.
        """
        return self.read(path, None)

    def stating(self, options: ReadingOptions) -> "DatasetReader":
        """The reader with what the user states of a recording.

        InputError: a format that has no use for it.
        """
        options.require_only((), self.words or "this kind of file")
        return self

    def segments(self, path: Path, on_refused: OnRefused | None) -> list[Dataset]:
        """All data sets of a recording: the only one, unless it has segments.

        Parameters
        ----------
        on_refused: called with the number of a segment that is no data set, and why, instead of raising InputError for it.
        """
        return [self.read(path, None)]


TABLE: Final = PluginGroup("spinfilters.data.readers", "READER", DatasetReader, group="spinfilters.readers")
"""All readers: one per module of that package, and those of the entry points ``spinfilters.readers``."""


def dataset_readers() -> list[DatasetReader]:
    """All readers, in the order they are asked.

    InputError: a plug-in that cannot be loaded, a name that stands twice.
    """
    return list(by_name(TABLE, "reader").values())


def reader_of(path: Path, options: ReadingOptions = NOTHING_STATED) -> DatasetReader:
    """First reader that recognises a path; the last takes any. InputError: `DatasetReader.stating`."""
    reader = next(reader for reader in dataset_readers() if reader.recognises(path))
    return reader.stating(options) if options.stated else reader


def read_dataset(
    path: str | os.PathLike[str], segment: int | None = None, options: ReadingOptions = NOTHING_STATED
) -> Dataset:
    """The data set of a path, by the reader that recognises it.

    Parameters
    ----------
    segment: number of a kept segment of a phyphox recording; None where there is only one.
    options: what its user states of the recording.

    Raises
    ------
    InputError: an unusable file (see the readers), several segments and none chosen, a segment that is not a
    trial, a kind whose front end is not part of this version. The text names file, line or value, and the
    cure.
    """
    place = Path(path)
    reader = reader_of(place, options)
    if segment is not None and not reader.has_segments:
        raise InputError(f"{path_text(place)}: has no segments; leave out --segment {segment}")
    return _told_once(reader.read(place, segment))


IMAGES: Final = "stereo images"
"""What a folder of images is called."""


def has_images(path: str | os.PathLike[str]) -> bool:
    """Whether a path is a folder of stereo images without tracks.

    A front end must follow these first.
    """
    folder = Path(path)
    return os.path.isdir(folder / "cam0" / "data") and not os.path.lexists(folder / "tracks.csv")


def read_whole(path: str | os.PathLike[str], options: ReadingOptions = NOTHING_STATED) -> Dataset:
    """The whole recording of a path, whatever segments are marked in it. Errors: `read_dataset`."""
    return _told_once(reader_of(Path(path), options).whole(Path(path)))


def read_segments(
    path: str | os.PathLike[str],
    on_refused: OnRefused | None = None,
    options: ReadingOptions = NOTHING_STATED,
) -> list[Dataset]:
    """Every kept segment of a phyphox folder, else the one data set.

    Errors: `read_dataset`.

    Parameters
    ----------
    on_refused: called with the number of a segment that is no trial, and why, instead of raising InputError for it.
    """
    found = reader_of(Path(path), options).segments(Path(path), on_refused)
    return [_told_once(each) for each in found]


def _told_once(dataset: Dataset) -> Dataset:
    """Without rows that a logger wrote again, where a sensor's format says that loggers do."""
    logged_again = any(sensor_format(name).logged_again for name in dataset.log.sensors)
    return without_repeated_rates(dataset) if logged_again else dataset
