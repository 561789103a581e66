"""Lines of labels with numbers, as microcontrollers print them to a serial port and programs to their logs.

- ``12:34:05.020 -> gx:0.31 gy:1.49 gz:0.06``, ``Rotation X: 0.31, Y: 1.49, Z: 0.06 rad/s``
- ``t=0.02 w=[0.31 1.49 0.06] q=(0, 0, 0, 1)``
- ``2024-03-15 10:00:00,020 INFO imu gyro: {x: 0.31, y: 1.49, z: 0.06}``
- ``2024-03-15T10:00:00.020,FD,1C,mavlink_attitude_t,rollspeed,0.31,pitchspeed,1.49,yawspeed,0.06``

A number is called by the label in front of it, behind those of the brackets around it. Numbers that follow one label are the
components of a vector. Lines with the same labels are the rows of one table.
"""

import itertools
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.io.calendar_clock import seconds_of_clock
from spinfilters.io.dataset import Dataset
from spinfilters.io.headings import is_clock
from spinfilters.io.input_file import (
    MAX_TABLE_BYTES,
    first_text,
    path_text,
    require_file,
    require_text_table,
    value_text,
)
from spinfilters.io.motion_columns import motion_columns
from spinfilters.io.motion_file import motion_dataset
from spinfilters.io.motion_table import motion_of
from spinfilters.io.named_columns import ArrayColumns
from spinfilters.io.stated_values import ReadingOptions, to_state
from spinfilters.io.text_table import last_lines, looks_cut

_HEAD: Final = 1 << 14
_FEWEST: Final = 3
"""Numbers with labels of a line that is one of measurements."""
_NUMBER: Final = re.compile(r"(?<![A-Za-z0-9_.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\d:]|\.\d)")
_DATE: Final = re.compile(
    r"(?:\d{4}[-/]\d{1,2}[-/]\d{1,2}[T ])?(?<!\d)\d{1,2}:\d{2}:\d{2}(?:[.,:]\d+)?(?:Z|[+-]\d{2}:?\d{2})?(?!\d)"
)
_TICKS: Final = re.compile(r"(?:\x1b\[[\d;]*m)?[EWIDV] \((\d+)\) ")
"""Of ESP-IDF: the level of a message, and ms since the start."""
_UNIT: Final = re.compile(
    r"\s*\(?((?:m?rad(?:ians?)?|m?deg(?:rees?)?|°)/s(?:ec(?:ond)?)?|m?dps|m/s\^?2|m/s/s|[mun]?s|m?g)\)?(?![A-Za-z:=])"
)
"""Of the number in front of it."""
_MOTION_UNIT: Final = re.compile(r"(?:m?rad|m?deg|°).*/s.*|m?dps|m/s\^?2|m/s/s")
"""Of a rate or an acceleration: it shows that a word and three numbers in front of it are measured: gyro 0.1 0.2 0.3 rad/s."""
_LABEL: Final = re.compile(
    r"""["']?([A-Za-z_](?:[\w./-]| (?=[A-Za-z_]))*(?:\[\d\])?)["']?\s*(?:\(([^()]{1,9})\)\s*)?([:=]?)\s*$"""
)
"""A label at the end of a text, perhaps with the unit of its numbers."""
_NAME: Final = re.compile(r"[A-Za-z_][\w.]*(?:\[\d\])?")
_WHOLE: Final = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
"""A cell that is a name, and one that is a number."""
_OPENING, _CLOSING = "[({", "])}"
_MOST_NUMBERS: Final = 200


class _Line(NamedTuple):
    """Number of a line, its labels with their units, its numbers, the first perhaps its date (s), and the name of its message."""

    line: int
    labels: tuple[str, ...]
    numbers: tuple[float, ...]
    message: str = ""


def has_labelled_lines(path: Path) -> bool:
    """Whether three of the first lines have the same labels, those of a clock or of a motion among them, or half have labels."""
    held = [line for line in first_text(path, _HEAD).splitlines()[:200] if line.strip()]
    lines = [found for k, line in enumerate(held[:80]) if (found := _line(k, line)) is not None]
    return 3 * len(lines) >= max(len(held[:80]), 1)


