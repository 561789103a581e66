"""Measurement files of LabVIEW, .lvm: tags, then segments of a header, a line of names, and rows."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import MAX_TABLE_BYTES, parse_number, path_text, read_bytes, value_text
from spinfilters.io.motion_file import bare_quantity, motion_dataset
from spinfilters.io.motion_table import motion_of
from spinfilters.io.named_columns import ArrayColumns
from spinfilters.io.stated_values import SAMPLING_RATE, ReadingOptions

_END: Final = "***End_of_Header***"
_SEPARATORS: Final = {"Tab": "\t", "Comma": ","}
_CLOCK: Final = "X_Value"
_REMARK: Final = "Comment"


def read_labview_file(path: Path, options: ReadingOptions) -> Dataset:
    """Rates, poses or attitudes by the names and units of the channels.

    Without a column of the time, the period of the header counts. InputError: several segments, or as `motion_of`.
    """
    options.require_only(("unit", "clock", "rate", "columns", "topic"), "a file of LabVIEW")
    lines = read_bytes(path, MAX_TABLE_BYTES).decode("utf-8-sig", "replace").splitlines()
    ends = [k for k, line in enumerate(lines) if line.strip().startswith(_END)]
    if not ends or len(lines) < ends[-1] + 3:
        raise InputError(f"{path_text(path)}: has no header of a LabVIEW file with rows; save it again")
    if len(ends) > 2:
        raise InputError(f"{path_text(path)}: has {len(ends) - 1} segments; save one segment a file")
    tags = _tags(lines[: ends[0]], "\t")
    separator = _SEPARATORS.get(next(iter(tags.get("Separator", [])), ""), "\t")
    stated = _tags(lines[: ends[-1]], separator)
    comma = next(iter(tags.get("Decimal_Separator", [])), ".") == ","
    names = [name.strip() for name in lines[ends[-1] + 1].split(separator)]
    width = len(names) - (names[-1] == _REMARK)
    rows = [
        _numbers(path, k, line.split(separator)[:width], comma)
        for k, line in enumerate(lines[ends[-1] + 2 :], start=ends[-1] + 3)
        if line.strip()
    ]
    if any(len(row) != len(rows[0]) for row in rows):
        raise InputError(f"{path_text(path)}: its rows differ in length; save it again")
    table = np.array(rows, dtype=np.float64).T
    called = list(options.column_names) or _called(names[: len(table)], stated.get("Y_Unit_Label", []))
    if len(called) != len(table):
        raise InputError(
            f"{path_text(path)}: has {len(table)} columns and {len(called)} names; name each one"
        )
    kept = [k for k, name in enumerate(called) if name not in ("-", "") and not np.isnan(table[k]).all()]
    columns = ArrayColumns(
        path, tuple(called[k] for k in kept), tuple(table[k] for k in kept), _rate(stated.get("Delta_X", []))
    )
    bare = "rate" if options.columns is not None else bare_quantity(path)
    return motion_dataset(path, path.name, motion_of(columns, options, bare))


def _tags(lines: Sequence[str], separator: str) -> dict[str, list[str]]:
    """Values of each tag, the first of a line."""
    cells = [line.split(separator) for line in lines]
    return {line[0].strip(): [cell.strip() for cell in line[1:] if cell.strip()] for line in cells}


def _called(names: Sequence[str], units: Sequence[str]) -> list[str]:
    """Names of columns with the units of the channels, which have all columns but that of the time."""
    channels = [k for k, name in enumerate(names) if name != _CLOCK]
    stated = dict(zip(channels, units, strict=False)) if len(units) == len(channels) else {}
    return [
        "time (s)" if name == _CLOCK else f"{name} ({stated[k]})" if k in stated and "(" not in name else name
        for k, name in enumerate(names)
    ]


def _rate(periods: Sequence[str]) -> float | None:
    """Samples a second by the period of all channels, Hz; None without one, or of several."""
    try:
        period = {parse_number(each.replace(",", ".")) for each in periods}
    except ValueError:
        return None
    only = period.pop() if len(period) == 1 else 0.0
    return 1.0 / only if only > 0.0 and 1.0 / only in SAMPLING_RATE else None


def _numbers(path: Path, line: int, cells: Sequence[str], comma: bool) -> list[float]:
    """Numbers of a row, NaN of an empty cell. InputError: another cell."""
    found = []
    for cell in cells:
        try:
            found.append(parse_number(cell.replace(",", ".") if comma else cell) if cell.strip() else np.nan)
        except ValueError:
            raise InputError(
                f"{path_text(path)}: line {line}: {value_text(cell)} is no number; correct or delete the line"
            ) from None
    return found
