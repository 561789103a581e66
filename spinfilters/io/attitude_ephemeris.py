"""Attitude ephemerides of spacecraft: STK's .a, the AEM of CCSDS as text (KVN) and as XML, and its ACM."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.io.calendar_clock import seconds_of_clock
from spinfilters.io.dataset import Dataset
from spinfilters.io.document import read_xml
from spinfilters.io.input_file import (
    MAX_TABLE_BYTES,
    finite_numbers,
    parse_number,
    path_text,
    read_bytes,
    value_text,
)
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.motion_file import motion_dataset
from spinfilters.io.motion_table import MotionTable
from spinfilters.io.sensor_tables import require_clock
from spinfilters.io.stated_values import ReadingOptions
from spinfilters.io.table_layout import TableLayout
from spinfilters.io.text_table import Table

_POSITIONS: Final = (".e", ".oem")
"""Ephemerides of positions, which hold no attitude."""
_STK_FORMATS: Final = {
    "attitudetimequaternions": (1, 2, 3, 4),
    "attitudetimequatscalarfirst": (2, 3, 4, 1),
    "attitudetimequatangvels": (1, 2, 3, 4),
}
"""Places of x, y, z and w after the time, by the keyword above the rows."""
_BODY = re.compile(r"SC_BODY|SPACECRAFT|BODY|INSTRUMENT|SENSOR|BUS", re.IGNORECASE)
"""Frames of CCSDS that are fixed in the spacecraft."""
_KEY = re.compile(r"\s*([A-Za-z_]+)\s*=\s*(.*?)\s*(?:\[.*\]\s*)?")


def read_attitude_ephemeris(path: Path, options: ReadingOptions) -> Dataset:
    """Attitudes q_ib of all rows.

    Both formats write the quaternion of the transformation from the inertial to the body frame, A(q) of Wertz (1978, Eq. 12-13),
    whose components are those of our q_ib, from body to inertial.
    """
    options.require_only((), "an attitude ephemeris")
    if path.suffix.lower() in _POSITIONS:
        raise InputError(
            f"{path_text(path)}: an ephemeris of positions holds no attitude; give that of attitudes (.a, .aem)"
        )
    rows = _rows(path)
    names = ("time_s", "qx", "qy", "qz", "qw")
    numbers = np.array([row.numbers for row in rows], dtype=np.float64).reshape(-1, 5)
    table = Table(path, TableLayout(names), names, numbers, [row.line for row in rows])
    if not rows:
        raise InputError(f"{path_text(path)}: has no rows of attitudes; export it again")
    require_clock(table)
    with table.naming_lines():
        stream = MeasurementStream("attitude", numbers[:, 0], numbers[:, 1:])
    return motion_dataset(path, path.name, MotionTable(stream, None, ()))


def _rows(path: Path) -> list["_Attitude"]:
    """Attitudes of a file of any of the formats."""
    data = read_bytes(path, MAX_TABLE_BYTES)
    if data.lstrip(b"\xef\xbb\xbf \r\n\t").startswith(b"<"):
        return _xml_rows(path)
    lines = data.decode("utf-8", "replace").splitlines()
    is_ccsds = any(line.lstrip().startswith(("CCSDS_AEM_VERS", "CCSDS_ACM_VERS")) for line in lines[:20])
    return _ccsds_rows(path, lines) if is_ccsds else _stk_rows(path, lines)


class _Attitude(NamedTuple):
    """Line of a row, from 1, of XML its number; its time, s, and q_ib."""

    line: int
    numbers: tuple[float, ...]


def _numbers(path: Path, line: int, cells: Sequence[str], count: int) -> list[float]:
    """Finite numbers of at least so many cells. InputError: fewer, or other cells."""
    numbers = finite_numbers(cells)
    if len(numbers) < count:
        raise InputError(
            f"{path_text(path)}: line {line}: {value_text(' '.join(cells))} are not {count} numbers; correct or delete the line"
        )
    return numbers


def _stk_rows(path: Path, lines: Sequence[str]) -> list[_Attitude]:
    """Rows of STK: seconds from the scenario's epoch and a quaternion. InputError: attitudes of another kind."""
    order, rows, kind = None, [], "none"
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        keyword = words[0].lower()
        if keyword.startswith("attitudetime"):
            order, kind = _STK_FORMATS.get(keyword), words[0]
        elif keyword == "end":
            break
        elif order is not None:
            found = _numbers(path, number, words, 5)
            rows.append(_Attitude(number, (found[0], *(found[place] for place in order))))
    if order is None:
        raise InputError(
            f"{path_text(path)}: its attitudes are {value_text(kind)}; export them as AttitudeTimeQuaternions"
        )
    return rows


