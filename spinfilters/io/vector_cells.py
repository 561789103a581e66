"""Tables whose cells are vectors in brackets: ``0.02, [0.1 0.2 0.3], (0, 0, 0, 1)``, as programs print lists and arrays."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.io.calendar_clock import seconds_of_clock
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import (
    MAX_TABLE_BYTES,
    first_text,
    parse_number,
    path_text,
    read_bytes,
    value_text,
)
from spinfilters.io.motion_file import bare_quantity, motion_dataset
from spinfilters.io.motion_table import motion_of
from spinfilters.io.named_columns import ArrayColumns
from spinfilters.io.stated_values import ReadingOptions

_NUMBER: Final = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_VECTOR: Final = re.compile(
    rf'"?(?:np\.)?(?:array|tensor|Vector|Quaternion)?[(\[]{{1,2}}\s*({_NUMBER}(?:\s*[,;\s]\s*{_NUMBER}){{1,8}})\s*,?\s*[)\]]{{1,2}}"?'
)
"""Two to nine numbers in brackets, perhaps within quotes."""
_JOINT: Final = "~"
"""Between the numbers of a vector once it is a cell."""
_HEAD: Final = 1 << 15
_FEWEST: Final = 3
_DELIMITERS: Final = ";\t,|"


def has_vector_cells(path: Path) -> bool:
    """Whether some of the first lines hold the same number of vectors in brackets, which follow numbers."""
    lines = [line for line in first_text(path, _HEAD).splitlines()[:-1] if _VECTOR.search(line)]
    counts = [len(_VECTOR.findall(line)) for line in lines[:_FEWEST]]
    are_rows = all(line.lstrip()[:1] in '+-.0123456789(["' for line in lines[:_FEWEST])
    return len(counts) == _FEWEST and len(set(counts)) == 1 and are_rows


def read_vector_cells(path: Path, options: ReadingOptions) -> Dataset:
    """Rates, poses or attitudes of the table, by the names of its columns and the places within their vectors.

    InputError: rows of another number of cells or numbers, or as `motion_of`.
    """
    options.require_only(("unit", "clock", "rate", "columns"), "a table of vectors")
    lines = read_bytes(path, MAX_TABLE_BYTES).decode("utf-8-sig", "replace").splitlines()
    first = next((k for k, line in enumerate(lines) if _VECTOR.search(line)), None)
    if first is None:
        raise InputError(f"{path_text(path)}: has no vectors in brackets; write it again")
    joined = _joined(lines[first])
    delimiter = max(_DELIMITERS, key=joined.count)
    delimiter = delimiter if delimiter in joined else None
    rows = list(_rows(path, lines, first, delimiter))
    widths = [len(cell) for cell in rows[0][1]]
    for number, row in rows:
        if [len(cell) for cell in row] != widths:
            raise InputError(
                f"{path_text(path)}: line {number}: does not have the cells and vectors of line {rows[0][0]}; correct or delete it"
            )
    names = list(options.column_names) or _names(_header(lines[:first], len(widths), delimiter), widths)
    if len(names) != sum(widths):
        raise InputError(
            f"{path_text(path)}: its rows have {sum(widths)} numbers, and the stated columns are {len(names)}; name every column, "
            "with - for those to leave out"
        )
    columns = zip(*([number for cell in row for number in cell] for _, row in rows), strict=True)
    arrays = tuple(np.array(column, dtype=np.float64) for column in columns)
    kept = [k for k, name in enumerate(names) if name != "-"]
    source = ArrayColumns(
        path,
        tuple(names[k] for k in kept),
        tuple(arrays[k] for k in kept),
        takes_names=options.columns is None,
    )
    bare = "rate" if options.columns is not None else bare_quantity(path)
    return motion_dataset(path, path.name, motion_of(source, options, bare))


def _joined(line: str) -> str:
    """A line whose vectors are cells without blanks or delimiters in them."""
    return _VECTOR.sub(lambda found: _JOINT.join(re.findall(_NUMBER, found[1])), line.strip())


def _rows(
    path: Path, lines: Sequence[str], first: int, delimiter: str | None
) -> Iterator[tuple[int, list[list[float]]]]:
    """Number of each line from the first with vectors on, and the numbers of its cells. InputError: brackets around words."""
    for number, line in enumerate(lines[first:], start=first + 1):
        if not line.strip() or line.lstrip().startswith(("#", "//")):
            continue
        cells = [cell.strip().strip('"') for cell in _joined(line).split(delimiter)]
        try:
            yield number, [[_number(part) for part in cell.split(_JOINT)] for cell in cells]
        except ValueError:
            raise InputError(
                f"{path_text(path)}: line {number}: {value_text(line.strip())} has a vector that is none; correct or delete it"
            ) from None


def _number(cell: str) -> float:
    """A number, a date in seconds, NaN for a word. ValueError: brackets that hold no numbers."""
    if any(mark in cell for mark in "()[]"):
        raise ValueError
    try:
        return parse_number(cell)
    except ValueError:
        seconds = seconds_of_clock(cell)
        return np.nan if seconds is None else seconds


def _header(lines: Sequence[str], count: int, delimiter: str | None) -> list[str]:
    """Names of so many columns in the last line above that has as many, also in a comment; numbers of columns without one."""
    for line in reversed(lines):
        words = line.lstrip("#%/ ").strip()
        for each in (delimiter, None):
            cells = [cell.strip().strip('"') for cell in words.split(each)]
            if len(cells) == count:
                return cells
    return [f"column{k}" for k in range(count)]


def _names(header: Sequence[str], widths: Sequence[int]) -> list[str]:
    """Names of all numbers: those of a vector of three end with its axes, of others with their places."""
    names: list[str] = []
    for name, width in zip(header, widths, strict=True):
        stem, mark, unit = name.partition("(") if "(" in name else name.partition("[")
        behind = f" {mark}{unit}" if mark else ""
        places = ["_x", "_y", "_z"] if width == 3 else [f"[{k}]" for k in range(width)]
        names += [name] if width == 1 else [f"{stem.strip()}{place}{behind}" for place in places]
    return names
