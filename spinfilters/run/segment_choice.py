"""Segments of a recording that a user asks for.

A number, times, all that are marked, all flights that are found.
"""

import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset, Segment
from spinfilters.io.dataset_reader import OnRefused
from spinfilters.io.input_file import path_text, value_text
from spinfilters.io.stated_values import NOTHING_STATED, ReadingOptions
from spinfilters.run.free_flight import FreeFlight, find_flights, flying_unit
from spinfilters.run.readers import read_dataset, read_segments, read_whole, reader_of, recordings_in

ALL: Final = "all"
AUTO: Final = "auto"
_NUMBER = re.compile(r"[0-9]{1,9}")


@dataclass(frozen=True)
class SegmentChoice:
    """Segments chosen by ``--segment``.

    Attributes
    ----------
    several : str
        "all" or "auto", which are any number of segments; empty for one.
    number : int or None
        Of one.
    stretch : Segment or None
        Times of one, where it has no number.
    """

    several: str = ""
    number: int | None = None
    stretch: Segment | None = None


def segment_choice(text: str | int) -> SegmentChoice:
    """The segment choice of a text.

    ``auto``, ``all``, a number, or times such as ``6.55:7.4``. InputError: any other.
    """
    words = str(text).strip()
    if words in (ALL, AUTO):
        return SegmentChoice(several=words)
    if _NUMBER.fullmatch(words):
        return SegmentChoice(number=int(words))
    start, colon, end = words.partition(":")
    times = [_seconds(start), _seconds(end)]
    if not colon or any(time is not None and math.isnan(time) for time in times) or times == [None, None]:
        raise InputError(
            f"--segment {value_text(text)} is no segment; give a number, times START:END in s, 'all' or 'auto'"
        )
    first, last = times
    if first is not None and last is not None and first >= last:
        raise InputError(f"--segment {value_text(text)} ends before it starts; give START:END in s")
    return SegmentChoice(stretch=Segment(None, first, last, True, ""))


def read_chosen(
    path: str | os.PathLike[str], choice: SegmentChoice, options: ReadingOptions = NOTHING_STATED
) -> Dataset:
    """The one segment of a choice; of ``auto`` or ``all`` it must be the only one.

    Raises
    ------
    InputError
        As `read_dataset` and `find_flights`; no such segment, or several of them.
    """
    if choice.stretch is not None:
        return read_whole(path, options).part(choice.stretch)
    if choice.number is None:
        several = read_several(path, choice.several, options)
        if len(several) > 1:
            raise InputError(
                f"{path_text(Path(path))}: holds {len(several)} segments; choose one by its number"
            )
        return several[0]
    if has_marks(path, options):
        return read_dataset(path, choice.number, options)
    flights = flight_segments(read_whole(path, options))
    found = next((each for each in flights if each.segment and each.segment.number == choice.number), None)
    if found is None:
        raise InputError(
            f"{path_text(Path(path))}: has no segment {choice.number}; found are 1 to {len(flights)}: "
            "'spinfilters segments' lists them"
        )
    return found


def read_several(
    path: str | os.PathLike[str],
    which: str,
    options: ReadingOptions = NOTHING_STATED,
    on_refused: OnRefused | None = None,
) -> list[Dataset]:
    """All segments that are marked (``all``), or found (``auto``) in each of a folder of recordings.

    Parameters
    ----------
    on_refused : OnRefused or None
        Called with the number and the reason of what is no segment, or of a recording without any, instead of raising.

    Raises
    ------
    InputError
        As `read_chosen`.
    """
    if which == AUTO:
        recordings = recordings_in(Path(path))
        if recordings and on_refused is not None:
            return _of_recordings(recordings, options, on_refused)
        return flight_segments(read_whole(path, options))
    return read_segments(path, on_refused, options)


def _of_recordings(
    recordings: Sequence[Path], options: ReadingOptions, on_refused: OnRefused
) -> list[Dataset]:
    """The free flights of all recordings, numbered through."""
    found, number = [], 0
    for path in recordings:
        try:
            flights = flight_segments(read_whole(path, options))
        except InputError as error:
            number += 1
            on_refused(number, str(error))
            continue
        for flight in flights:
            number += 1
            assert flight.segment is not None
            found.append(replace(flight, segment=replace(flight.segment, number=number)))
    return found


def flight_segments(whole: Dataset) -> list[Dataset]:
    """The free flights of a recording as data sets from 1. InputError: as `find_flights`; none is found."""
    flights = find_flights(whole)
    if not flights:
        raise no_flight(whole)
    return [_part(whole, number, flight) for number, flight in enumerate(flights, start=1)]


def no_flight(whole: Dataset) -> InputError:
    """InputError for a recording without free flight."""
    duration = whole.log.end - whole.log.start
    if advice := flying_unit(whole):
        return InputError(f"{whole.name}: no free flight found in {duration:.4g} s; it looks as if {advice}")
    return InputError(
        f"{whole.name}: no free flight found in {duration:.4g} s; give its times as --segment START:END, or "
        "leave --segment out for the whole recording"
    )


def _part(whole: Dataset, number: int, flight: FreeFlight) -> Dataset:
    segment = flight.segment(number)
    description = f"{whole.description}, {segment.label}: {segment.comment}"
    return replace(whole.part(segment), description=description)


def has_marks(path: str | os.PathLike[str], options: ReadingOptions) -> bool:
    """Whether somebody has marked segments in a recording."""
    reader = reader_of(Path(path), options)
    if not reader.has_segments:
        return False
    refused: list[int] = []
    found = reader.segments(Path(path), lambda number, _why: refused.append(number))
    return bool(refused) or any(dataset.segment is not None for dataset in found)


def _seconds(text: str) -> float | None:
    """A time, None of an empty text, not a number of any other text."""
    if not text:
        return None
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan
