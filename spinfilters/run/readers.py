"""All readers of recordings, all front ends of raw data, and who reads a path."""

import os
from dataclasses import replace
from pathlib import Path
from typing import Final

from spinfilters.core.errors import InputError
from spinfilters.core.plugins import entries_by_name, in_order, installed_plugins, require_made
from spinfilters.io.ardupilot_log import ArduPilotLogReader
from spinfilters.io.array_exports import ArrayExportReader
from spinfilters.io.attitude_ephemeris import AttitudeEphemerisReader
from spinfilters.io.dataset import Dataset
from spinfilters.io.dataset_folder import DatasetFolderReader, OtherFolderReader, SensorTableReader
from spinfilters.io.dataset_reader import DatasetReader, OnRefused, RawDataReader
from spinfilters.io.echoed_messages import EchoedMessagesReader
from spinfilters.io.gyroflow_log import GyroflowReader
from spinfilters.io.input_file import path_text
from spinfilters.io.labelled_lines import LabelledLinesReader
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.io.motion_file import LoggerFolderReader, MotionFileReader
from spinfilters.io.mvnx_file import MvnxReader
from spinfilters.io.number_folders import KittiFolderReader, Simulator42Reader
from spinfilters.io.phone_exports import PhoneExportReader, PhyphoxReader
from spinfilters.io.px4_log import Px4LogReader
from spinfilters.io.repeated_rows import without_repeated_rows
from spinfilters.io.ros_bag import RosBagReader
from spinfilters.io.sensor_format import sensor_format, sensor_formats
from spinfilters.io.stated_values import NOTHING_STATED, ReadingOptions
from spinfilters.io.typed_rows import TypedRowsReader
from spinfilters.io.zip_export import ZipReader


def without_repeated_rates(dataset: Dataset) -> Dataset:
    """The data set without rows that only repeat the rates before; its description says how many."""
    streams, remarks = [], []
    for stream in dataset.log.streams:
        kept, remark = without_repeated_rows(stream)
        streams.append(kept)
        remarks += [remark] if remark else []
    if not remarks:
        return dataset
    description = "; ".join(words for words in (dataset.description, *remarks) if words)
    return replace(dataset, log=MeasurementLog(tuple(streams)), description=description)


def front_ends() -> tuple[RawDataReader, ...]:
    """All makers of measurements from raw data: ours, and those of the entry points ``spinfilters.front_ends``.

    Stereo images are not among them: following their features has options of its own (`spinfilters.vision.track_images`).

    Raises
    ------
    InputError
        As `installed_plugins`.
    """
    from spinfilters.lidar.scan_streams import (  # slow to import, and few recordings are scans
        SCAN_POINTS,
        SCANS,
    )

    return (SCAN_POINTS, SCANS, *installed_plugins("spinfilters.front_ends", RawDataReader))


def front_end_of(kind: str) -> RawDataReader | None:
    """The maker of measurements from raw data of a kind, or None."""
    return next((each for each in front_ends() if each.kind == kind), None)


def dataset_readers() -> list[DatasetReader]:
    """All readers, in the order they are asked: ours, and those of the entry points ``spinfilters.readers``.

    InputError: a plug-in that cannot be loaded, a name that stands twice.
    """
    every = (*OWN_READERS, *installed_plugins("spinfilters.readers", DatasetReader))
    return list(entries_by_name(in_order(every), "reader").values())


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
    path : str or os.PathLike
        Of the recording: a folder or a file.
    segment : int or None
        Number of a kept segment of a phyphox recording; None where there is only one.
    options : ReadingOptions
        What its user states of the recording.

    Raises
    ------
    InputError
        An unusable file (see the readers), several segments and none chosen, a segment that is not a trial, a
        kind whose front end is not part of this version. The text names file, line or value, and the cure.
    """
    place = Path(path)
    reader = reader_of(place, options)
    if segment is not None and not reader.has_segments:
        raise InputError(f"{path_text(place)}: has no segments; leave out --segment {segment}")
    return _check_dataset(reader, reader.read(place, segment))


def read_whole(path: str | os.PathLike[str], options: ReadingOptions = NOTHING_STATED) -> Dataset:
    """The whole recording of a path, whatever segments are marked in it. Errors: `read_dataset`."""
    reader = reader_of(Path(path), options)
    return _check_dataset(reader, reader.whole(Path(path)))


def read_segments(
    path: str | os.PathLike[str],
    on_refused: OnRefused | None = None,
    options: ReadingOptions = NOTHING_STATED,
) -> list[Dataset]:
    """Every kept segment of a phyphox folder, else the one data set.

    Parameters
    ----------
    path : str or os.PathLike
        Of the recording.
    on_refused : OnRefused or None
        Called with the number of a segment that is no trial, and why, instead of raising InputError for it.
    options : ReadingOptions
        What its user states of the recording.

    Raises
    ------
    InputError
        As `read_dataset`.
    """
    reader = reader_of(Path(path), options)
    return [_check_dataset(reader, each) for each in reader.segments(Path(path), on_refused)]


def recordings_in(folder: Path) -> tuple[Path, ...]:
    """Recordings in a folder that is none itself, by name, which ``--segment auto`` takes together.

    Those of the commonest kind (data set folders and exports, or files of one suffix); none where there are not two.
    """
    if not os.path.isdir(folder) or _is_recording(folder):
        return ()
    by_kind: dict[str, list[Path]] = {}
    for path in sorted(folder.iterdir()):
        if _is_recording(path):
            by_kind.setdefault("" if os.path.isdir(path) else path.suffix.lower(), []).append(path)
    found = max(by_kind.values(), key=len, default=[])
    return tuple(found) if len(found) > 1 else ()


def _is_recording(path: Path) -> bool:
    """Whether a path, by its name or its files, looks like a recording."""
    reader, anything = reader_of(path), dataset_readers()[-1]
    if os.path.isdir(path):
        return reader.order < OtherFolderReader.order
    suffixes = [suffix for form in sensor_formats().values() for suffix in form.suffixes]
    return reader.name != anything.name or path.suffix.lower() in suffixes


def _check_dataset(reader: DatasetReader, dataset: Dataset) -> Dataset:
    """What a reader made, without rows that a logger wrote again, where a sensor's format says that loggers do."""
    require_made(dataset, Dataset, f"reader {reader.name!r}")
    logged_again = any(sensor_format(name).logged_again for name in dataset.log.sensors)
    return without_repeated_rates(dataset) if logged_again else dataset


OWN_READERS: Final[tuple[DatasetReader, ...]] = (
    DatasetFolderReader(front_end_of),
    OtherFolderReader(recordings_in),
    MotionFileReader(),
    ArrayExportReader(),
    Px4LogReader(),
    ArduPilotLogReader(),
    LoggerFolderReader(),
    KittiFolderReader(),
    Simulator42Reader(),
    TypedRowsReader(),
    LabelledLinesReader(),
    AttitudeEphemerisReader(),
    EchoedMessagesReader(),
    GyroflowReader(),
    MvnxReader(),
    PhoneExportReader(),
    PhyphoxReader(),
    RosBagReader(),
    SensorTableReader(dataset_readers),
    ZipReader(reader_of=reader_of),
)
"""Ours. Three of them ask the others, which they are given here: what a folder or an archive holds, and what can be read at all."""
