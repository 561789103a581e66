"""A camera's `sensor.yaml` in the EuRoC layout, and validated reading of YAML."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from spinfilters.data.input_file import path_text, read_settings_text, reason, value_text
from spinfilters.data.stated_values import LENGTH, NumberRange
from spinfilters.data.table_files import numbers
from spinfilters.errors import InputError

ROTATION_TOLERANCE: Final[float] = 1e-4
"""Largest entry by which a rotation may miss orthonormality, or a pair parallelism: 0.05 px at f = 500."""
DISTORTION_MODELS: Final[tuple[str, ...]] = ("radial-tangential", "radtan", "plumb_bob")
"""Names of the distortion of Brown: of the EuRoC layout, Kalibr and ROS."""
DISTORTION_KEY: Final = "distortion_coefficients"
INTRINSICS_STD, POSITION_STD = "intrinsics_std", "position_std"
"""Keys of what `spinfilters calibrate` says of the uncertainty; others need not."""
_INTRINSICS_DEVIATION, _PLACE_DEVIATION = (
    NumberRange(0, 1e4, "px"),
    NumberRange(0, 1e3, "m"),
)
_MOST_NESTED = 20  # of brackets and blocks in YAML, whose reader works from nested calls
_MOST_NODES = 20_000  # of a YAML file: a calibration has a hundred


@dataclass(frozen=True, eq=False)
class SensorFile:
    """Content of a `sensor.yaml` of a pinhole camera.

    Attributes
    ----------
    intrinsics: (fx, fy, cx, cy), px.   size: width and height, px.   pose: T_BS, camera to body, m.
    distortion: coefficients as they are given, none where there are none.   model: of the distortion, as it is given.
    intrinsics_std: standard deviations of the intrinsics, px.   position_std: of the camera's place in the body, m. None where the
        file is silent.
    """

    intrinsics: Float[np.ndarray, " 4"]
    size: tuple[int, int]
    pose: Float[np.ndarray, "4 4"]
    distortion: Float[np.ndarray, " k"]
    model: object
    intrinsics_std: Float[np.ndarray, " 4"] | None = None
    position_std: float | None = None


def read_sensor_file(path: Path) -> SensorFile:
    """Content of a `sensor.yaml`.

    Raises
    ------
    InputError: unreadable YAML, a key that is missing, not a pinhole, numbers of another shape, half a pixel, no pose.
    """
    settings = read_yaml(path)
    for key in ("camera_model", "intrinsics", "resolution", "T_BS"):
        if key not in settings:
            raise InputError(
                f"{path_text(path)}: has no {key}; write it as in the EuRoC layout, or calibrate the rig"
            )
    if settings["camera_model"] != "pinhole":
        raise InputError(
            f"{path_text(path)}: camera_model is {value_text(settings['camera_model'])}; rectify the images, "
            "give 'pinhole'"
        )
    intrinsics = numbers(path, "intrinsics", settings["intrinsics"], (4,))
    resolution = numbers(path, "resolution", settings["resolution"], (2,))
    coefficients, model = (
        settings.get(DISTORTION_KEY, []),
        settings.get("distortion_model", DISTORTION_MODELS[0]),
    )
    if not isinstance(coefficients, list):
        raise InputError(
            f"{path_text(path)}: {DISTORTION_KEY} is {value_text(coefficients)}, expected [0.0, 0.0, 0.0, 0.0]; correct it"
        )
    distortion = (
        numbers(path, DISTORTION_KEY, coefficients, (len(coefficients),)) if coefficients else np.zeros(0)
    )
    pose = _pose(path, settings["T_BS"])
    return SensorFile(
        intrinsics, image_size(path, resolution), pose, distortion, model, *_deviations(path, settings)
    )


def sensor_text(
    intrinsics: Sequence[float],
    size: tuple[int, int],
    pose: Float[np.ndarray, "4 4"],
    distortion: Sequence[float],
) -> str:
    """A `sensor.yaml` that `read_sensor_file` reads to the same numbers; `deviations_text` may follow it."""
    return (
        "sensor_type: camera\n"
        f"T_BS:\n  cols: 4\n  rows: 4\n  data: {pose.ravel().tolist()}\n"
        f"resolution: {[int(value) for value in size]}\n"
        "camera_model: pinhole\n"
        f"intrinsics: {[float(value) for value in intrinsics]}\n"
        f"distortion_model: {DISTORTION_MODELS[0]}\n"
        f"{DISTORTION_KEY}: {[float(value) for value in distortion]}\n"
    )


def deviations_text(intrinsics_std: Sequence[float], position_std: float | None = None) -> str:
    """Lines of a `sensor.yaml` that state standard deviations: intrinsics px, camera's place m."""
    place = "" if position_std is None else f"{POSITION_STD}: {float(position_std)}\n"
    return f"{INTRINSICS_STD}: {[float(value) for value in intrinsics_std]}\n{place}"


