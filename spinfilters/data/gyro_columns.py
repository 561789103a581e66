"""Gyro tables with a header of their own: which column is the time and which are the three rates."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.data.gyro_files import GYRO_COLUMNS, read_gyro_csv, refuse_degrees
from spinfilters.data.input_file import path_text, value_text
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.data.number_range import RATE
from spinfilters.data.table_files import Table, read_csv, read_header
from spinfilters.data.time_stamps import require_times
from spinfilters.errors import InputError

FASTEST: Final[float] = 75.0
"""Largest |rate| that gyros of phones and inertial units measure, about 4000 deg/s, as rad/s."""
LARGEST_ROTATION: Final[float] = np.pi
"""Between samples in the median, rad: a gyro that is sampled more slowly tells no motion."""

_HEADING = re.compile(r"\s*([^()\[\]]*?)\s*(?:[(\[]\s*([^()\[\]]*?)\s*[)\]])?\s*")
_TIME = re.compile(r"(?:t|time|timestamp|elapsed|s|sec|seconds)+")
_TIME_UNITS = ("s", "sec", "seconds")
_RATE = re.compile(
    r"(w|omega|g|gyr|gyro|gyroscope|rate|bodyrate|angularrate|angularvelocity|rotationrate)?([xyz])"
)
_RATE_UNIT = re.compile(r"[\s_]*(rad[\s_]*/?[\s_]*s(?:ec)?|radps)$", re.IGNORECASE)


@dataclass(frozen=True)
class GyroColumns:
    """Indices of time and of the rates about x, y, z, and whether the header states their units."""

    time: int
    rates: tuple[int, int, int]
    states_time_unit: bool
    states_rate_unit: bool


def read_gyro_table(path: Path) -> MeasurementStream:
    """Gyro stream of a table with time in s and body rates in rad/s, whatever their columns are called and what else it holds.

    Raises
    ------
    InputError: as `spinfilters.data.gyro_files.read_gyro_csv`; columns that cannot be told; where the header states no units,
        numbers that are hardly in s or rad/s.
    """
    names = read_header(path)
    if names == GYRO_COLUMNS:
        return read_gyro_csv(path)
    refuse_degrees(path, names)
    columns = gyro_columns(names)
    if columns is None:
        raise InputError(
            f"{path_text(path)}: line 1: the header is {value_text(', '.join(names))}; give one column of time in s and one "
            f"rate in rad/s about each axis, such as {','.join(GYRO_COLUMNS)}"
        )
    table = read_csv(path)
    chosen = [columns.time, *columns.rates]
    found = Table(path, tuple(names[k] for k in chosen), table.values[:, chosen], table.layout)
    require_times(found, repeats=False)
    found.require(slice(1, 4), RATE)
    _require_units(found, columns)
    return MeasurementStream("gyro", found.values[:, 0], found.values[:, 1:])


def gyro_columns(names: tuple[str, ...]) -> GyroColumns | None:
    """Columns of a header, None unless there is exactly one of time and of each axis."""
    times = [(k, unit) for k, name in enumerate(names) if (unit := _time_unit(name)) is not None]
    rates = [(k, *found) for k, name in enumerate(names) if (found := _rate(name)) is not None]
    by_axis = [[each for each in rates if each[1] == axis] for axis in "xyz"]
    if len(times) != 1 or any(len(each) != 1 for each in by_axis):
        return None
    (x,), (y,), (z,) = by_axis
    return GyroColumns(times[0][0], (x[0], y[0], z[0]), times[0][1], all(each[2] for each in (x, y, z)))


def _time_unit(heading: str) -> bool | None:
    """Whether the heading of a time states seconds; None of anything else, times in other units among it."""
    name, unit = _parts(heading)
    words = [word for word in re.split(r"[\s_.]+", name.lower()) if word]
    if (
        not words
        or not all(_TIME.fullmatch(word) for word in words)
        or unit.lower() not in ("", *_TIME_UNITS)
    ):
        return None
    return bool(unit) or any(word in _TIME_UNITS for word in words)


def _rate(heading: str) -> tuple[str, bool] | None:
    """Axis of the heading of a rate, and whether it states rad/s; None of anything else. A lone x needs the unit."""
    name, unit = _parts(heading)
    plain = _RATE_UNIT.sub("", name)
    stated = plain != name or bool(_RATE_UNIT.fullmatch(unit))
    found = _RATE.fullmatch(re.sub(r"[\s_.]+", "", plain.lower()))
    if not found or (unit and not stated) or not (found[1] or stated):
        return None
    return found[2], stated


def _parts(heading: str) -> tuple[str, str]:
    """Name and bracketed unit, empty without one."""
    found = _HEADING.fullmatch(heading)
    return ("", "") if found is None else (found[1], found[2] or "")


def _require_units(table: Table, columns: GyroColumns) -> None:
    """Refuse numbers that are hardly in s and rad/s where the header does not say that they are."""
    time, rates = table.values[:, 0], table.values[:, 1:]
    speed: Float[np.ndarray, " n"] = np.linalg.norm(rates, axis=1)
    if not columns.states_rate_unit and speed.max() > FASTEST:
        raise table.error(
            int(speed.argmax()),
            f"a rate of {speed.max():.4g} rad/s is more than a gyro measures; convert the rates to rad/s, and say so in the header "
            "('wx (rad/s)')",
        )
    rotation = float(np.median(speed[:-1] * np.diff(time)))
    if not columns.states_time_unit and rotation > LARGEST_ROTATION:
        raise InputError(
            f"{path_text(table.path)}: the body would turn by {rotation:.3g} rad between samples; convert the time to s, "
            "and say so in "
            "the header ('time (s)')"
        )
