"""Pose graphs of g2o, .g2o: the poses of its vertices, which have a number and no time."""

from pathlib import Path

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import MAX_TABLE_BYTES, parse_number, path_text, read_bytes, value_text
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
    try:
        numbers = [parse_number(word) for word in words[:8]]
    except ValueError:
        numbers = []
    if len(numbers) < 8 or not np.isfinite(numbers).all():
        raise InputError(
            f"{path_text(path)}: line {line}: {value_text(' '.join(words))} is no number with x y z qx qy qz qw; correct the line"
        )
    return numbers
