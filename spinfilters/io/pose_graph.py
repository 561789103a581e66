"""Poses without a clock of their own: the vertices of g2o, .g2o, which have numbers, and the images of COLMAP, which have names."""

import re
from pathlib import Path
from typing import Final

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import (
    MAX_TABLE_BYTES,
    finite_numbers,
    first_text,
    path_text,
    printable,
    read_bytes,
    value_text,
)
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.motion_file import motion_dataset
from spinfilters.io.motion_table import MotionTable
from spinfilters.io.stated_values import ReadingOptions, to_state
from spinfilters.io.table_layout import TableLayout
from spinfilters.io.text_table import Table

_VERTEX = "VERTEX_SE3:QUAT"


def read_pose_graph(path: Path, options: ReadingOptions) -> Dataset:
    """Poses of the vertices by their numbers, at the stated rate.

    InputError: no rate; no vertices of space, or two of one number; cells that are no pose.
    """
    options.require_only(("rate",), "a pose graph")
    numbers, lines = [], []
    for number, line in enumerate(
        read_bytes(path, MAX_TABLE_BYTES).decode("utf-8", "replace").splitlines(), start=1
    ):
        words = line.split()
        if words[:1] == [_VERTEX]:
            numbers.append(_vertex(path, number, words[1:]))
            lines.append(number)
    if len(numbers) < 2:
        raise InputError(f"{path_text(path)}: has no {_VERTEX} lines; save poses of space with quaternions")
    if options.rate is None:
        raise InputError(
            f"{path_text(path)}: its vertices have numbers and no times; give {to_state('rate', 'HZ')}"
        )
    values = np.array(numbers, dtype=np.float64)
    order = np.argsort(values[:, 0], kind="stable")
    values, lines = values[order], [lines[k] for k in order]
    layout = TableLayout(("id", "px", "py", "pz", "qx", "qy", "qz", "qw"))
    table = Table(path, layout, layout.names, values, lines)
    again = np.flatnonzero(np.diff(values[:, 0]) <= 0)
    if again.size:
        raise table.error(int(again[0]) + 1, f"vertex {values[again[0], 0]:.0f} stands twice; delete one")
    with table.naming_lines():
        stream = MeasurementStream("pose", (values[:, 0] - values[0, 0]) / options.rate, values[:, 1:])
    return motion_dataset(
        path, path.name, MotionTable(stream, None, (f"clock of {options.rate:g} Hz as stated",))
    )


def _vertex(path: Path, line: int, words: list[str]) -> list[float]:
    """Number, position and quaternion of a vertex. InputError: other cells."""
    numbers = finite_numbers(words[:8])
    if len(numbers) < 8:
        raise InputError(
            f"{path_text(path)}: line {line}: {value_text(' '.join(words))} is no number with x y z qx qy qz qw; correct the line"
        )
    return numbers


_COLMAP: Final = "IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME"
_HEAD: Final = 4096
_INSTANT: Final = re.compile(r"(?:.*[^0-9.])?(\d{10}\.\d{1,9}|\d{13}|\d{16}|\d{19})\.\w+")
_FRAME: Final = re.compile(r"(.*?)(\d+)(\.\w+)")
"""Names of images by the time since 1970 in s, ms, us or ns, and by their number."""


def has_colmap_images(path: Path) -> bool:
    """Whether the comments above the first lines list the columns of COLMAP's images."""
    return _COLMAP in first_text(path, _HEAD)


def read_colmap_images(path: Path, options: ReadingOptions) -> Dataset:
    """Poses of the reconstructed body in the camera: COLMAP's rotation maps from the reconstruction to the camera.

    The clock is the number in the name of each image divided by the stated rate, or the time that the names are. Lengths are in the
    unit of the reconstruction, whose scale images do not show. InputError: neither, or a line that is no pose.
    """
    options.require_only(("rate",), "images of COLMAP")
    text = read_bytes(path, MAX_TABLE_BYTES).decode("utf-8", "replace").splitlines()
    held = [(k, line) for k, line in enumerate(text, start=1) if not line.lstrip().startswith("#")]
    while held and not held[0][1].strip():
        held.pop(0)
    images = held[::2]  # the line below each holds its points, and may be empty
    if images and not images[-1][1].strip():
        images.pop()
    poses = [_image(path, number, line) for number, line in images]
    if len(poses) < 2:
        raise InputError(f"{path_text(path)}: has no images with poses; export the model as text again")
    clocks, remark = _clocks_of_names(path, [name for _, name in poses], options.rate)
    order = np.argsort(clocks, kind="stable")
    values = np.array([pose for pose, _ in poses])[order]
    lines = [images[k][0] for k in order]
    layout = TableLayout(("time", "px", "py", "pz", "qx", "qy", "qz", "qw"))
    table = Table(path, layout, layout.names, np.column_stack([clocks[order], values]), lines)
    with table.naming_lines():
        stream = MeasurementStream("pose", table.values[:, 0], values)
    return motion_dataset(path, path.name, MotionTable(stream, None, (remark,)))


def _image(path: Path, number: int, line: str) -> tuple[list[float], str]:
    """Position and quaternion, scalar last, and name of an image. InputError: another line."""
    words = line.split(maxsplit=9)
    numbers = finite_numbers(words[1:8])
    if len(words) < 10 or len(numbers) < 7:
        raise InputError(
            f"{path_text(path)}: line {number}: {value_text(line.strip())} is no image with its pose; export the model again"
        )
    return [*numbers[4:], *numbers[1:4], numbers[0]], words[9].strip()


def _clocks_of_names(path: Path, names: list[str], rate: float | None) -> tuple[np.ndarray, str]:
    """Times of images, s, and where they are from. InputError: no rate, and names that are no times."""
    instants = [_INSTANT.fullmatch(name) for name in names]
    if rate is None:
        if all(instants):
            digits = [each[1] for each in instants if each is not None]
            seconds = [float(text) if "." in text else int(text) / 10 ** (len(text) - 10) for text in digits]
            return np.array(seconds), "times are the names of the images"
        raise InputError(
            f"{path_text(path)}: its images have names such as {value_text(printable(names[0]))} and no times; give "
            f"{to_state('rate', 'HZ')}"
        )
    numbered = [_FRAME.fullmatch(name) for name in names]
    are_alike = len({(each[1], each[3]) if each is not None else None for each in numbered}) == 1
    frames = [int(each[2]) for each in numbered if each is not None] if are_alike else []
    places = np.array(frames) if len(frames) == len(names) else np.argsort(np.argsort(np.array(names)))
    return (places - places.min()) / rate, f"clock of {rate:g} Hz as stated"
