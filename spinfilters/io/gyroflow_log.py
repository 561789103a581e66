"""Logs of Gyroflow, .gcsv: whole numbers with the factors that make seconds and rad/s of them."""

from pathlib import Path
from typing import Final

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import first_text, parse_number, path_text, value_text
from spinfilters.io.motion_file import motion_dataset
from spinfilters.io.motion_table import motion_of
from spinfilters.io.named_columns import ArrayColumns, TextColumns
from spinfilters.io.stated_values import NOTHING_STATED, ReadingOptions
from spinfilters.io.table_layout import read_layout

_HEAD: Final = 1 << 16
_COLUMNS: Final = ("t", "gx", "gy", "gz")


def read_gyroflow(path: Path, options: ReadingOptions) -> Dataset:
    """Rates of a log: tscale makes seconds of its clock, gscale rad/s of its counts.

    InputError: no factors, or axes of a left hand.
    """
    options.require_only((), "a log of Gyroflow")
    cells = (line.partition(",") for line in first_text(path, _HEAD).splitlines())
    stated = {name.strip(): value.strip() for name, _, value in cells}
    second, rate = (_factor(path, name, stated.get(name, "")) for name in ("tscale", "gscale"))
    _require_right_handed(path, stated.get("orientation", "XYZ"))
    source = TextColumns(path, read_layout(path))
    missing = [name for name in _COLUMNS if name not in source.names]
    if missing:
        raise InputError(f"{path_text(path)}: has no column {', '.join(missing)}; log the gyro")
    table = source.read([source.names.index(name) for name in _COLUMNS], keys=1)
    columns = (table.values[:, 0] * second, *(table.values[:, 1:] * rate).T)
    names = ("time (s)", *(f"gyro_{axis} (rad/s)" for axis in "xyz"))
    return motion_dataset(path, path.name, motion_of(ArrayColumns(path, names, columns), NOTHING_STATED))


def _factor(path: Path, name: str, text: str) -> float:
    """A positive factor of the head. InputError: none."""
    try:
        value = parse_number(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < 1e9:
        raise InputError(
            f"{path_text(path)}: {name} is {value_text(text)}; state the factor that makes SI units of the counts"
        )
    return value


def _require_right_handed(path: Path, orientation: str) -> None:
    """Raise InputError for letters, small ones for axes that point the other way, that are no rotation of x, y and z."""
    letters = orientation.lower()
    order = ["xyz".find(letter) for letter in letters]
    if sorted(order) == [0, 1, 2]:
        is_even = order in ([0, 1, 2], [1, 2, 0], [2, 0, 1])
        turned = sum(letter.islower() for letter in orientation)
        if is_even == (turned % 2 == 0):
            return
    raise InputError(
        f"{path_text(path)}: orientation is {value_text(orientation)}, no rotation of right-handed axes; correct it, as in YxZ"
    )
