"""Motion that another instrument recorded: poses or rates on its own clock, in its own axes, with gaps.

A reference is no truth and no measurement of a data set. It is read leniently: rows that are not finite, that repeat a time or hold
no unit quaternion are left out and counted, as a motion capture leaves gaps where it lost its markers.
"""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import continuous_quaternions, inverse, multiply, rotate
from spinfilters.core.camera_trajectory import CameraTrajectory
from spinfilters.core.errors import InputError
from spinfilters.core.linear_algebra import at_times
from spinfilters.io.calendar_clock import seconds_of_clock
from spinfilters.io.headings import SECONDS
from spinfilters.io.input_file import path_text, read_bytes, reason, value_text
from spinfilters.io.measurement_log import MeasurementLog, freeze_arrays
from spinfilters.io.motion_columns import KNOWN_UNITS, motion_columns
from spinfilters.io.sensor_format import sensor_format
from spinfilters.io.stated_values import ReadingOptions
from spinfilters.io.truth import TRUTH_COLUMNS, Truth

LARGEST_FILE: Final = 1 << 28
"""Bytes."""
FEWEST_ROWS: Final = 4
UNIT: Final = 0.02
"""Largest departure of a quaternion's norm from one; what rounding to two digits leaves."""

_Columns = dict[str, Float[np.ndarray, "n k"]]
_MEASURED: Final = {
    "position": ("tx", "ty", "tz"),
    "q_lm": ("qx", "qy", "qz", "qw"),
    "rate": ("wx", "wy", "wz"),
}
"""Columns of a sensor that measures them."""
_MOTIVE_UNITS: Final[Mapping[str, float]] = {"meters": 1.0, "millimeters": 1e-3, "centimeters": 1e-2}


@dataclass(frozen=True, eq=False)
class ReferenceMotion:
    """Poses of axes m, fixed to the body, in a frame l of the instrument, or rates about m; arrays are read-only.

    Parameters
    ----------
    name : str
        Of the file, or of what it was made of.
    time : Float[np.ndarray, ' n']
        s on the instrument's own clock, strictly increasing.
    attitude : Float[np.ndarray, 'n 4'] | None
        q_lm, scalar last, unit, continuous.
    position : Float[np.ndarray, 'n 3'] | None
        Origin of m in l, m.
    rate : Float[np.ndarray, 'n 3'] | None
        Body rate about m, rad/s.
    velocity : Float[np.ndarray, 'n 3'] | None
        Of the origin of m in l, m/s.
    shares_frame : bool
        Whether l is the inertial frame i of the data set, so that nothing of it is fitted.
    shares_origin : bool
        Whether the origin of m is the centre of mass.
    left_out : tuple of str
        A sentence on each kind of row that was not used.

    Raises
    ------
    InputError
        Neither attitudes nor rates, or fewer than `FEWEST_ROWS` rows.
    """

    name: str
    time: Float[np.ndarray, " n"]
    attitude: Float[np.ndarray, "n 4"] | None = None
    position: Float[np.ndarray, "n 3"] | None = None
    rate: Float[np.ndarray, "n 3"] | None = None
    velocity: Float[np.ndarray, "n 3"] | None = None
    shares_frame: bool = False
    shares_origin: bool = False
    left_out: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.attitude is None and self.rate is None:
            raise InputError(
                f"{self.name}: has neither attitudes nor rates; give columns qx,qy,qz,qw or wx,wy,wz with the time"
            )
        if len(self.time) < FEWEST_ROWS:
            lost = f" ({', '.join(self.left_out)})" if self.left_out else ""
            cure = "correct them" if self.left_out else "record more"
            raise InputError(
                f"{self.name}: {len(self.time)} rows can be used{lost}, a reference needs {FEWEST_ROWS}; {cure}"
            )
        freeze_arrays(self, ("time", "attitude", "position", "rate", "velocity"))

    @property
    def step(self) -> float:
        """Median interval between rows, s."""
        return float(np.median(np.diff(self.time)))

    @property
    def gaps(self) -> list[tuple[float, float]]:
        """Begin and end of every gap, s: intervals above two and a half of the usual one."""
        wide = np.flatnonzero(np.diff(self.time) > 2.5 * self.step)
        return [(float(self.time[k]), float(self.time[k + 1])) for k in wide]


