"""Malformed tables: every table of a data set with a fault of its cells, its lines, its bytes or its numbers."""

import gzip
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from .case import COMPARE, Case
from .changes import Change, bytes_of, cell, column, content, instead, lines_of, sparse, without

PHONE = ("compare", "{in}", "--segment", "1", "-o", "{out}/run", "--estimators", "mekf")


@dataclass(frozen=True)
class TableFile:
    """A table: the folder it stands in, its name, columns, lines of header, and columns of measured numbers."""

    original: str
    name: str
    columns: int
    measured: tuple[int, ...]
    header: int = 1
    arguments: tuple[str, ...] = field(default=COMPARE)


TABLES = (
    TableFile("stereo", "tracks.csv", 5, (2, 4)),
    TableFile("unmapped", "tracks.csv", 5, (2, 3)),
    TableFile("gyro", "gyro.csv", 4, (1, 3)),
    TableFile("pose", "poses.tum", 8, (1, 4)),
    TableFile("gyro-covariance", "gyro_covariance.csv", 7, (1, 2)),
    TableFile("pose-covariance", "poses_covariance.csv", 22, (1, 3)),
    TableFile("stereo-covariance", "tracks_covariance.csv", 7, (1, 6)),
    TableFile("stereo", "landmarks.csv", 4, (1, 3)),
    TableFile("pose", "truth.csv", 14, (1, 11)),
    TableFile("phone", "Raw Data.csv", 5, (1, 3), arguments=PHONE),
    TableFile("phone", "meta/segments.csv", 5, (1,), arguments=PHONE),
)

CELLS = {
    "NaN": "nan",
    "infinite": "-inf",
    "empty": "",
    "beyond float64": "1e999",
    "largest float64": "1.7e308",
    "denormal": "4e-320",
    "of 5000 digits": "9" * 5000,
    "hexadecimal": "0x10",
    "of underscores": "1_0",
    "of other digits": "١٢",
    "a word": "fast",
    "a minus of typographers": "−1",
    "quoted": '"1"',
    "two numbers": "1;2",
}

BYTES = {
    "empty": b"",
    "only a line feed": b"\n",
    "a picture": b"\x89PNG\r\n\x1a\n" + bytes(64),
    "zeros": bytes(4096),
    "of one endless line": b"1," * 800_000,
    "of a million columns": b",".join([b"a"] * 260_000) + b"\n" + b",".join([b"1"] * 260_000) + b"\n",
    "a page of HTML": b"<!DOCTYPE html><html><body>404</body></html>\n",
}


def table_cases() -> Iterator[Case]:
    """Faults of every table."""
    for table in TABLES:
        faults = {**_cells(table), **_lines(table), **_bytes(table), **_numbers(table), **_no_files(table)}
        for what, change in faults.items():
            yield Case(f"{table.original}/{table.name}: {what}", table.original, change, table.arguments)


def _cells(table: TableFile) -> dict[str, Change]:
    last = table.header + 1
    places = [0, *table.measured]
    return {
        f"{'time' if column == 0 else f'cell {column}'} {what}": cell(table.name, last, column, text)
        for number, (what, text) in enumerate(CELLS.items())
        for column in (places[number % len(places)],)
    }


def _lines(table: TableFile) -> dict[str, Change]:
    name, head = table.name, table.header
    return {
        "header only": lines_of(name, lambda lines: lines[:head]),
        "one row": lines_of(name, lambda lines: lines[: head + 1]),
        "three rows": lines_of(name, lambda lines: lines[: head + 3]),
        "no header": lines_of(name, lambda lines: lines[1:]),
        "header twice": lines_of(name, lambda lines: [*lines[:1], *lines]),
        "rows in reverse": lines_of(name, lambda lines: [*lines[:head], *lines[: head - 1 : -1]]),
        "a row twice": lines_of(name, lambda lines: [*lines[: head + 2], *lines[head + 1 :]]),
        "every second row missing": lines_of(name, lambda lines: [*lines[:head], *lines[head::2]]),
        "a row cut off": lines_of(name, lambda lines: [*lines[:-1], lines[-1][: len(lines[-1]) // 2]]),
        "a cell too many": lines_of(name, lambda lines: [*lines[:-1], lines[-1] + ",1"]),
        "an unclosed quote": lines_of(name, lambda lines: [*lines[:-1], '"' + lines[-1]]),
        "a comment": lines_of(
            name, lambda lines: [*lines[: head + 1], "# so far so good", *lines[head + 1 :]]
        ),
        "blank lines": lines_of(name, lambda lines: [part for line in lines for part in (line, "", "  ")]),
    }


def _bytes(table: TableFile) -> dict[str, Change]:
    name = table.name
    texts = {what: content(name, data) for what, data in BYTES.items()}
    return {
        **texts,
        "packed": bytes_of(name, gzip.compress),
        "UTF-16": bytes_of(name, lambda data: data.decode().encode("utf-16")),
        "a byte that is not UTF-8": bytes_of(name, lambda data: data[:-9] + b"\xb5" + data[-9:]),
        "a NUL byte": bytes_of(name, lambda data: data[:-9] + b"\0" + data[-9:]),
        "old line ends": bytes_of(name, lambda data: data.replace(b"\n", b"\r")),
        "semicolons for commas": bytes_of(name, lambda data: data.replace(b",", b";")),
    }


def _numbers(table: TableFile) -> dict[str, Change]:
    """Readable numbers of impossible sizes."""
    name, column_of, head = table.name, table.measured[0], table.header
    if name == "meta/segments.csv":
        return {}
    changes = {
        "a column times 1e300": column(name, column_of, lambda value, _: value * 1e300, head),
        "a column times 1e-300": column(name, column_of, lambda value, _: value * 1e-300, head),
        "a column times 1e9": column(name, column_of, lambda value, _: value * 1e9, head),
        "a column of zeros": column(name, column_of, lambda *_: 0.0, head),
        "one number of 1e150": column(name, column_of, lambda value, row: 1e150 if row == 7 else value, head),
        "one number of 1e5": column(name, column_of, lambda value, row: 1e5 if row == 7 else value, head),
    }
    if name == "landmarks.csv":
        return changes
    return changes | {
        "time times 1e6": column(name, 0, lambda value, _: value * 1e6, head),
        "time times 1e-12": column(name, 0, lambda value, _: value * 1e-12, head),
        "time times 1e-300": column(name, 0, lambda value, _: value * 1e-300, head),
        "a gap of ten years": column(name, 0, lambda value, _: value + 3e8 * (value > 1.0), head),
        "time from 9e10 s on": column(name, 0, lambda value, _: value + 9e10, head),
    }


def _no_files(table: TableFile) -> dict[str, Change]:
    name = table.name
    return {
        "missing": without(name),
        "a folder": instead(name, Path.mkdir),
        "a pipe": instead(name, os.mkfifo),
        "a link to itself": instead(name, lambda path: path.symlink_to(path.name)),
        "a link to an endless device": instead(name, lambda path: path.symlink_to("/dev/zero")),
        "of three gigabytes": instead(name, sparse(3 << 30)),
    }
