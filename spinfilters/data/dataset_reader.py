"""Interface of data-set readers, and the table of all."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Final

from spinfilters.data.dataset import Dataset
from spinfilters.data.reading_options import NOTHING_STATED, ReadingOptions
from spinfilters.plugins import PluginGroup, by_name

OnRefused = Callable[[int, str], None]
"""Called with the number of a segment that cannot be used, and why."""


class DatasetReader(ABC):
    """Reader of one format. A subclass states its attributes, and writes `recognises` and `read`.

    Attributes
    ----------
    name: of the format.   words: what a path of it is called, with article and extension.
    order: in which readers are asked; the first that recognises a path reads it. Folders are ours at 90, files at 100.
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
