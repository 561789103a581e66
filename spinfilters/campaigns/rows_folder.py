"""Folder of a campaign: its study, its provenance, and its rows as Parquet parts and a journal.

A row is in the journal as soon as it is there, as a line of JSON, so that a kill at any moment loses none; parts are written whole
and then take the journal's place. A line that a kill has cut short is no row. Whole lines that are none (a flipped bit, a run that
the study has not) are kept in a file of their own, ``.damaged``, and their runs are made again.

Rows that come by the thousand a second have no journal: they are written as parts, so that a kill loses the latest of them.
"""

import json
import os
import platform
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from spinfilters.campaigns.row_columns import OUTCOMES, schema
from spinfilters.campaigns.study import Study, read_study
from spinfilters.core.errors import InputError
from spinfilters.io.input_file import path_text, read_bytes, read_settings_text, reason, require_file
from spinfilters.io.output_files import atomic_file, make_folder, write_bytes, write_json, write_toml
from spinfilters.run.provenance import git_commit

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
    schema : pa.Schema
        Of the rows.
    levels : Sequence[Mapping[str, str]]
        Of the factors, of every cell; none where the study is not at hand.
    """

    schema: pa.Schema
    levels: Sequence[Mapping[str, str]] = ()

    @cached_property
    def _tests(self) -> dict[str, Callable[[object], bool]]:
        """Whether Arrow takes a value of JSON as that of a column without changing it, by the column's name."""
        return {each.name: _test_of(each.type) for each in self.schema}

    def is_row(self, row: object) -> bool:
        """Whether it is a mapping of known columns to values of their types, of a run that the study can have."""
        if not isinstance(row, dict) or row.get("outcome") not in OUTCOMES:
            return False
        numbers: list[Any] = [row.get(name) for name in ("run", "cell", "seed")]
        if any(type(number) is not int or number < 0 for number in numbers):
            return False
        tests = self._tests
        if not all(
            value is None or tests[name](value) if name in tests else False for name, value in row.items()
        ):
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


def _test_of(kind: pa.DataType) -> Callable[[object], bool]:
    """Whether Arrow takes a value of JSON as this type without changing it."""
    if pa.types.is_string(kind):
        return _is_text
    if pa.types.is_boolean(kind):
        return lambda value: isinstance(value, bool)
    if pa.types.is_int64(kind):
        return lambda value: type(value) is int and abs(value) <= _LARGEST_WHOLE
    return _are_numbers if pa.types.is_list(kind) else _is_number


def _is_text(value: object) -> bool:
    """Half of a pair of surrogates is no letter."""
    if not isinstance(value, str):
        return False
    return value.isascii() or not any("\ud800" <= letter <= "\udfff" for letter in value)


def _is_number(value: object) -> bool:
    return isinstance(value, float) or (type(value) is int and abs(value) <= 2**53)


def _are_numbers(value: object) -> bool:
    return isinstance(value, list) and all(
        type(each) is float or each is None or _is_number(each) for each in value
    )


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


ROWS: Final = "rows"
PART_ROWS: Final = 5_000
"""Rows of a part, at most."""
LARGEST_PART: Final = 4 << 30
"""Bytes of a part that are read: merged campaigns of earlier versions are one part."""
_PART, _JOURNAL = ".parquet", ".jsonl"


class RowsFolder:
    """The rows of one campaign; one process writes at a time (`spinfilters.run.run_lock`).

    Parameters
    ----------
    folder : Path
        Of the campaign.
    factors : Sequence[str]
        Names of the study's factors.
    levels : Sequence[Mapping[str, str]]
        Of every cell, against which rows are checked.
    together : int
        Rows that are written at once as a part, without a journal; 1 for a journal of every row.

    Raises
    ------
    InputError
        At opening, a part that is damaged or of another study; it cannot be written.
    """

    def __init__(
        self,
        folder: Path,
        factors: Sequence[str],
        levels: Sequence[Mapping[str, str]] = (),
        together: int = 1,
    ) -> None:
        self._together, self._waiting = together, list[Mapping[str, Any]]()
        self.folder = folder / ROWS
        self._rules = RowRules(schema(list(factors)), levels)
        self._journal: BinaryIO | None = None
        self._journal_length = 0
        make_folder(self.folder)
        self._recover()

    def __enter__(self) -> "RowsFolder":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._finish_part()
        finally:
            if self._journal is not None:
                self._journal.close()
                self._journal = None

    def done(self) -> set[int]:
        """Numbers of the runs that had a row when the folder was opened."""
        found: set[int] = set()
        for path in part_files(self.folder):
            found.update(_read_part(path, self._rules, ["run"])["run"].to_pylist())
        return found

    def append(self, row: Mapping[str, Any]) -> None:
        """Write a row to the journal, or keep it for a part of many.

        InputError: it cannot be written, as on a full disk; what was kept before stays.
        """
        if self._together > 1:
            self._waiting.append(row)
            if len(self._waiting) >= self._together:
                self._finish_part()
            return
        line = json.dumps(row).encode() + b"\n"
        try:
            if self._journal is None:
                self._journal = open(self._next(_JOURNAL), "xb", buffering=0)  # noqa: SIM115  closed with its part
            written = self._journal.write(line)
            if written != len(line):
                raise OSError(28, os.strerror(28))
        except OSError as error:
            raise InputError(
                f"{path_text(self.folder)}: cannot be written ({reason(error)}); free space, then continue with --resume"
            ) from None
        self._journal_length += 1
        if self._journal_length >= PART_ROWS:
            self._finish_part()

    def _finish_part(self) -> None:
        """Write the rows that wait as a part, or the journal's, then remove the journal."""
        if self._waiting:
            rows, self._waiting = self._waiting, []
            _write_checked(self._next(_PART), rows, self._rules)
        if self._journal is None:
            return
        journal = Path(self._journal.name)
        _take_over(journal, self._rules)
        self._journal.close()
        self._journal, self._journal_length = None, 0

    def _next(self, suffix: str) -> Path:
        """File of the next part, or of its journal."""
        last = max((int(path.stem) for path in part_files(self.folder)), default=0)
        return self.folder / f"{last + 1:06d}{suffix}"

    def _recover(self) -> None:
        """Parts in the place of journals that a kill has left."""
        for journal in sorted(self.folder.glob(f"*{_JOURNAL}")):
            _take_over(journal, self._rules)
        for left in self.folder.glob(".*.part"):
            with suppress(OSError):
                left.unlink()