def read_labelled_lines(path: Path, options: ReadingOptions) -> Dataset:
    """Rates, poses or attitudes of the lines that have some. InputError: no UTF-8; no such lines; a damaged one."""
    options.require_only(("unit", "clock", "rate", "topic"), "a log of labelled lines")
    require_file(path, MAX_TABLE_BYTES)
    require_text_table(path)
    lines = _lines(path)
    kinds = Counter(line.labels for line in lines)
    moving = [
        labels for labels, count in kinds.most_common() if count >= _FEWEST and _is_motion(path, labels)
    ]
    if not moving:
        raise InputError(
            f"{path_text(path)}: no line has body rates about x, y and z; print them as gx:0.1 gy:0.2 gz:0.3"
        )
    chosen = [line for line in lines if line.labels == moving[0]]
    _require_numbers(path, chosen)
    if _ends_with_cut_number(path, chosen[-1]):
        chosen.pop()
    messages = sorted({line.message for line in chosen})
    if options.topic in messages:
        chosen = [line for line in chosen if line.message == options.topic]
        options = replace(options, topic=None)
    elif len(messages) > 1:
        raise InputError(
            f"{path_text(path)}: {', '.join(messages[:6])} each have body rates; give {to_state('topic', 'ONE OF THEM')}"
        )
    columns = dict(zip(moving[0], np.array([line.numbers for line in chosen]).T, strict=True))
    if not _has_clock(moving[0]):
        columns = _times_above(lines, chosen) | columns
    if not _has_clock(tuple(columns)):
        _require_whole(path, lines, chosen)
    source = ArrayColumns(path, tuple(columns), tuple(columns.values()))
    return motion_dataset(path, path.name, motion_of(source, options))


def _require_numbers(path: Path, chosen: Sequence[_Line]) -> None:
    """InputError: a line that is not chosen marks all labels of the chosen ones, but one of these has no number behind it.

    A legend above the first of them, with words behind all labels, is none of these; nor is a last line that is cut off there.
    """
    names = {re.split(r"[. ]", label)[-1]: is_clock(label) for label in chosen[0].labels}
    marks = {name: re.compile(rf"""(?<![\w.]){re.escape(name)}["']?\s*[:=]\s*["']?""") for name in names}
    with open(path, encoding="utf-8-sig") as stream:
        first = next(itertools.islice(stream, chosen[0].line - 1, None))
    for name, is_time in names.items():
        if is_time and not marks[name].search(first):  # a date
            del marks[name]
    read = {line.line for line in chosen}
    with open(path, encoding="utf-8-sig") as stream:
        for number, text in enumerate(stream, start=1):
            if number in read or not all(mark.search(text) for mark in marks.values()):
                continue
            wrong = _without_number(text, marks)
            is_legend = number < chosen[0].line and all(value[:1].isalpha() for _, value in wrong)
            if not wrong or (is_legend and len(wrong) >= len(marks) and not _NOT_FINITE.search(text)):
                continue
            name, value = wrong[0]
            if not text.endswith("\n") and text.endswith(value):  # the last line, cut off
                continue
            raise InputError(
                f"{path_text(path)}: line {number}: {value_text(name)} is {value_text(value) if value else 'nothing'}, no number; "
                "correct or delete the line"
            )


def _ends_with_cut_number(path: Path, last: _Line) -> bool:
    """Whether a file ends within the last number of this line, because the power went while it was written."""
    *before, text = last_lines(path, "utf-8") or [""]
    end = _line(last.line, text)
    if (
        end is None
        or (end.labels, end.numbers) != (last.labels, last.numbers)
        or not text.endswith(_digits(text))
    ):
        return False
    above = next(
        (line for line in reversed(before) if (found := _line(0, line)) and found.labels == last.labels), ""
    )
    return looks_cut(_digits(above), _digits(text))


def _digits(text: str) -> str:
    """The last number of a line, as it is written; a sign says nothing of digits."""
    numbers = _NUMBER.findall(text)
    return numbers[-1].lstrip("+-") if numbers else ""


_NOT_FINITE: Final = re.compile(r"\b(?:nan|inf)", re.IGNORECASE)


def _without_number(text: str, marks: Mapping[str, re.Pattern[str]]) -> list[tuple[str, str]]:
    """Labels of a line without a number behind them, and what stands there, in the order of the line."""
    places = sorted((found.end(), name) for name, mark in marks.items() for found in mark.finditer(text))
    wrong = []
    for place, name in places:
        value = re.split(r"[\s;}\]]", text[place:], maxsplit=1)[0]
        number = _NUMBER.match(text, place)
        if number is None or re.match(r",\d", text[number.end() :]):
            wrong.append((name, "" if any(mark.match(value) for mark in marks.values()) else value))
    return wrong


