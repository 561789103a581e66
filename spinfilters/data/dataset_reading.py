"""Data sets read from a path, by the reader that recognises it."""

import os
from pathlib import Path

from spinfilters.data.dataset import Dataset
from spinfilters.data.dataset_reader import OnRefused, reader_of
from spinfilters.data.input_file import path_text
from spinfilters.data.reading_options import NOTHING_STATED, ReadingOptions
from spinfilters.errors import InputError


def read_dataset(
    path: str | os.PathLike[str], segment: int | None = None, options: ReadingOptions = NOTHING_STATED
) -> Dataset:
    """The data set of a path, by the reader that recognises it (`spinfilters.data.dataset_reader`).

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
    return reader.read(place, segment)


def has_images(path: str | os.PathLike[str]) -> bool:
    """Whether a path is a folder of stereo images without tracks.

    A front end must follow these first.
    """
    folder = Path(path)
    return os.path.isdir(folder / "cam0" / "data") and not os.path.lexists(folder / "tracks.csv")


def read_whole(path: str | os.PathLike[str], options: ReadingOptions = NOTHING_STATED) -> Dataset:
    """The whole recording of a path, whatever segments are marked in it. Errors: `read_dataset`."""
    return reader_of(Path(path), options).whole(Path(path))


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
    return reader_of(Path(path), options).segments(Path(path), on_refused)