def _write_checked(part: Path, rows: Sequence[Mapping[str, Any]], rules: RowRules) -> None:
    """Write a part; of values that are of another kind than their columns, as a plug-in's may be, the rows are set aside."""
    try:
        write_part(part, rows, rules.schema)
    except (pa.ArrowException, ValueError, TypeError):
        good = [row for row in rows if rules.is_row(row)]
        lines = [json.dumps(row).encode() for row in rows if not rules.is_row(row)]
        write_bytes(part.with_suffix(SET_ASIDE), b"\n".join([*lines, b""]))
        write_part(part, good, rules.schema)


def _take_over(journal: Path, rules: RowRules) -> None:
    """Put a part in the place of a journal, and what is no row into a file of its own."""
    part = journal.with_suffix(_PART)
    if not part.exists():
        rows, damaged = read_journal(journal, rules)
        if damaged:
            write_bytes(journal.with_suffix(SET_ASIDE), b"\n".join([*damaged, b""]))
        if rows:
            write_part(part, rows, rules.schema)
    journal.unlink()


def part_files(folder: Path) -> list[Path]:
    """Parquet parts of a folder in the order of their numbers."""
    return sorted(path for path in folder.glob(f"*{_PART}") if path.stem.isdecimal())


def read_rows(
    folder: Path,
    factors: Sequence[str],
    columns: Sequence[str] | None = None,
    levels: Sequence[Mapping[str, str]] = (),
) -> pa.Table:
    """Rows of a campaign's folder, journal included, in the order of runs.

    Parameters
    ----------
    levels : Sequence[Mapping[str, str]]
        Of every cell of the study: rows of runs that it does not have are left out.

    Raises
    ------
    InputError
        There are none, or a part is damaged or of another study.
    """
    rows, rules = folder / ROWS, RowRules(schema(list(factors)), levels)
    tables = [_read_part(path, rules, columns) for path in part_files(rows)]
    for journal in sorted(rows.glob(f"*{_JOURNAL}")):
        if not journal.with_suffix(_PART).exists():
            table = _table(read_journal(journal, rules)[0], rules.schema)
            tables.append(table if columns is None else table.select(list(columns)))
    if not sum(len(table) for table in tables):
        raise InputError(f"{path_text(folder)}: holds no rows yet; run the campaign first")
    table = pa.concat_tables(tables)
    runs = table["run"].to_numpy()
    order = np.unique(runs, return_index=True)[1]  # a row that stands twice counts once
    return table if len(order) == len(runs) and (np.diff(runs) > 0).all() else table.take(order)


def write_part(path: Path, rows: Sequence[Mapping[str, Any]], wanted: pa.Schema) -> None:
    """Rows as a Parquet file, in the order of runs. Atomic; errors as `atomic_file`."""
    ordered = sorted(rows, key=lambda row: row["run"])
    write_table(path, _table(ordered, wanted))


def write_table(path: Path, table: pa.Table) -> None:
    """A table as a Parquet file. Atomic; errors as `atomic_file`."""
    with atomic_file(path) as stream:
        pq.write_table(table, stream, compression="zstd")


def _table(rows: Sequence[Mapping[str, Any]], wanted: pa.Schema) -> pa.Table:
    held = set().union(*rows)

    def column(name: str, kind: pa.DataType) -> pa.Array:
        """Values of the rows."""
        if name not in held:
            return pa.nulls(len(rows), kind)
        return pa.array([row.get(name) for row in rows], kind)

    return pa.table({each.name: column(each.name, each.type) for each in wanted}, wanted)


