"""Interface of readers of recordings; all of them stand in `spinfilters.pipeline.readers`."""

import os
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Final

from spinfilters.data.dataset import Dataset
from spinfilters.data.stated_values import ReadingOptions

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


IMAGES: Final = "stereo images"
"""What a folder of images is called."""


def has_images(path: str | os.PathLike[str]) -> bool:
    """Whether a path is a folder of stereo images without tracks.

    A front end must follow these first.
    """
    folder = Path(path)
    return os.path.isdir(folder / "cam0" / "data") and not os.path.lexists(folder / "tracks.csv")