def _times_above(lines: Sequence[_Line], chosen: Sequence[_Line]) -> dict[str, np.ndarray]:
    """The clock that stands in a line of its own above each of the chosen ones; none where there is none."""
    clocks = {
        line.line: line for line in lines if _has_clock(line.labels) and line.labels != chosen[0].labels
    }
    places, found, last = np.array(sorted(clocks)), [], -1
    for line in chosen:
        above = int(np.searchsorted(places, line.line)) - 1
        if above < 0 or above == last:
            return {}
        last = above
        clock = clocks[int(places[above])]
        found.append({n: x for n, x in zip(clock.labels, clock.numbers, strict=True) if is_clock(n)})
    names = found[0].keys()
    return (
        {n: np.array([each[n] for each in found]) for n in names}
        if all(f.keys() == names for f in found)
        else {}
    )


def _require_whole(path: Path, lines: Sequence[_Line], chosen: Sequence[_Line]) -> None:
    """InputError: between lines that have no time one that has other labels, so that it may be a damaged one of them."""
    kinds = Counter(line.labels for line in lines)
    between = [line for line in lines if chosen[0].line < line.line < chosen[-1].line]
    odd = next((line for line in between if 20 * kinds[line.labels] < len(chosen)), None)
    if odd is not None:
        raise InputError(
            f"{path_text(path)}: line {odd.line}: has other labels than the others ({value_text(', '.join(odd.labels))}), and "
            "no line has a time; correct it, or print the time"
        )


def _has_clock(labels: Sequence[str]) -> bool:
    return any(map(is_clock, labels))


def _is_motion(path: Path, labels: tuple[str, ...]) -> bool:
    """Whether labels are those of rates or of an attitude."""
    try:
        return motion_columns(path, labels, ReadingOptions(rate=1.0)).describe_motion
    except InputError:
        return True  # which says what is twice


def _lines(path: Path) -> list[_Line]:
    """All lines with labels. InputError: no UTF-8."""
    try:
        with open(path, encoding="utf-8-sig") as stream:
            return [
                found
                for k, text in enumerate(stream, start=1)
                if (found := _line(k, text) or _date_alone(k, text)) is not None
            ]
    except UnicodeDecodeError:
        raise InputError(f"{path_text(path)}: is not UTF-8; save it as UTF-8 text") from None


def _date_alone(number: int, text: str) -> _Line | None:
    """The date with which a line without measurements begins, the clock of those below it; None without one."""
    found = _DATE.search(text)
    if found is None or text[: found.start()].strip(" [(<"):
        return None
    time = seconds_of_clock(found[0])
    return None if time is None else _Line(number, ("time (s)",), (time,))


class _Reading:
    """Labels of the numbers of a line, as they are met from its beginning on."""

    def __init__(self) -> None:
        self.labels: list[str] = []
        self.units: list[str] = []
        self.own = 0
        """Labels with a mark behind them: a colon, an equals sign or a bracket."""
        self._brackets: list[str] = []
        self._stem, self._count = "", 0
        self._group, self._unit = "", ""

    def text(self, text: str) -> None:
        """Read what stands between two numbers: brackets with the label in front of each, and the label of the next number."""
        begin = 0
        for place, letter in enumerate(text):
            if letter in _OPENING and not _is_unit_in_brackets(text, place):
                self._open(text[begin:place])
                begin = place + 1
            elif letter in _CLOSING and self._brackets and not _closes_unit(text, place):
                self._brackets.pop()
                self._stem, self._count, begin = "", 0, place + 1
        if (found := _LABEL.search(text[begin:])) is not None:
            self._label(found)
        elif begin == 0 and text.strip(" \t,;|"):
            self._stem = ""

    def _open(self, text: str) -> None:
        found = _LABEL.search(text)
        name = found[1].strip() if found is not None else ""
        self._brackets.append(name)
        self._unit_of_label(found)
        self._stem, self._count, self.own = name or self._stem, 0, self.own + (found is not None)

    def _unit_of_label(self, found: re.Match[str] | None) -> None:
        self._unit = (found[2] or "").lower() if found is not None else ""

    def _label(self, found: re.Match[str]) -> None:
        name = found[1].strip()
        words = name.split()
        if len(words) > 1 and self.labels and words[0].lower() in ("s", "ms", "us", "deg", "rad", "g"):
            name = " ".join(words[1:])  # the unit of the number in front
        if len(name) == 1 and name.lower() in "xyzw" and self._group and not any(self._brackets):
            name = f"{self._group} {name}"
        elif len(name) > 2 and name[-2] in " _." and name[-1].lower() in "xyzw":
            self._group = name[:-2]
        elif len(name) > 1:
            self._group = name
        outer = [each for each in self._brackets if each]
        self._stem, self._count = ".".join([*outer, name]), 0
        self.own += bool(found[3])
        self._unit_of_label(found)

    def number(self, unit: str) -> None:
        """Note the next number, with the unit behind it."""
        self.labels.append(f"{self._stem}\0{self._count}")
        self.units.append(unit or self._unit)
        self._count += 1