def reference_of_truth(truth: Truth, name: str = "the truth") -> ReferenceMotion:
    """A truth whose stamps are not those of the measurements, as a reference: only its clock and the axes g are open."""
    return ReferenceMotion(
        name,
        truth.time,
        continuous_quaternions(truth.q_ig),
        truth.center_of_mass,
        rotate(inverse(truth.q_ig), truth.rate_i),
        truth.velocity,
        shares_frame=True,
        shares_origin=True,
    )


def reference_of_log(log: MeasurementLog, name: str) -> ReferenceMotion:
    """Poses, attitudes or rates of a recording as a reference, of the first stream whose columns are any of these.

    Raises
    ------
    InputError
        None of them, or too few rows.
    """
    for stream in log.streams:
        columns = sensor_format(stream.sensor).columns
        found = {key: _named(stream.values, columns, names) for key, names in _MEASURED.items()}
        known = {key: values for key, values in found.items() if values is not None}
        if "q_lm" in known or "rate" in known:
            return _reference(name, {"time": stream.time[:, np.newaxis], **known})
    sensors = ", ".join(stream.sensor for stream in log.streams)
    raise InputError(f"{name}: has measurements of {sensors}; a reference has poses, attitudes or rates")


def _named(values: np.ndarray, columns: Sequence[str], names: Sequence[str]) -> np.ndarray | None:
    """Columns of a stream by their names; None where it does not have them all."""
    return values[:, [columns.index(each) for each in names]] if set(names) <= set(columns) else None


def relative_reference(target: ReferenceMotion, inspector: ReferenceMotion) -> ReferenceMotion:
    """Motion of a target as the body axes of an inspector see it (Tweddle 2013, Eqs 6.10 and 6.11).

    r_T/C = R_C/I (r_T/I - r_C/I),   v_T/C = R_C/I (v_T/I - v_C/I) - w_C x r_T/C,   q_T/C = q_I/C^-1 (x) q_T/I.

    Rows of the target outside the inspector's recording are left out. The rate stays that of the target about its own axes, in
    inertial space; it is the one that gyros measure.

    Raises
    ------
    InputError
        One of both has no poses, or they have no time in common.
    """
    if (
        target.attitude is None
        or target.position is None
        or inspector.attitude is None
        or inspector.position is None
    ):
        raise InputError(
            f"{target.name} as seen from {inspector.name}: both need positions and attitudes; give poses of both"
        )
    inside = (target.time >= inspector.time[0]) & (target.time <= inspector.time[-1])
    if np.count_nonzero(inside) < FEWEST_ROWS:
        raise InputError(
            f"{target.name} and {inspector.name} have no stretch of time in common; give both on one clock"
        )
    time = target.time[inside]
    poses = CameraTrajectory(inspector.time, np.hstack([inspector.position, inspector.attitude])).at(time)
    back = inverse(poses[:, 3:])
    position = rotate(back, target.position[inside] - poses[:, :3])
    velocity = None
    if target.velocity is not None and inspector.velocity is not None and inspector.rate is not None:
        own, turning = (at_times(time, inspector.time, each) for each in (inspector.velocity, inspector.rate))
        velocity = rotate(back, target.velocity[inside] - own) - np.cross(turning, position)
    return replace(
        target,
        time=time,
        position=position,
        velocity=velocity,
        attitude=continuous_quaternions(multiply(back, target.attitude[inside])),
        rate=None if target.rate is None else target.rate[inside],
    )


