"""The trials in a phyphox recording: its kept segments as gyro streams."""

from pathlib import Path

from spinfilters.data.dataset_reader import OnRefused
from spinfilters.data.gyro_files import PhyphoxRecording, Segment, read_phyphox
from spinfilters.data.input_file import path_text, value_text
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.data.time_stamps import require_two_epochs
from spinfilters.errors import InputError

Trial = tuple[MeasurementStream, Segment | None]
"""Gyro measurements, and the segment they are: None for a recording in which none is marked."""
_MOST_DESCRIBED = 8  # segments that an error describes; of more it gives the numbers only


def phyphox_trial(folder: Path, number: int | None) -> Trial:
    """The kept segment of that number; with None the only one, or the whole recording where none is marked.

    Raises
    ------
    InputError: as `read_phyphox`; several kept segments and none chosen; no such segment; one that is not a
    trial; one outside the recording.
    """
    recording = read_phyphox(folder)
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
    return _trial(folder, recording, chosen[0])


def phyphox_trials(folder: Path, on_refused: OnRefused | None = None) -> list[Trial]:
    """Every kept segment, or the whole recording where none is marked. InputError: as `phyphox_trial`.

    Parameters
    ----------
    on_refused: called with the number of a kept segment that is no trial, and why, instead of raising InputError for it.
    """
    recording = read_phyphox(folder)
    kept = _kept(recording)
    if not kept:
        return [_only_trial(folder, recording)]
    trials: list[Trial] = []
    for segment in kept:
        try:
            trials.append(_trial(folder, recording, segment))
        except InputError as error:
            if on_refused is None:
                raise
            on_refused(segment.number, str(error))
    return trials


def _only_trial(folder: Path, recording: PhyphoxRecording) -> Trial:
    kept = _kept(recording)
    if not recording.segments:
        return MeasurementStream("gyro", recording.time, recording.rate), None
    if not kept:
        raise InputError(
            f"{path_text(folder)}: meta/segments.csv keeps no segment, so there is no trial; keep one of them"
        )
    if len(kept) > 1:
        raise InputError(
            f"{path_text(folder)}: holds {len(kept)} segments; choose one with --segment: {_listed(recording)}; "
            "or take all of them"
        )
    return _trial(folder, recording, kept[0])


def _trial(folder: Path, recording: PhyphoxRecording, segment: Segment) -> Trial:
    start, end = float(recording.time[0]), float(recording.time[-1])
    first = start if segment.start is None else segment.start
    last = end if segment.end is None else segment.end
    stream = MeasurementStream("gyro", recording.time, recording.rate).slice(first, last)
    if stream is None:
        raise InputError(
            f"{path_text(folder)}: segment {segment.number} runs from {segment.start} s to {segment.end} s, "
            f"the recording from {start} s to {end} s; correct meta/segments.csv"
        )
    require_two_epochs(folder / f"segment {segment.number}", len(stream))
    return stream, segment


def _kept(recording: PhyphoxRecording) -> list[Segment]:
    return [segment for segment in recording.segments if segment.keep]


def _listed(recording: PhyphoxRecording) -> str:
    kept = _kept(recording)
    if len(kept) > _MOST_DESCRIBED:
        return ", ".join(str(segment.number) for segment in kept)
    described = [f"{s.number} ({value_text(s.comment)[1:-1]}, {s.start} s to {s.end} s)" for s in kept]
    return ", ".join(described) or "none: the recording has no kept segment"
