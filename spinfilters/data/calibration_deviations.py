"""Uncertainty that a camera's calibration files state, as consider parameters."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from spinfilters.data.camera import RIG_FILES
from spinfilters.data.consider_parameter import consider_parameters
from spinfilters.data.dataset_options import DatasetOptions
from spinfilters.data.input_file import path_text
from spinfilters.data.sensor_yaml import SensorFile, read_sensor_file


def with_told_deviations(options: DatasetOptions, folder: Path) -> DatasetOptions:
    """Options completed by the calibration deviations in the folder's `sensor.yaml` files.

    Raises
    ------
    InputError: as `read_sensor_file`; a deviation out of the range of its parameter.
    """
    return replace(options, calibration={**told_deviations(folder), **options.calibration})


def told_deviations(folder: Path) -> Mapping[str, float]:
    """Calibration deviations of a folder's cameras, the larger of two. Errors: `with_told_deviations`."""
    cameras = {
        path: read_sensor_file(path) for path in (folder / file for file in RIG_FILES) if path.is_file()
    }
    found: dict[str, float] = {}
    for path, camera in cameras.items():
        for name, value in _of_camera(camera, list(cameras.values())).items():
            consider_parameters()[name].allowed.require(f"{path_text(path)}: its {name}", value)
            found[name] = max(value, found.get(name, 0.0))
    return found


def _of_camera(camera: SensorFile, pair: list[SensorFile]) -> dict[str, float]:
    """Deviations relative to focal length and baseline, and of the principal point in px."""
    told: dict[str, float] = {}
    if camera.intrinsics_std is not None:
        focal, centre = camera.intrinsics_std[:2] / camera.intrinsics[:2], camera.intrinsics_std[2:]
        told |= {"focal_std": float(focal.max()), "center_std": float(centre.max())}
    if camera.position_std is not None and len(pair) > 1:
        baseline = float(np.linalg.norm(pair[1].pose[:3, 3] - pair[0].pose[:3, 3]))
        if baseline > 0:
            told["baseline_std"] = camera.position_std / baseline
    return told
