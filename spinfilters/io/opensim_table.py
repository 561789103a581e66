"""Orientations of bodies of OpenSim, .sto: a header to the line endheader, then a time and a quaternion w,x,y,z of each body."""

from pathlib import Path
from typing import Final

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import MAX_TABLE_BYTES, finite_numbers, path_text, read_bytes, value_text
from spinfilters.io.motion_file import motion_dataset
from spinfilters.io.motion_table import motion_of
from spinfilters.io.named_columns import ArrayColumns
from spinfilters.io.stated_values import ReadingOptions

_END: Final = "endheader"


def read_opensim_table(path: Path, options: ReadingOptions) -> Dataset:
    """Attitudes q_ib of the only body, or of the one that the user names by the topic.

    InputError: numbers of another type; several bodies; rows that are none.
    """
    options.require_only(("topic", "rate"), "a table of OpenSim")
    lines = read_bytes(path, MAX_TABLE_BYTES).decode("utf-8", "replace").splitlines()
    end = next((k for k, line in enumerate(lines) if line.strip() == _END), None)
    head = "\n".join(lines[:end])
    if end is None or "DataType=Quaternion" not in head or len(lines) < end + 3:
        raise InputError(
            f"{path_text(path)}: is no table of orientations; export orientations with DataType=Quaternion"
        )
    bodies = lines[end + 1].split()[1:]
    rows = [
        _row(path, k, line, len(bodies))
        for k, line in enumerate(lines[end + 2 :], start=end + 3)
        if line.strip()
    ]
    if not rows:
        raise InputError(f"{path_text(path)}: has no rows of orientations; export it again")
    table = np.array(rows, dtype=np.float64).T
    names = ("time (s)", *(f"{body}_q{axis}" for body in bodies for axis in "wxyz"))
    return motion_dataset(path, path.name, motion_of(ArrayColumns(path, names, tuple(table)), options))


def _row(path: Path, line: int, text: str, bodies: int) -> list[float]:
    """Time and quaternions of a row. InputError: another number of them."""
    cells = text.replace(",", " ").split()
    numbers = finite_numbers(cells)
    if len(numbers) != 1 + 4 * bodies:
        raise InputError(
            f"{path_text(path)}: line {line}: {value_text(text.strip())} is no time with {bodies} quaternions; correct or delete it"
        )
    return numbers
