"""Two recordings of the golden runs, file by file and array by array, bit by bit.

What differs between two runs of the same code is left out: times that were measured, versions, and places of files.
"""

import json
import re
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

MEASURED: Final = re.compile(
    r"runtime|milliseconds|duration|elapsed|seconds_per|^seconds$|per_second|begun|created|finished|started|version|commit|host|machine"
    r"|fingerprint|^time_\w+_s$|spent|processor|revision"
)
"""Names of numbers that a clock or the machine gives, rather than the mathematics."""
STATED: Final = re.compile(r"^(git_commit|version|python|platform) = ")
"""Lines of a settings file that say what wrote it."""
LEFT_OUT: Final = {".png", ".html", ".svg", ".gif", ".log", ".lock", ".md"}
"""Kinds of files whose content is a picture of numbers that stand in another file."""


def differences(one: Path, other: Path) -> Iterator[str]:
    """Sentences on all that differs between two folders of golden runs, in the order of the files.

    Parameters
    ----------
    one, other : Path
        Folders that `tests.golden` has recorded.
    """
    names, others = _files(one), _files(other)
    for name in sorted(names ^ others):
        yield f"{name}: only in {one if name in names else other}"
    for name in sorted(names & others):
        for what in _file_differences(one / name, other / name):
            yield f"{name}: {what}"


def _files(folder: Path) -> set[str]:
    found = (path for path in folder.rglob("*") if path.is_file() and path.suffix not in LEFT_OUT)
    return {path.relative_to(folder).as_posix() for path in found}


def _file_differences(one: Path, other: Path) -> Iterator[str]:
    match one.suffix:
        case ".npz":
            yield from _value_differences(_arrays(one), _arrays(other))
        case ".json":
            yield from _value_differences(_leaves(one), _leaves(other))
        case ".parquet":
            yield from _value_differences(_columns(one), _columns(other))
        case _:
            if _lines(one) != _lines(other):
                yield _first_line(one, other)


def _value_differences(one: dict[str, Any], other: dict[str, Any]) -> Iterator[str]:
    for name in sorted(one.keys() | other.keys()):
        if MEASURED.search(name):
            continue
        if name not in one or name not in other:
            yield f"{name} is only in one of both"
        elif not _same(one[name], other[name]):
            yield f"{name} {_difference(one[name], other[name])}"


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return one.shape == other.shape and one.dtype == other.dtype and one.tobytes() == other.tobytes()
    return one == other or (one != one and other != other)


def _difference(one: Any, other: Any) -> str:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        if one.shape != other.shape:
            return f"has shape {one.shape}, other {other.shape}"
        if one.dtype.kind in "fiu" and one.size:
            gap = np.abs(one.astype(float) - other.astype(float))
            largest = np.nanmax(gap, initial=0.0)
            return f"differs in {np.count_nonzero(gap)} of {gap.size} values, by up to {largest:.3g}"
        return "differs"
    return f"is {one!r}, other {other!r}"


def _arrays(path: Path) -> dict[str, Any]:
    try:
        with np.load(path, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except (ValueError, zipfile.BadZipFile) as error:
        return {"unreadable": str(error)}


def _leaves(path: Path) -> dict[str, Any]:
    """All values of a JSON file by their path, such as ``estimators.mekf.k1``."""
    found: dict[str, Any] = {}

    def take(value: Any, name: str) -> None:
        match value:
            case dict():
                for key, inner in value.items():
                    take(inner, f"{name}.{key}" if name else str(key))
            case list():
                for index, inner in enumerate(value):
                    take(inner, f"{name}[{index}]")
            case _:
                found[name] = value

    take(json.loads(path.read_text(encoding="utf-8")), "")
    return found


def _columns(path: Path) -> dict[str, Any]:
    from pyarrow import parquet  # only campaigns need it

    table = parquet.read_table(path)
    return {name: repr(table.column(name).to_pylist()) for name in table.column_names}


def _first_line(one: Path, other: Path) -> str:
    lines = zip(_lines(one), _lines(other), strict=False)
    for number, (own, its) in enumerate(lines, start=1):
        if own != its:
            return f"line {number} differs: {own[:100]} | {its[:100]}"
    return "has another number of lines"


def _lines(path: Path) -> list[str]:
    """Lines of a text without those that state a version or a commit."""
    lines = path.read_text(encoding="utf-8", errors="backslashreplace").splitlines()
    return [line for line in lines if not STATED.match(line)]
