"""A data set as a folder, which `read_dataset` reads back bit for bit."""

import os
from pathlib import Path
from typing import Final

from spinfilters.errors import InputError
from spinfilters.logs.atomic_write import make_folder, write_toml
from spinfilters.logs.camera import RIG_FILES, write_stereo_rig
from spinfilters.logs.covariance_files import write_covariance
from spinfilters.logs.dataset import DATASET_FILE, LANDMARK_FILE, SENSOR_FILES, Dataset
from spinfilters.logs.gyro_files import PHYPHOX_TABLE
from spinfilters.logs.input_file import named, reason
from spinfilters.logs.track_files import write_landmarks
from spinfilters.logs.truth import TRUTH_BODY, TRUTH_TABLE, write_truth

DATASET_FILES: Final[tuple[str, ...]] = (
    *(name for file in SENSOR_FILES.values() for name in (file.name, file.covariance)),
    *(str(file) for file in RIG_FILES),
    *(TRUTH_TABLE, TRUTH_BODY, LANDMARK_FILE, DATASET_FILE),
)
"""Every file that `write_dataset` may write, relative to the folder."""


def write_dataset(dataset: Dataset, folder: Path) -> None:
    """Write dataset.toml and the tables of the data set, replacing a data set of the same files.

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
            f"{named(path)}: cannot be replaced ({reason(error)}); choose another folder"
        ) from None
    for stream in dataset.log.streams:
        file = SENSOR_FILES[stream.sensor]
        file.write(folder / file.name, stream)
        if stream.covariance is not None:
            write_covariance(folder / file.covariance, stream)
    if dataset.rig is not None:
        write_stereo_rig(dataset.rig, folder)
    if dataset.truth is not None:
        write_truth(dataset.truth, folder)
    if dataset.known_map is not None:
        write_landmarks(folder / LANDMARK_FILE, dataset.known_map)
    write_toml(path, {"kind": dataset.kind, "description": dataset.description} | dataset.options.document)


def _refuse_leftovers(dataset: Dataset, folder: Path) -> None:
    for name in (*DATASET_FILES, PHYPHOX_TABLE):
        if name not in _written(dataset) and os.path.lexists(folder / name):
            raise InputError(
                f"{named(folder / name)}: is not of the data set to be written; "
                "delete it or choose another folder"
            )


def _written(dataset: Dataset) -> set[str]:
    names = {DATASET_FILE, *(SENSOR_FILES[sensor].name for sensor in dataset.log.sensors)}
    names |= {SENSOR_FILES[s.sensor].covariance for s in dataset.log.streams if s.covariance is not None}
    if dataset.rig is not None:
        names |= {str(file) for file in RIG_FILES}
    if dataset.truth is not None:
        names |= {TRUTH_TABLE} | ({TRUTH_BODY} if dataset.truth.body else set())
    if dataset.known_map is not None:
        names.add(LANDMARK_FILE)
    return names
