"""A data set as a folder with `dataset.toml` and a table per sensor, read and written, or as the table of one sensor."""

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import (
    DATASET_FILE,
    INSPECTOR_FILE,
    LANDMARK_FILE,
    PHYPHOX_TABLE,
    Dataset,
    DatasetOptions,
    calibrations_of,
    options_from_toml,
    require_cover,
    with_stated_deviations,
)
from spinfilters.io.dataset_reader import RawDataReader
from spinfilters.io.input_file import (
    path_text,
    printable,
    read_toml,
    reason,
    require_file,
    require_folder,
    value_text,
)
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.io.output_files import make_folder, write_toml
from spinfilters.io.sensor_format import (
    SensorFormat,
    dataset_kinds,
    kind_called,
    sensor_format,
    sensor_formats,
)
from spinfilters.io.sensor_tables import (
    read_landmarks,
    read_sensor_file,
    read_tum,
    with_covariance,
    write_covariance,
    write_landmarks,
    write_sensor_file,
    write_tum,
)
from spinfilters.io.table_layout import read_header
from spinfilters.io.truth import TRUTH_BODY, TRUTH_FILES, TRUTH_TABLE, Truth, read_truth, write_truth

_FRONT_ENDS = {
    "stereo-images": "tracks.csv with kind = 'stereo-tracks' ('spinfilters track' makes it of images in cam0/data and cam1/data)",
    "lidar-scans": "poses.tum of the registered scans with kind = 'pose'",
}


def read_folder(folder: Path, front_end: Callable[[str], RawDataReader | None]) -> Dataset:
    """Data set of a folder with dataset.toml: whatever else lies there is part of it.

    Parameters
    ----------
    folder : Path
        The folder.
    front_end : Callable[[str], RawDataReader | None]
        Gives the maker of measurements from raw data of a kind, None where there is none.

    Raises
    ------
    InputError
        A file that is damaged or missing; a kind that is not known.
    """
    require_folder(folder)
    kinds = dataset_kinds()
    path = folder / DATASET_FILE
    document = read_toml(path)
    kind, description = _text(path, document, "kind"), _text(path, document, "description", "")
    kind = kind_called(kind)
    reader = None if kind in kinds else front_end(kind)
    if reader is not None:
        return _read_raw(folder, reader, description, options_from_toml(path, document))
    if kind in _FRONT_ENDS:
        raise _no_front_end(path, kind)
    if kind not in kinds:
        raise InputError(
            f"{path_text(path)}: kind is {value_text(kind)}, expected one of {', '.join(kinds)}; correct it"
        )
    log = MeasurementLog(
        tuple(_with_own_covariance(form, folder) for form in _stored_formats(folder, kinds[kind]))
    )
    options = options_from_toml(path, document)
    landmarks, cameras = folder / LANDMARK_FILE, calibrations_of(log)
    return Dataset(
        kind=kind,
        log=log,
        path=folder,
        description=description,
        truth=_truth_of(folder),
        rig=cameras[0].read(folder) if cameras else None,
        known_map=read_landmarks(landmarks) if os.path.lexists(landmarks) else None,
        inspector=_covering_inspector(folder, log),
        options=with_stated_deviations(options, folder) if cameras else options,
    )


def undescribed_folder(folder: Path, recordings: Sequence[Path]) -> InputError:
    """The refusal of a folder without dataset.toml, by what lies there instead, such as recordings."""
    if os.path.isfile(folder / "cam0" / "data.csv"):
        return _no_front_end(folder, "stereo-images")
    if recordings:
        such = f"{len(recordings)} recordings, such as {printable(recordings[0].name)}"
        return InputError(
            f"{path_text(folder)}: holds {such}; give one of them, or take the free flights in all with --segment auto"
        )
    return InputError(
        f"{path_text(folder / DATASET_FILE)}: no such file; write it with a line kind = '...' "
        f"({', '.join(dataset_kinds())}), or check the path"
    )