def read_reference(path: Path, shares: Sequence[str] = ()) -> ReferenceMotion:
    """Reference of a file: TUM, a table of poses or rates with a header, or an OptiTrack export.

    Parameters
    ----------
    path : Path
        ``.tum`` or ``.txt`` without a header is TUM. A table has a column of the time and columns rx,ry,rz (or x,y,z; tx,ty,tz),
        qx,qy,qz,qw, wx,wy,wz or vx,vy,vz, or others by which recordings of motion name them, with their units in the header
        unless SI; rates are about body axes, except those of a truth.csv, which are about axes i.
    shares : sequence of str
        ``frame`` where its inertial frame is that of the data set, ``origin`` where its origin is the centre of mass.

    Raises
    ------
    InputError
        No such file, no columns that are known, too few rows.
    """
    text = read_bytes(path, LARGEST_FILE).decode("utf-8-sig", errors="replace")
    lines = [line for line in text.splitlines() if line.strip()]
    try:
        if lines and lines[0].lower().startswith("format version"):
            columns = _motive_columns(path, lines)
        elif path.suffix.lower() == ".tum" or not any(letter.isalpha() for letter in _first_row(lines)):
            columns = _tum_columns(path, lines)
        else:
            columns = _table_columns(path, lines)
    except csv.Error as error:
        raise InputError(f"{path_text(path)}: is no table ({reason(error)}); export it again") from None
    return replace(
        _reference(path_text(path), columns), shares_frame="frame" in shares, shares_origin="origin" in shares
    )


def _reference(name: str, columns: _Columns) -> ReferenceMotion:
    """Rows that can be used."""
    time = columns.pop("time")[:, 0]
    held = np.isfinite(time)
    said = []
    for values in columns.values():
        held &= np.isfinite(values).all(axis=1)
    if not held.all():
        said.append(f"{np.count_nonzero(~held)} rows without numbers")
    if "q_lm" in columns:
        norm = np.linalg.norm(columns["q_lm"], axis=1)
        unit = ~held | (np.abs(norm - 1.0) <= UNIT)
        if not unit.all():
            said.append(f"{np.count_nonzero(~unit)} rows whose quaternion is not of norm one")
        held &= unit
    rows = np.flatnonzero(held)
    rows = rows[np.argsort(time[rows], kind="stable")]
    fresh = np.append(True, np.diff(time[rows]) > 0) if rows.size else np.zeros(0, dtype=bool)
    if not fresh.all():
        said.append(f"{np.count_nonzero(~fresh)} rows that repeat a time")
    rows = rows[fresh]
    chosen = {name: values[rows] for name, values in columns.items()}
    if "q_lm" in chosen and len(rows):
        q = chosen["q_lm"] / np.linalg.norm(chosen["q_lm"], axis=1, keepdims=True)
        chosen["q_lm"] = continuous_quaternions(q)
    if "rate_i" in chosen:
        chosen["rate"] = rotate(inverse(chosen["q_lm"]), chosen.pop("rate_i"))
    return ReferenceMotion(
        name,
        time[rows],
        chosen.get("q_lm"),
        chosen.get("position"),
        chosen.get("rate"),
        chosen.get("velocity"),
        left_out=tuple(said),
    )


def _first_row(lines: Sequence[str]) -> str:
    """The first line that is no comment, without exponents; EuRoC's header begins as a comment does, and has commas."""
    if lines and lines[0].startswith("#") and "," in lines[0]:
        return lines[0]
    rows = (line for line in lines if not line.lstrip().startswith("#"))
    return next(rows, "#").lower().replace("nan", "").replace("inf", "").replace("e", "")


def _tum_columns(path: Path, lines: Sequence[str]) -> _Columns:
    rows = [line.replace(",", " ").split() for line in lines if not line.lstrip().startswith("#")]
    values = _numbers(path, rows, 8)
    return {"time": values[:, :1], "position": values[:, 1:4], "q_lm": values[:, 4:]}


