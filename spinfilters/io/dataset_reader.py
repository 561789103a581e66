"""Interfaces of readers of recordings, and of front ends that make measurements from raw data.

All of ours are named in `spinfilters.run.readers`.
"""

import os
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import first_bytes
from spinfilters.io.stated_values import NOTHING_STATED, ReadingOptions

if TYPE_CHECKING:
    from spinfilters.io.measurement_log import MeasurementStream
    from spinfilters.io.truth import Truth


OnRefused = Callable[[int, str], None]
"""Called with the number of a segment that cannot be used, and why."""


def is_file_named(path: Path, suffixes: tuple[str, ...]) -> bool:
    """Whether a path, which need not exist, has one of the suffixes, in lower case with the dot, and is no folder."""
    return path.suffix.lower() in suffixes and not os.path.isdir(path)


class DatasetReader(ABC):
    """Reader of one format. A subclass states its attributes and writes `read`.

    A file is of the format by `suffixes` and `magic`, a folder by what it `holds`; what is recognised otherwise overrides
    `recognises`. What only `read` needs is best imported there: every reader is asked for every recording.

    Attributes
    ----------
    name : str
        Of the format.
    words : str
        What a path of it is called, with article and extension.
    order : int
        In which readers are asked; the first that recognises a path reads it. Ours are at 0, other folders at 90,
        files at 100.
    has_segments : bool
        Whether a recording may hold several data sets, chosen by number.
    suffixes : tuple of str
        Of its files, in lower case with the dot. No run is saved as such a file.
    magic : tuple of bytes
        First bytes, of which a file must have some; by default any are taken, and `read` refuses the wrong ones.
    holds : tuple of str
        Paths of files in a folder of the format, which has at least one of them.
    """

    name: str
    words: str
    order: int = 50
    has_segments: bool = False
    suffixes: tuple[str, ...] = ()
    magic: tuple[bytes, ...] = ()
    holds: tuple[str, ...] = ()

    def recognises(self, path: Path) -> bool:
        """Whether a path, which need not exist, is of this format, judged by names or its first bytes alone."""
        if not is_file_named(path, self.suffixes):
            return self.held(path) is not None
        return not self.magic or first_bytes(path, max(map(len, self.magic))).startswith(self.magic)

    def held(self, path: Path) -> Path | None:
        """The first of the files in a folder by which it is of this format."""
        return next((path / name for name in self.holds if os.path.isfile(path / name)), None)

    @abstractmethod
    def read(self, path: Path, segment: int | None) -> Dataset:
        """The data set. InputError: names file, line or value, and the cure."""

    def whole(self, path: Path) -> Dataset:
        """The whole recording, whatever segments are marked in it.

        Without segments it is the data set. InputError: as `read`.
        """
        return self.read(path, None)

    def stating(self, options: ReadingOptions) -> "DatasetReader":
        """The reader with what the user states about a recording.

        Raises
        ------
        InputError
            Options that this format does not take.
        """
        options.require_only((), self.words or "this kind of file")
        return self

    def segments(self, path: Path, on_refused: OnRefused | None) -> list[Dataset]:
        """All data sets of a recording: the only one, unless it has segments.

        Parameters
        ----------
        on_refused : OnRefused | None
            Called with the number of a segment that is no data set, and why, instead of raising InputError for
            it.
        """
        return [self.read(path, None)]


@dataclass(frozen=True)
class StatedReader(DatasetReader):
    """Reader of a format that has a use for what the user states of a recording.

    Attributes
    ----------
    options : ReadingOptions
        What the user states; `read` refuses what is of no use (`ReadingOptions.require_only`).
    """

    options: ReadingOptions = NOTHING_STATED

    def stating(self, options: ReadingOptions) -> DatasetReader:
        """The same reader with what the user states about a recording."""
        return replace(self, options=options)


IMAGES: Final = "stereo images"
"""What a folder of images is called."""


def has_images(path: str | os.PathLike[str]) -> bool:
    """Whether a path is a folder of stereo images without tracks, which a front end must extract first."""
    folder = Path(path)
    return os.path.isdir(folder / "cam0" / "data") and not os.path.lexists(folder / "tracks.csv")


@dataclass(frozen=True, eq=False)
class RawMeasurements:
    """Measurements made from raw data.

    Attributes
    ----------
    stream : MeasurementStream
        The measurements.
    truth : Truth | None
        Expressed in the stream's frame g.
    remarks : tuple[str, ...]
        What was left out or not determined.
    doubts : tuple[str, ...]
        Reasons why no estimate from this stream is to be trusted.
    """

    stream: "MeasurementStream"
    truth: "Truth | None" = None
    remarks: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    inflation: float = 1.0


@dataclass(frozen=True)
class RawDataReader:
    """Maker of measurement streams from a folder's raw data.

    Attributes
    ----------
    kind : str
        In dataset.toml.
    made : str
        Kind of the data set that comes out.
    read : Callable[[Path, Truth | None], RawMeasurements]
        Of a folder with its truth, or None.
    """

    kind: str
    made: str
    read: "Callable[[Path, Truth | None], RawMeasurements]"
