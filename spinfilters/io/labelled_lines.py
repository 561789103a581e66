"""Logs of a serial port: lines of labels with numbers, as microcontrollers print them, perhaps after the time of each line.

Examples: ``12:34:05.020 -> gx:0.31 gy:1.49 gz:0.06``, and ``Rotation X: 0.31, Y: 1.49, Z: 0.06 rad/s``.
"""

import re
from collections import Counter
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.io.calendar_clock import seconds_of_clock
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import MAX_TABLE_BYTES, first_text, path_text, require_file, require_text_table
from spinfilters.io.motion_columns import heading_of
from spinfilters.io.motion_file import motion_dataset
from spinfilters.io.motion_table import motion_of
from spinfilters.io.named_columns import ArrayColumns
from spinfilters.io.stated_values import ReadingOptions

_HEAD: Final = 1 << 14
_FEWEST: Final = 3
"""Labels of a line that is one of measurements."""
_LABEL = r"([A-Za-z_][A-Za-z0-9_. \[\]]{0,39}?)"
_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_UNIT = r"((?:m?rad|m?deg|°)/s(?:ec)?|m?dps|m/s\^?2|m/s/s|[mun]?s|m?g)"
_PAIR = re.compile(rf"{_LABEL}\s*[:=]\s*{_NUMBER}(?![\d:])(?:\s*{_UNIT}(?![A-Za-z:=]))?")
"""Label, number and perhaps unit."""
_GROUP = re.compile(
    rf"([A-Za-z]\w{{0,20}}) \(([^()]{{1,6}})\) \[\s*{_NUMBER}\s*,\s*{_NUMBER}\s*,\s*{_NUMBER}\s*\]"
)
"""Label, unit and three numbers, as examples of SparkFun print them: Gyr (DPS) [ 00000.85, -00013.67, 00001.09 ]."""


class _Line(NamedTuple):
    """Time of a line, s, None where it has none; labels with their units, and numbers."""

    time: float | None
    labels: tuple[str, ...]
    numbers: tuple[float, ...]


def has_labelled_lines(path: Path) -> bool:
    """Whether at least half of the first lines have three labels with numbers."""
    held = [line for line in first_text(path, _HEAD).splitlines() if line.strip()][:40]
    return 2 * sum(len(_PAIR.findall(_in_pairs(line))) >= _FEWEST for line in held) >= max(len(held), 1)


def read_labelled_lines(path: Path, options: ReadingOptions) -> Dataset:
    """Rates of the lines that have some."""
    options.require_only(("unit", "clock", "rate"), "a log of a serial port")
    require_file(path, MAX_TABLE_BYTES)
    require_text_table(path)
    lines = [line for line in _lines(path) if len(line.labels) >= _FEWEST]
    kinds = Counter((line.labels, line.time is not None) for line in lines)
    rates = [kind for kind, _ in kinds.most_common() if _has_rate(kind[0])]
    if not rates:
        raise InputError(
            f"{path_text(path)}: no line has body rates about x, y and z; print them as gx:0.1 gy:0.2 gz:0.3"
        )
    labels, is_timed = rates[0]
    chosen = [line for line in lines if line.labels == labels and (line.time is not None) == is_timed]
    columns = dict(zip(labels, np.array([line.numbers for line in chosen]).T, strict=True))
    if is_timed:
        columns = {"time (s)": np.array([line.time for line in chosen], dtype=np.float64), **columns}
    source = ArrayColumns(path, tuple(columns), tuple(columns.values()))
    return motion_dataset(path, path.name, motion_of(source, options))


def _has_rate(labels: tuple[str, ...]) -> bool:
    headings = [heading_of(label) for label in labels]
    return {each.axis for each in headings if each is not None and each.quantity == "rate"} == set("xyz")


def _lines(path: Path) -> list[_Line]:
    """All lines with labels. InputError: no UTF-8."""
    try:
        with open(path, encoding="utf-8-sig") as stream:
            return [_line(text) for text in stream]
    except UnicodeDecodeError:
        raise InputError(f"{path_text(path)}: is not UTF-8; save it as UTF-8 text") from None


def _in_pairs(text: str) -> str:
    """A line whose groups of three numbers are three labels with a number and a unit each."""
    return _GROUP.sub(
        lambda group: ", ".join(
            f"{group[1]} {axis}: {number} {group[2].lower()}"
            for axis, number in zip("xyz", group.groups()[2:], strict=True)
        ),
        text,
    )


def _line(text: str) -> _Line:
    """A line's time, labels and numbers: an axis alone belongs to the label before, and a unit to all of its label."""
    text = _in_pairs(text)
    pairs = list(_PAIR.finditer(text))
    names, group = [], ""
    for pair in pairs:
        name = pair[1].strip()
        if len(name) == 1 and name.lower() in "xyz" and group:
            name = f"{group} {name}"
        elif len(name) > 2 and name[-2] in " _." and name[-1].lower() in "xyz":
            group = name[:-2]
        names.append(name)
    units = [pair[3] or "" for pair in pairs]
    for k in reversed(range(len(pairs) - 1)):
        if not units[k] and names[k][:-1] == names[k + 1][:-1]:
            units[k] = units[k + 1]
    labels = tuple(f"{name} ({unit})" if unit else name for name, unit in zip(names, units, strict=True))
    front = text[: pairs[0].start()] if pairs else ""
    time = seconds_of_clock(front.strip().removesuffix("->").rstrip(" ,;]").lstrip("[").strip())
    return _Line(time, labels, tuple(float(pair[2]) for pair in pairs))