def _read_raw(folder: Path, reader: RawDataReader, description: str, options: DatasetOptions) -> Dataset:
    """Measurements made from raw data, with those of other sensors in the folder."""
    made = reader.read(folder, _truth_of(folder))
    read = [_with_own_covariance(form, folder) for form in _stored_formats(folder, None)]
    log = MeasurementLog((made.stream, *read))
    options = replace(options, covariance_inflation=made.inflation)
    cameras = calibrations_of(log)
    return Dataset(
        kind=reader.made,
        log=log,
        path=folder,
        description="; ".join(words for words in (description, *made.remarks) if words),
        truth=made.truth,
        rig=cameras[0].read(folder) if cameras else None,
        inspector=_covering_inspector(folder, log) if cameras else None,
        options=with_stated_deviations(options, folder) if cameras else options,
        doubts=made.doubts,
    )


def _truth_of(folder: Path) -> Truth | None:
    """Truth of a folder, None without its files. InputError: `read_truth`."""
    return read_truth(folder) if any(os.path.lexists(folder / name) for name in TRUTH_FILES) else None


def read_inspector(folder: Path) -> MeasurementStream | None:
    """Known poses (t_ic m, q_ic) of a moving camera, as its folder has them; None of a camera at rest.

    Data sets of tracks and folders of images both ask here; another format of such poses is one more file that is looked for.

    Raises
    ------
    InputError
        As `read_tum`.
    """
    path = folder / INSPECTOR_FILE
    return read_tum(path) if os.path.lexists(path) else None


def _covering_inspector(folder: Path, log: MeasurementLog) -> MeasurementStream | None:
    """Poses of `read_inspector` that cover a log. InputError: as there, and of `require_cover`."""
    stream = read_inspector(folder)
    if stream is None:
        return None
    try:
        require_cover(stream, log)
    except InputError as error:
        raise InputError(f"{path_text(folder / INSPECTOR_FILE)}: {error}") from None
    return stream


def _with_own_covariance(form: SensorFormat, folder: Path) -> MeasurementStream:
    """Stream of a sensor with the covariances of its rows, if any."""
    stream, covariance = read_sensor_file(form, folder / form.file), folder / form.covariance_file
    return with_covariance(stream, covariance) if os.path.lexists(covariance) else stream


def _stored_formats(folder: Path, required: SensorFormat | None) -> list[SensorFormat]:
    """The formats whose files a folder holds.

    Among formats with the same file it is the required one's, or has the header of one.
    """
    by_file: dict[str, list[SensorFormat]] = {}
    for form in sensor_formats().values():
        by_file.setdefault(form.file, []).append(form)
    found = []
    for file, formats in by_file.items():
        if required is not None and required in formats:
            found.append(required)
        elif os.path.lexists(folder / file):
            fits = [
                form for form in formats if len(formats) == 1 or read_header(folder / file) == form.header
            ]
            found.append([*formats, *fits][-1])
    return found


def _no_front_end(path: Path, kind: str) -> InputError:
    return InputError(
        f"{path_text(path)}: kind '{kind}' needs a front end that is not part of this version; supply "
        f"{_FRONT_ENDS[kind]}"
    )


def _text(path: Path, document: dict[str, Any], key: str, default: str | None = None) -> str:
    value = document.get(key, default)
    if value is None:
        kinds = ", ".join(dataset_kinds())
        raise InputError(f"{path_text(path)}: has no {key}; add {key} = '...', one of {kinds}")
    if not isinstance(value, str):
        raise InputError(f"{path_text(path)}: {key} is {value_text(value)}, expected text; put it in quotes")
    return value


_LARGEST_FILE = 2**63  # the reader that follows has its own limit