def _ccsds_rows(path: Path, lines: Sequence[str]) -> list[_Attitude]:
    """Rows of CCSDS: a date and a quaternion, with its frames and order in the lines above. InputError: another kind."""
    stated: dict[str, str] = {}
    rows: list[_Attitude] = []
    is_data = False
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if matched := _KEY.fullmatch(line):
            stated[matched[1].upper()] = matched[2].upper()
        elif words[:1] in (["DATA_START"], ["ATT_START"]):
            is_data = True
        elif words[:1] in (["DATA_STOP"], ["ATT_STOP"]):
            is_data = False
        elif is_data and words and words[0] != "COMMENT":
            rows.append(_Attitude(number, _ccsds_row(path, number, words, stated)))
    return rows


def _xml_rows(path: Path) -> list[_Attitude]:
    """Attitudes of CCSDS in XML, the scalar last in each. InputError: no AEM, or another kind of attitude."""
    root = read_xml(path)
    if root.tag not in ("aem", "ndm"):
        raise InputError(f"{path_text(path)}: its XML is of {value_text(root.tag)}; give that of an AEM")
    rows: list[_Attitude] = []
    for segment in root.iter("segment"):
        stated = {
            each.tag: (each.text or "").strip().upper() for each in segment.iter() if each.tag.isupper()
        }
        stated["QUATERNION_TYPE"] = "LAST"
        states = [each for state in segment.iter("attitudeState") for each in state]
        for number, state in enumerate(states, start=len(rows) + 1):
            words = [state.findtext(f".//{name}") or "" for name in ("EPOCH", "Q1", "Q2", "Q3", "QC")]
            rows.append(_Attitude(number, _ccsds_row(path, number, list(map(str.strip, words)), stated)))
    return rows


def _ccsds_row(path: Path, line: int, words: Sequence[str], stated: dict[str, str]) -> tuple[float, ...]:
    kind = stated.get("ATTITUDE_TYPE", stated.get("ATT_TYPE", "none"))
    if not kind.startswith("QUATERNION"):
        raise InputError(
            f"{path_text(path)}: ATTITUDE_TYPE is {value_text(kind)}; export attitudes as QUATERNION"
        )
    time = _ccsds_time(words[0], stated)
    if time is None:
        raise InputError(
            f"{path_text(path)}: line {line}: {value_text(words[0])} is no date; correct the line"
        )
    q = _numbers(path, line, words[1:], 4)[:4]
    if stated.get("QUATERNION_TYPE", "LAST") == "FIRST":
        q = [*q[1:], q[0]]
    return (time, *(q if _is_to_body(path, stated) else [-q[0], -q[1], -q[2], q[3]]))


def _ccsds_time(word: str, stated: dict[str, str]) -> float | None:
    """Seconds of a date, or of the seconds from the epoch of an ACM; None of another word."""
    if (time := seconds_of_clock(word)) is not None or "EPOCH_TZERO" not in stated:
        return time
    try:
        return parse_number(word)
    except ValueError:
        return None


def _is_to_body(path: Path, stated: dict[str, str]) -> bool:
    """Whether the quaternion transforms to the body's frame. InputError: the frames do not show which is the body's."""
    frames = [stated.get("REF_FRAME_A", ""), stated.get("REF_FRAME_B", "")]
    if stated.get("ATTITUDE_DIR") == "B2A":
        frames.reverse()
    bodies = [_BODY.search(frame) is not None for frame in frames]
    if bodies.count(True) != 1:
        raise InputError(
            f"{path_text(path)}: which of the frames {value_text(frames[0])} and {value_text(frames[1])} is fixed in the body is "
            "not known; name it SC_BODY_1 in REF_FRAME_A or REF_FRAME_B"
        )
    return bodies[1]