def _table_columns(path: Path, lines: Sequence[str]) -> _Columns:
    delimiter = max(",;\t", key=lines[0].count)
    names = [cell.strip() for cell in lines[0].split(delimiter)]
    known = motion_columns(path, names, ReadingOptions(), bare="position")
    if known.time is None:
        raise InputError(
            f"{path_text(path)}: has no column of the time; name one time_s, time or t, in seconds"
        )
    clock, unit = known.time
    rows = list(csv.reader(lines[1:], delimiter=delimiter))
    values = _numbers(path, rows, len(names))
    if rows and clock < len(rows[0]) and seconds_of_clock(rows[0][clock]) is not None:
        told = (seconds_of_clock(row[clock]) if clock < len(row) else None for row in rows)
        values[:, clock] = [np.nan if seconds is None else seconds for seconds in told]
        unit = "s"
    unit = unit or ("ns" if names[clock].lower() == "#timestamp" else "s")  # EuRoC's ground truth states none
    chosen = {"time": values[:, [clock]] * SECONDS[unit]}
    rate = "rate_i" if set(TRUTH_COLUMNS) <= {name.lower() for name in names} else "rate"
    for quantity, key in (("position", "position"), ("quaternion", "q_lm"), ("rate", rate)):
        if quantity in known.vectors:
            vector = known.vectors[quantity]
            chosen[key] = values[:, vector.indices] * KNOWN_UNITS[quantity].get(vector.unit, 1.0)
    for key, letter in (("position", "r"), ("velocity", "v")):  # as a truth.csv names them
        places = [k for axis in "xyz" for k, name in enumerate(names) if name.lower() == letter + axis]
        if len(places) == 3:
            chosen[key] = values[:, places]
    return chosen


def _motive_columns(path: Path, lines: Sequence[str]) -> _Columns:
    """Poses of the first rigid body of an export of OptiTrack's Motive."""
    rows = list(csv.reader(lines))
    head = next((k for k, row in enumerate(rows) if row[:1] == ["Frame"]), None)
    if head is None or head < 2:
        raise InputError(f"{path_text(path)}: has no line Frame,Time above its numbers; export it again")
    settings = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    if settings.get("Rotation Type", "Quaternion").lower() != "quaternion":
        raise InputError(
            f"{path_text(path)}: rotations are {value_text(settings['Rotation Type'])}; export quaternions"
        )
    scale = _MOTIVE_UNITS.get(settings.get("Length Units", "Meters").lower(), 1.0)
    types = next((row for row in rows[:head] if "Rigid Body" in row), rows[head - 1])
    what, axes = rows[head - 1], rows[head]

    def columns_of(kind: str, letters: str) -> list[int]:
        """Columns of one quantity of the first rigid body."""
        its = [
            k for k in range(2, min(len(what), len(types))) if what[k] == kind and types[k] == "Rigid Body"
        ]
        named = {axes[k].upper(): k for k in reversed(its)}
        if not all(letter in named for letter in letters):
            raise InputError(
                f"{path_text(path)}: holds no {kind.lower()} of a rigid body; export rigid bodies"
            )
        return [named[letter] for letter in letters]

    attitude, position = columns_of("Rotation", "XYZW"), columns_of("Position", "XYZ")
    values = _numbers(path, rows[head + 1 :], len(axes))
    return {
        "time": values[:, 1:2],
        "position": scale * values[:, position],
        "q_lm": values[:, attitude],
    }


def _numbers(path: Path, rows: Sequence[Sequence[str]], columns: int) -> Float[np.ndarray, "n k"]:
    """Cells as numbers; not a number where a cell is empty, missing or a word."""
    if not rows:
        raise InputError(f"{path_text(path)}: has no rows; give a recording")
    values = np.full((len(rows), columns), np.nan)
    for k, row in enumerate(rows):
        for j, cell in enumerate(row[:columns]):
            try:
                values[k, j] = float(cell)
            except ValueError:
                continue
    return values