def image_size(path: Path, resolution: Float[np.ndarray, " 2"]) -> tuple[int, int]:
    """Width and height. InputError: not whole pixels."""
    width, height = resolution.tolist()
    if not width.is_integer() or not height.is_integer():
        raise InputError(
            f"{path_text(path)}: resolution is {resolution.tolist()}, expected whole pixels; correct it"
        )
    return int(width), int(height)


def is_rotation(matrix: Float[np.ndarray, "3 3"]) -> bool:
    """Whether a matrix is a rotation, to `ROTATION_TOLERANCE`."""
    orthonormal = np.abs(matrix @ matrix.T - np.eye(3)).max() <= ROTATION_TOLERANCE
    return bool(orthonormal and np.linalg.det(matrix) > 0.0)


def _deviations(
    path: Path, settings: Mapping[str, Any]
) -> tuple[Float[np.ndarray, " 4"] | None, float | None]:
    """InputError: deviations of another number or out of range."""
    of_intrinsics, of_place = settings.get(INTRINSICS_STD), settings.get(POSITION_STD)
    if of_intrinsics is not None:
        of_intrinsics = numbers(path, INTRINSICS_STD, of_intrinsics, (4,))
        for value in of_intrinsics.tolist():
            _INTRINSICS_DEVIATION.require(f"{path_text(path)}: {INTRINSICS_STD}: a number", value)
    if of_place is not None:
        _PLACE_DEVIATION.require(f"{path_text(path)}: {POSITION_STD}", of_place)
    return of_intrinsics, None if of_place is None else float(of_place)


def _pose(path: Path, value: Any) -> Float[np.ndarray, "4 4"]:
    """T_BS, camera to body.

    A 4x4 list, 16 numbers, or the EuRoC mapping with rows, cols and data.
    """
    data = value
    if isinstance(value, dict):
        if (value.get("rows"), value.get("cols")) != (4, 4) or "data" not in value:
            raise InputError(
                f"{path_text(path)}: T_BS is {value_text(value)}, expected rows: 4, cols: 4, data: [...]; correct it"
            )
        data = value["data"]
    nested = isinstance(data, list) and len(data) == 4
    pose = numbers(path, "T_BS", data, (4, 4) if nested else (16,)).reshape(4, 4)
    for entry in pose.ravel().tolist():
        LENGTH.require(f"{path_text(path)}: T_BS holds a number that", entry)
    if not is_rotation(pose[:3, :3]) or not np.array_equal(pose[3], [0.0, 0.0, 0.0, 1.0]):
        raise InputError(
            f"{path_text(path)}: T_BS is {value_text(pose.tolist())}, not a rotation and a shift; correct it"
        )
    return pose


def read_yaml(path: Path) -> dict[str, Any]:
    """Mapping of a YAML file of at most 1 MiB.

    Plain values only: no object tags, no aliases, no merge keys.
    A few aliases in one another name more values than memory holds, so they are refused before any is looked up.

    Raises
    ------
    InputError: unreadable file, text that is not YAML, tags such as !!python, aliases, too many or too deeply nested values, or
    no mapping at the top.
    """
    import yaml  # here alone: few recordings have a camera's file

    text = read_settings_text(path)
    try:
        _refuse_growth(path, text)
        document = yaml.safe_load(text)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        problem = reason(ValueError(error.problem))
        raise InputError(
            f"{path_text(path)}: line {line}: is not plain YAML ({problem}); correct that line"
        ) from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise InputError(f"{path_text(path)}: is not YAML ({reason(error)}); correct it") from None
    if not isinstance(document, dict):
        raise InputError(
            f"{path_text(path)}: holds {value_text(document)}, expected 'key: value' lines; copy it again"
        )
    return document


def _refuse_growth(path: Path, text: str) -> None:
    """Refuse YAML that would become larger or deeper than it looks."""
    import yaml

    depth = nodes = 0
    for event in yaml.parse(text, Loader=yaml.SafeLoader):
        line = f"{path_text(path)}: line {event.start_mark.line + 1}: "
        if isinstance(event, yaml.AliasEvent):
            raise InputError(
                f"{line}refers to another value (*{value_text(event.anchor)[1:-1]}); write the value itself"
            )
        if isinstance(event, yaml.ScalarEvent) and event.value == "<<":
            raise InputError(f"{line}has a merge key (<<); write the keys themselves")
        nodes += isinstance(event, yaml.NodeEvent)
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _MOST_NESTED or nodes > _MOST_NODES:
            raise InputError(
                f"{line}nests values more than {_MOST_NESTED} deep or holds more than {_MOST_NODES}; copy the file again"
            )