def _is_unit_in_brackets(text: str, place: int) -> bool:
    """Whether brackets within a text hold words alone, as those of a unit do: Gyr (DPS) [."""
    return re.match(r"\([A-Za-z°/^2]{1,9}\)", text[place:]) is not None


def _closes_unit(text: str, place: int) -> bool:
    return re.search(r"\([A-Za-z°/^2]{1,9}\)$", text[: place + 1]) is not None


def _line(number: int, text: str) -> _Line | None:
    """Labels and numbers of a line, of which at least three have a label or stand in labelled brackets; None of another."""
    text = text.strip()
    found = _DATE.search(text)
    time = seconds_of_clock(found[0]) if found is not None else None
    if found is not None and time is not None:
        text = text[: found.start()].rstrip("[ ") + " " + text[found.end() :].lstrip("] ")
    ticks = _TICKS.match(text) if time is None else None
    text, message = _pairs(text if ticks is None else text[ticks.end() :])
    reading, numbers, place = _Reading(), [], 0
    for each in _NUMBER.finditer(text):
        if each.start() < place:
            continue
        reading.text(text[place : each.start()])
        unit = _UNIT.match(text, each.end())
        reading.number(unit[1].lower() if unit is not None else "")
        numbers.append(float(each[0]))
        place = unit.end() if unit is not None else each.end()
        if len(numbers) > _MOST_NUMBERS:
            return None
    labels = _called(reading)
    is_time = 0 < len(labels) <= 2 and time is None and _has_clock(labels)
    is_vector = all(labels) and any(map(_MOTION_UNIT.fullmatch, reading.units))
    if not (reading.own or is_vector) or (sum(bool(label) for label in labels) < _FEWEST and not is_time):
        return None
    if time is not None:
        return _Line(number, ("time (s)", *labels), (time, *numbers), message)
    if ticks is not None:
        return _Line(number, ("time (ms)", *labels), (float(ticks[1]), *numbers), message)
    if labels and not labels[0]:
        labels = ("time", *labels[1:])
    return _Line(number, labels, tuple(numbers), message)


def _called(reading: _Reading) -> tuple[str, ...]:
    """Labels of all numbers: those of a vector of three end with its axes, of others with their places; empty without one."""
    parts = [label.split("\0") for label in reading.labels]
    counts = Counter(stem for stem, _ in parts)
    named = []
    for (stem, place), unit in zip(parts, _units(parts, reading.units), strict=True):
        count = counts[stem]
        axis = (
            "" if count == 1 else f"_{'xyz'[int(place)]}" if count == 3 and int(place) < 3 else f"[{place}]"
        )
        named.append("" if not stem else f"{stem}{axis} ({unit})" if unit else f"{stem}{axis}")
    fronts = {name.partition(".")[0] for name in named if name}
    if len(fronts) == 1 and all(
        "." in name for name in named if name
    ):  # what all of them are of, as the topic of a message
        named = [name.partition(".")[2] for name in named]
    twice = {name for name in named if named.count(name) > 1}
    return tuple("" if name in twice else name for name in named)


def _pairs(text: str) -> tuple[str, str]:
    """A line whose cells end with pairs of a name and a number as one of labels, and the name in front of them; else itself."""
    cells = text.rstrip(" ,;").split(";" if text.count(";") > text.count(",") else ",")
    begin = len(cells)
    while (
        begin > 1 and _NAME.fullmatch(cells[begin - 2].strip()) and _WHOLE.fullmatch(cells[begin - 1].strip())
    ):
        begin -= 2
    if len(cells) - begin < 2 * _FEWEST:
        return text, ""
    own = [
        f"{name.strip()}: {number.strip()}"
        for name, number in zip(cells[begin::2], cells[begin + 1 :: 2], strict=True)
    ]
    message = cells[begin - 1].strip() if begin else ""
    return " ".join(own), message if _NAME.fullmatch(message) else ""


def _units(parts: Sequence[Sequence[str]], units: Sequence[str]) -> list[str]:
    """Units of all numbers: one belongs to all components of its vector."""
    found = list(units)
    for k in reversed(range(len(parts) - 1)):
        here, behind = parts[k][0], parts[k + 1][0]
        if not found[k] and found[k + 1] and (here == behind or here[:-1] == behind[:-1]):
            found[k] = found[k + 1]
    return found
