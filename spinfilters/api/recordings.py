"""Data sets read from files or from tables in memory, and written."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from spinfilters.core.errors import InputError
from spinfilters.io.argument_checks import (
    KIND,
    checked_arguments,
    is_path,
    one_of,
    optional,
    path,
    refuse,
    text,
)
from spinfilters.io.dataset import Dataset
from spinfilters.io.dataset_folder import write_dataset
from spinfilters.io.dataset_reader import IMAGES, has_images
from spinfilters.io.input_file import value_text
from spinfilters.io.stated_values import RATE_UNITS, ReadingOptions
from spinfilters.run.bag_recording import unpacked_recording
from spinfilters.run.readers import read_dataset


@checked_arguments(
    ReadingOptions,
    kind=optional(text(KIND)),
    segment=optional(one_of(int, str, cure='a number, times such as "6.55:7.4", or "auto"')),
)
def load(
    path: Any,
    segment: int | str | None = None,
    *,
    kind: str | None = None,
    units: str | Mapping[str, str] | None = None,
    unit: str | None = None,
    clock: str | None = None,
    rate: float | None = None,
    topic: str | None = None,
    columns: str | None = None,
    rig: str | None = None,
) -> Dataset:
    """Data set of a folder or file, or of a table in memory.

    Whatever ``spinfilters compare`` reads; of stereo images it is their tracks.

    Parameters
    ----------
    path : str, os.PathLike, data frame, mapping or array
        A table in memory, see `Dataset.from_dataframe`; or the path of a folder with ``dataset.toml``, a phone's export or a zip
        of it, a ``.csv`` with columns by name (a clock and three body rates, or poses), a TUM ``.tum`` or ``.txt`` of poses, a
        ROS bag.
    segment : int, str or None
        Number of a marked segment of a phyphox recording or else of a free flight, times such as "6.55:7.4" (s), or "auto" for the
        only free flight; None for the whole.
    kind : str or None
        Of a table in memory whose names do not identify it, such as "gyro".
    units : str, Mapping or None
        What ``unit`` and ``clock`` say in one: "deg/s", or ``{"time": "ms", "rate": "deg/s"}``.
    unit : str or None
        Of body rates or positions whose header states none, such as "deg/s".
    clock : str or None
        Unit of time stamps, such as "ms".
    rate : float or None
        Samples a second, Hz, of a table without a clock.
    topic : str or None
        Of a ROS bag; of images two with a comma, left first. Also a body of a table, or a segment of an Xsens MVN.
    columns : str or None
        Names of the columns of a table without a header, such as "t,x,y,z".
    rig : str or None
        Folder with the calibration of a bag's images, where the bag has no ``camera_info``.

    Returns
    -------
    Dataset
        With its measurements by sensor, and what the recording states of noise and camera.

    Raises
    ------
    InputError
        An unusable file, no such segment, a unit in doubt; the text names file, line or value, and the cure.
    """
    if units is not None:
        if unit is not None or clock is not None:
            raise InputError("units says what unit and clock say; give one of them")
        from spinfilters.io.memory_tables import reading_options

        stated = reading_options(units, rate)
        unit, clock = stated.unit, stated.clock
    options = ReadingOptions(unit, clock, rate, topic, columns, rig)
    if not is_path(path):
        return _in_memory(path, kind, options, segment)
    if kind is not None:
        raise InputError(
            f"kind {value_text(kind)} is for tables in memory; a file states its own: leave it out"
        )
    if segment is not None:
        from spinfilters.api.arguments import SEGMENT
        from spinfilters.run.segment_choice import read_chosen, segment_choice

        if not isinstance(segment, str):
            SEGMENT.require("segment", segment)
        return read_chosen(path, segment_choice(segment), options)
    path, options = unpacked_recording(path, options)
    if has_images(path):
        options.require_only((), IMAGES)
        from spinfilters.vision.track_images import track_images

        return track_images(Path(path)).dataset
    return read_dataset(path, options=options)


def _in_memory(table: Any, kind: str | None, options: ReadingOptions, segment: int | str | None) -> Dataset:
    """Data set of a table in memory. InputError: no table; statements and segments that are of files."""
    from spinfilters.io.memory_tables import WHAT_TO_GIVE, is_table

    if not is_table(table):
        refuse("path", table, WHAT_TO_GIVE)
    if segment is not None:
        raise InputError(f"segment {segment} is of a recording's file; cut the table instead")
    options.require_only(("unit", "clock", "rate"), "a table in memory")
    units: dict[str, str] = {} if options.clock is None else {"time": options.clock}
    if options.unit is not None:
        units["rate" if options.unit in RATE_UNITS else "position"] = options.unit
    return Dataset.from_dataframe(table, kind, units=units or None, rate=options.rate)


@checked_arguments(
    dataset=one_of(Dataset, cure="a data set, as load and simulate return it"),
    folder=path("a folder"),
)
def save(dataset: Dataset, folder: str | os.PathLike[str]) -> Path:
    """Write a data set as a folder, which ``load`` and ``spinfilters compare`` read.

    Parameters
    ----------
    dataset : Dataset
        With its truth, map and inspector, where it has these.
    folder : str or os.PathLike
        New, or of an earlier data set with the same files, which is replaced.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    InputError
        Disk full or no permission; a folder with a file that is not of this data set but would be read as part of it.
    """
    written = Path(folder)
    write_dataset(dataset, written)
    return written