def _holds_study(held: pa.Schema, wanted: pa.Schema) -> bool:
    """Whether a part has the factors of the study, and columns of the same types: metrics may be fewer or more."""
    asked = wanted.names[: wanted.names.index("outcome") + 1]
    known = [name for name in held.names if name in wanted.names]
    return held.names[: len(asked)] == asked and all(
        held.field(n).type == wanted.field(n).type for n in known
    )


def _read_part(path: Path, rules: RowRules, columns: Sequence[str] | None) -> pa.Table:
    require_file(path, LARGEST_PART)
    try:
        with pq.ParquetFile(path) as file:
            if not _holds_study(file.schema_arrow, rules.schema):
                raise InputError(
                    f"{path_text(path)}: has other columns than the study; it is of another version or study"
                )
            wanted = rules.schema.names if columns is None else sorted({"run", "cell", "seed", *columns})
            table = file.read([name for name in wanted if name in file.schema_arrow.names])
            for name in set(wanted).difference(table.column_names):
                kind = rules.schema.field(name).type
                table = table.append_column(name, pa.nulls(len(table), kind))
            table = table.select(wanted).replace_schema_metadata()
    except (pa.ArrowException, OSError, ValueError) as error:
        raise InputError(
            f"{path_text(path)}: is no Parquet file of a campaign ({reason(error)}); remove it and resume"
        ) from None
    table = rules.rows_of(table)
    return table if columns is None else table.select(list(columns))


STUDY_FILE: Final = "campaign.toml"
BEGUN_FILE: Final = "campaign.json"
SCHEMA: Final = 1


def open_folder(folder: Path, study: Study, resume: bool) -> None:
    """Create or resume a campaign's folder, holding its lock.

    Raises
    ------
    InputError
        It holds something else, another study, or rows although the campaign is not resumed.
    """
    held = [
        path.name
        for path in folder.iterdir()
        if path.name not in (".lock",) and not path.name.endswith(".part")
    ]
    if held:
        _require_same(folder, study)
        if not resume and any((folder / ROWS).glob("*")):
            raise InputError(
                f"{path_text(folder)}: holds rows of this study; give --resume to continue, or another folder with -o"
            )
    if not (folder / BEGUN_FILE).exists():
        write_json(folder / BEGUN_FILE, begun(study))


def keep_study(folder: Path, study: Study, done: Collection[int]) -> None:
    """Write the study into the folder of its rows.

    InputError: there are rows of more seeds than it has.
    """
    if done and (last := max(done)) >= len(study):
        seeds = study.run(last).seed + 1
        raise InputError(
            f"{path_text(folder)}: holds runs of {seeds} seeds, study.seeds is {study.options.seeds}; give at least {seeds}, "
            "or another folder with -o"
        )
    write_toml(folder / STUDY_FILE, dict(study.document))


def begun(study: Study) -> dict[str, Any]:
    """Provenance of a campaign: commit, machine, date."""
    return {
        "schema": SCHEMA,
        "study": study.name,
        "fingerprint": study.fingerprint,
        "begun": datetime.now(UTC).isoformat(timespec="seconds"),
        "commit": git_commit() or "not a checkout",
        "machine": machine(),
    }


def machine() -> str:
    """This machine's processor and system in one line."""
    lines = Path("/proc/cpuinfo")
    model = ""
    if lines.exists():
        models = (
            line.split(":", 1)[1].strip()
            for line in lines.read_text().splitlines()
            if line.startswith("model name")
        )
        model = next(models, "")
    return f"{model or platform.machine()}, {platform.system()} {platform.release()}"


def read_folder(folder: Path) -> tuple[Study, dict[str, Any]]:
    """A campaign's study and its provenance.

    Raises
    ------
    InputError
        No folder of a campaign, or a damaged one.
    """
    if not (folder / STUDY_FILE).is_file() or not (folder / BEGUN_FILE).is_file():
        raise InputError(
            f"{path_text(folder)}: is no campaign's folder; give one made by 'spinfilters campaign'"
        )
    return read_study(folder / STUDY_FILE), _read_provenance(folder)


def _read_provenance(folder: Path) -> dict[str, Any]:
    """Provenance of a campaign's begin. InputError: damaged, or of another version."""
    try:
        document = json.loads(read_settings_text(folder / BEGUN_FILE))
    except (ValueError, RecursionError):
        document = None
    if not isinstance(document, dict) or document.get("schema") != SCHEMA:
        raise InputError(
            f"{path_text(folder / BEGUN_FILE)}: is damaged or of another version; run the campaign again"
        )
    return document


def _require_same(folder: Path, study: Study) -> None:
    if not (folder / BEGUN_FILE).exists():
        raise InputError(
            f"{path_text(folder)}: is not empty and no campaign's folder; choose another folder with -o"
        )
    if _read_provenance(folder).get("fingerprint") != study.fingerprint:
        raise InputError(
            f"{path_text(folder)}: holds another study than {study.name!r}; choose another folder with -o"
        )
