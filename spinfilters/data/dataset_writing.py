"""A data set as a folder, which `read_dataset` reads back bit for bit."""

import os
from pathlib import Path

from spinfilters.data.atomic_write import make_folder, write_toml
from spinfilters.data.covariance_files import write_covariance
from spinfilters.data.dataset import DATASET_FILE, INSPECTOR_FILE, LANDMARK_FILE, PHYPHOX_TABLE, Dataset
from spinfilters.data.input_file import path_text, reason
from spinfilters.data.known_map import write_landmarks
from spinfilters.data.pose_files import write_tum
from spinfilters.data.sensor_files import write_sensor_file
from spinfilters.data.sensor_format import sensor_format, sensor_formats
from spinfilters.data.truth import TRUTH_BODY, TRUTH_TABLE, write_truth
from spinfilters.errors import InputError


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
    InputError: disk full or no permission; a folder with a file that would be read as part of this data set
    but is not.
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
    for name in (*dataset_files(), PHYPHOX_TABLE):
        if name not in _written(dataset) and os.path.lexists(folder / name):
            raise InputError(
                f"{path_text(folder / name)}: is not of the data set to be written; "
                "delete it or choose another folder"
            )


def _written(dataset: Dataset) -> set[str]:
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
