"""Rows of a journal, read without trusting it: a line that is no row of the study is set aside, and its run is made again."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import pyarrow as pa

from spinfilters.campaigns.schema import OUTCOMES
from spinfilters.data.input_file import read_bytes

LARGEST_JOURNAL: Final = 1 << 30
"""Bytes of a journal that are read: five thousand rows are a hundredth of it."""
SET_ASIDE: Final = ".damaged"
"""Suffix of a file with the lines of a journal that are no rows."""
_LARGEST_WHOLE: Final = 2**63 - 1


@dataclass(frozen=True)
class RowRules:
    """Rules that a row of a study keeps.

    Attributes
    ----------
    schema: of the rows.   levels: of the factors, of every cell; none where the study is not at hand.
    """

    schema: pa.Schema
    levels: Sequence[Mapping[str, str]] = ()

    def is_row(self, row: object) -> bool:
        """Whether it is a mapping of known columns to values of their types, of a run that the study can have."""
        if not isinstance(row, dict) or row.get("outcome") not in OUTCOMES:
            return False
        numbers: list[Any] = [row.get(name) for name in ("run", "cell", "seed")]
        if any(type(number) is not int or number < 0 for number in numbers):
            return False
        if any(name not in self.schema.names for name in row):
            return False
        if not all(_is_of_type(row[each.name], each.type) for each in self.schema if each.name in row):
            return False
        return self._is_of_study(row, *numbers)

    def _is_of_study(self, row: Mapping[str, Any], run: int, cell: int, seed: int) -> bool:
        """Whether number, cell, seed and levels of a run agree."""
        if not self.levels:
            return True
        if cell >= len(self.levels) or run != seed * len(self.levels) + cell:
            return False
        return all(row.get(name) == level for name, level in self.levels[cell].items())

    def rows_of(self, table: pa.Table) -> pa.Table:
        """The rows of a table whose numbers of run, cell and seed agree."""
        if not self.levels:
            return table
        run, cell, seed = (table[name].to_numpy() for name in ("run", "cell", "seed"))
        kept = (run >= 0) & (cell >= 0) & (cell < len(self.levels)) & (run == seed * len(self.levels) + cell)
        return table if kept.all() else table.filter(pa.array(kept))


def _is_of_type(value: object, kind: pa.DataType) -> bool:
    """Whether Arrow takes a value of JSON as this type without changing it."""
    if value is None:
        return True
    if pa.types.is_string(kind):
        return isinstance(value, str) and not any("\ud800" <= letter <= "\udfff" for letter in value)
    if pa.types.is_boolean(kind):
        return isinstance(value, bool)
    if pa.types.is_int64(kind):
        return type(value) is int and abs(value) <= _LARGEST_WHOLE
    if pa.types.is_list(kind):
        return isinstance(value, list) and all(_is_of_type(each, pa.float64()) for each in value)
    return isinstance(value, float) or (type(value) is int and abs(value) <= 2**53)


def read_journal(path: Path, rules: RowRules) -> tuple[list[dict[str, Any]], list[bytes]]:
    """Rows of a journal, and whole lines that are none.

    A last line without its end was cut short by a kill and is neither.
    InputError: it is no regular file, or cannot be read.
    """
    rows, damaged = [], []
    *lines, _cut = read_bytes(path, LARGEST_JOURNAL, may_be_empty=True).split(b"\n")
    for line in lines:
        try:
            row = json.loads(line)
        except (ValueError, RecursionError):
            row = None
        if rules.is_row(row):
            rows.append(row)
        elif line.strip():
            damaged.append(line)
    return rows, damaged