def read_sensor_table(path: Path, readable: Callable[[], Iterable[str]]) -> Dataset:
    """Data set of the table of one sensor, which is known by its suffix.

    Parameters
    ----------
    path : Path
        The table.
    readable : Callable[[], Iterable[str]]
        Gives the words for all formats of recordings, for the refusal of other files.

    Raises
    ------
    InputError
        A file that is none, a part of a data set, or of no known suffix.
    """
    require_file(path, _LARGEST_FILE)
    formats = sensor_formats().values()
    parts = [form.file for form in formats if not form.suffixes]
    if path.name in (DATASET_FILE, LANDMARK_FILE, INSPECTOR_FILE, TRUTH_TABLE, *parts):
        raise InputError(f"{path_text(path)}: is one part of a data set; give the folder that holds it")
    form = next((form for form in formats if path.suffix.lower() in form.suffixes), None)
    if form is None:
        raise InputError(
            f"{path_text(path)}: {value_text(path.suffix)} is no known kind of file; "
            f"give {_readable(readable())}, and unpack archives first"
        )
    log = MeasurementLog((read_sensor_file(form, path),))
    return Dataset(kind=form.kind, log=log, path=path, description=printable(path.name))


def _readable(words: Iterable[str]) -> str:
    """List of the formats that can be read."""
    singles = [form.suffix_words for form in sensor_formats().values() if form.suffixes]
    *others, last = [*dict.fromkeys(filter(None, words)), *singles]
    return f"{', '.join(others)} or {last}"


def dataset_files() -> tuple[str, ...]:
    """Every file that `write_dataset` may write, relative to the folder."""
    formats = sorted(sensor_formats().values(), key=lambda each: each.file)
    files = [name for each in formats for name in (each.file, each.covariance_file)]
    cameras = [each.calibration for each in formats if each.calibration is not None]
    files += [str(file) for calibration in cameras for file in calibration.files]
    return (*dict.fromkeys(files), TRUTH_TABLE, TRUTH_BODY, LANDMARK_FILE, INSPECTOR_FILE, DATASET_FILE)


def write_dataset(dataset: Dataset, folder: Path) -> None:
    """Write dataset.toml and the tables of the data set.

    A data set of the same files is replaced.
    Each file is atomic; dataset.toml goes first and comes last: a folder left half written is no data set.

    Raises
    ------
    InputError
        Disk full or no permission; a folder with a file that would be read as part of this data set but is not.
    """
    make_folder(folder)
    _refuse_leftovers(dataset, folder)
    path = folder / DATASET_FILE
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(
            f"{path_text(path)}: cannot be replaced ({reason(error)}); choose another folder"
        ) from None
    for stream in dataset.log.streams:
        form = sensor_format(stream.sensor)
        write_sensor_file(form, folder / form.file, stream)
        if stream.covariance is not None:
            write_covariance(folder / form.covariance_file, stream)
    for calibration in dataset.calibrations:
        calibration.write(dataset.rig, folder)
    if dataset.truth is not None:
        write_truth(dataset.truth, folder)
    if dataset.known_map is not None:
        write_landmarks(folder / LANDMARK_FILE, dataset.known_map)
    if dataset.inspector is not None:
        write_tum(folder / INSPECTOR_FILE, dataset.inspector)
    write_toml(path, {"kind": dataset.kind, "description": dataset.description} | dataset.options.document)


def _refuse_leftovers(dataset: Dataset, folder: Path) -> None:
    written = _written_files(dataset)
    for name in (*dataset_files(), PHYPHOX_TABLE):
        if name not in written and os.path.lexists(folder / name):
            raise InputError(
                f"{path_text(folder / name)}: is not of the data set to be written; "
                "delete it or choose another folder"
            )


def _written_files(dataset: Dataset) -> set[str]:
    names = {DATASET_FILE, *(sensor_format(sensor).file for sensor in dataset.log.sensors)}
    names |= {
        sensor_format(s.sensor).covariance_file for s in dataset.log.streams if s.covariance is not None
    }
    names |= {str(file) for calibration in dataset.calibrations for file in calibration.files}
    if dataset.truth is not None:
        names |= {TRUTH_TABLE} | ({TRUTH_BODY} if dataset.truth.body else set())
    if dataset.known_map is not None:
        names.add(LANDMARK_FILE)
    if dataset.inspector is not None:
        names.add(INSPECTOR_FILE)
    return names
