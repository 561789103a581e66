"""Tables in long form, as R and databases write them: a line for each number, with a clock and the names of what it is of.

``0.02,gyro,x,0.31`` below ``time_s,sensor,axis,value`` is the component gyro_x at 0.02 s. Components that have the same times are
the columns of one table.
"""

import re
from array import array
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.io.headings import heading_of, is_clock, is_of_motion
from spinfilters.io.input_file import parse_number, path_text, value_text
from spinfilters.io.named_columns import ArrayColumns
from spinfilters.io.table_layout import TableLayout, data_lines

_VALUE: Final = ("value", "val", "_value", "reading")
_CLOCK: Final = ("_time",)
"""Of InfluxDB, whose own columns begin so."""
_UNIT: Final = ("unit", "units")
_NAMES: Final = re.compile(
    r"sensor|axis|name|variable|signal|channel|component|key|parameter|quantity|type|series|metric|_?measurement|_?field"
)
"""Columns of words that say what a number is of."""


def long_columns(path: Path, layout: TableLayout) -> ArrayColumns | None:
    """Components of a table in long form as columns, of several tables those of a motion; None of another layout.

    InputError: a line with another number of cells, a number that is none, or a component that is twice at one time.
    """
    names = [name.lower() for name in layout.names]
    values = [k for k, name in enumerate(names) if name in _VALUE]
    words = [k for k, name in enumerate(names) if _NAMES.fullmatch(name)]
    words.sort(key=lambda k: names[k] not in ("measurement", "_measurement"))  # whose fields the others are
    clocks = [k for k, name in enumerate(names) if name in _CLOCK]
    clocks = clocks or [k for k, name in enumerate(names) if is_clock(name)]
    if len(values) != 1 or len(clocks) != 1 or not words:
        return None
    units = [k for k, name in enumerate(names) if name in _UNIT]
    times: dict[str, list[str]] = {}
    numbers: dict[str, array[float]] = {}
    for line, cells in _rows(path, layout):
        called = "_".join(cells[k] for k in words) + "".join(f" ({cells[k]})" for k in units[:1] if cells[k])
        own = times.setdefault(called, [])
        if own and own[-1] == cells[clocks[0]]:
            raise InputError(
                f"{path_text(path)}: line {line}: {value_text(called)} is twice at {value_text(own[-1])}; delete one of the lines"
            )
        own.append(cells[clocks[0]])
        numbers.setdefault(called, array("d")).append(_number(path, layout, line, cells[values[0]]))
    moving = next((name for name in times if is_of_motion(name)), None)
    if moving is None:
        return None
    alike = [name for name in times if times[name] == times[moving]]
    apart = next((name for name in times if name not in alike and is_of_motion(name)), None)
    if apart is not None and heading_of(apart) not in map(heading_of, alike):
        raise InputError(
            f"{path_text(path)}: {value_text(apart)} has other times than {value_text(moving)}; give both at each time"
        )
    clock = "time" if names[clocks[0]] in _CLOCK else layout.names[clocks[0]]
    columns = [np.array(times[moving], dtype=object), *(np.frombuffer(numbers[name]) for name in alike)]
    return ArrayColumns(path, (clock, *alike), tuple(columns))


def _rows(path: Path, layout: TableLayout) -> Iterator[tuple[int, Sequence[str]]]:
    """Numbers and cells of the lines below the header. InputError: one with more or fewer cells than columns."""
    for line, text in data_lines(path, layout):
        cells = layout.cells(text)
        if len(cells) != len(layout.names):
            raise InputError(
                f"{path_text(path)}: line {line}: {value_text(text.strip())} has {len(cells)} cells, expected {len(layout.names)}; "
                "correct or delete the line"
            )
        yield line, cells


def _number(path: Path, layout: TableLayout, line: int, cell: str) -> float:
    """Number of a cell, NaN of an empty one. InputError: another cell."""
    try:
        return parse_number(cell.replace(",", ".") if layout.decimal_comma else cell) if cell else np.nan
    except ValueError:
        raise InputError(
            f"{path_text(path)}: line {line}: {value_text(cell)} is not a number; correct or delete the line"
        ) from None
