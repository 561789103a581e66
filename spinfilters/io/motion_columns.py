"""Columns of motion tables: the clock, and the vectors that the headings make up."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, NamedTuple

from spinfilters.core.errors import InputError
from spinfilters.io.axis_groups import with_vectors
from spinfilters.io.headings import (
    AXES,
    FOREIGN,
    ROTATIONS,
    TIME_UNITS,
    Heading,
    Quantity,
    heading_of,
    is_clock,
    words_of,
)
from spinfilters.io.input_file import path_text, value_text
from spinfilters.io.logger_names import understood_names
from spinfilters.io.stated_values import CLOCK_UNITS, LENGTH_UNITS, RATE_UNITS, ReadingOptions, to_state

EXAMPLE: Final = "time_s,wx,wy,wz"
KNOWN_UNITS: Final[dict[Quantity, dict[str, float]]] = {
    "rate": RATE_UNITS,
    "acceleration": {"m/s^2": 1.0, "g": 9.80665, "mg": 9.80665e-3},
    "position": LENGTH_UNITS,
    "quaternion": {},
    "matrix": {},
    "mrp": {},
}
"""SI units in the units of each quantity."""


MOTIONS: Final = frozenset[Quantity](("rate", *ROTATIONS))
"""Quantities of which one describes a motion."""


@dataclass(frozen=True)
class VectorColumns:
    """Indices of a vector's components, its unit (empty if unstated), and whether its name implies SI by convention."""

    indices: tuple[int, ...]
    unit: str
    is_si: bool


@dataclass(frozen=True)
class MotionColumns:
    """Clock and vector columns found in a header.

    Attributes
    ----------
    time : tuple[int, str] | None
        Index and unit of the clock, None without one.
    vectors : dict[Quantity, VectorColumns]
        Of each quantity that has all its components, once.
    fraction : tuple[int, float] | None
        Index of a second column that may hold what the clock's whole seconds leave, as stamps of ROS do, and its unit in s.
    """

    time: tuple[int, str] | None
    vectors: dict[Quantity, VectorColumns]
    fraction: tuple[int, float] | None = None

    @property
    def describe_motion(self) -> bool:
        """Whether they hold rates or an attitude."""
        return bool(MOTIONS & self.vectors.keys())


def motion_columns(
    path: Path,
    names: Sequence[str],
    options: ReadingOptions,
    bare: Quantity | None = None,
    preferred: Callable[[Sequence[int]], Sequence[int]] | None = None,
) -> MotionColumns:
    """Columns of a header.

    Parameters
    ----------
    preferred : Callable[[Sequence[int]], Sequence[int]] | None
        Which of several clocks without a unit are to be taken, as their numbers show; None where these are not known.
    bare : Quantity | None
        See `heading_of`.

    Raises
    ------
    InputError
        A quantity that stands twice, or in two units or one that is unknown; clocks among which none can be
        chosen.
    """
    understood = understood_names(names)
    found, headings = _vectors(path, names, understood, bare)
    is_gyro = "rate" in found and not found["rate"].is_si
    if not ROTATIONS & found.keys() and not is_gyro:
        try:
            own = _of_one_body(path, understood, options.topic)
        except InputError:
            if "rate" not in found:
                raise
            own = None
        if own is not None:
            understood, options = own, replace(options, topic=None)
            found, headings = _vectors(path, names, understood, bare)
    if not MOTIONS & found.keys():
        understood = [_of_source(name) for name in understood]
        found, headings = _vectors(path, names, understood, bare)
    if not MOTIONS & found.keys():
        understood = _with_quaternion(understood)
        found, headings = _vectors(path, names, understood, bare)
    if not MOTIONS & found.keys():
        understood = with_vectors(path, understood)
        found, headings = _vectors(path, names, understood, bare)
    if options.topic is not None:
        raise InputError(
            f"{path_text(path)}: topic does not apply: no body {value_text(options.topic)} has a quaternion; leave it out"
        )
    if bare is None and "quaternion" in found and "position" not in found:
        found, headings = _vectors(
            path, names, understood, "position"
        )  # x, y, z beside a quaternion, as in the header of TUM
    if options.rate is not None:
        return MotionColumns(None, found)
    clock = _clock(path, names, headings, found, preferred)
    fraction = None if clock is None else _fraction(*clock, names) or _fraction(*clock, understood)
    return MotionColumns(clock, found, fraction)


_FOUR: Final = re.compile(r"(.*?)([wxyz])(\s*[(\[].*)?", re.IGNORECASE)
"""A name that ends with an axis."""


def _with_quaternion(names: Sequence[str]) -> list[str]:
    """Names of which the only four that differ in their last letter alone, w, x, y or z, are called a quaternion, as ox to ow."""
    groups: dict[str, dict[str, int]] = {}
    for k, name in enumerate(names):
        if matched := _FOUR.fullmatch(name.strip()):
            groups.setdefault(matched[1], {})[matched[2].lower()] = k
    whole = [own for stem, own in groups.items() if len(own) == 4 and not _NOT_MEASURED.search(stem)]
    axes = {k: axis for axis, k in whole[0].items()} if len(whole) == 1 else {}
    return [f"q{axes[k]}" if k in axes else name for k, name in enumerate(names)]


_RATE_END: Final = re.compile(
    r"(.+[^A-Za-z])((?:ang(?:ular)?_?(?:vel(?:ocity)?|rates?)|gyro(?:scope)?|body_?rates?|omega|rotation_?rate)\b.*|"
    r"(?:ang(?:ular)?_?(?:vel(?:ocity)?|rates?)|gyro(?:scope)?|body_?rates?|omega|rotation_?rate)_.*)",
    re.IGNORECASE,
)
"""A rate behind the name of what it is of."""
_NOT_OF_BODY: Final = re.compile(
    r"world|inertial|global|spatial|earth|root|eci|ned|enu|lvlh|orbit|rel|wheel|motor|rotor|joint|gimbal|rw|bias|std|cov|raw|uncal|temp|norm|setpoint|desired|cmd|command|goal|target|ref|err|noise",
    re.IGNORECASE,
)
"""Words before a rate that is in other axes, or that was not measured."""


def _of_source(name: str) -> str:
    """A name without that of its source in front of a rate; one that is in other axes, or a wish, as it is."""
    matched = _RATE_END.fullmatch(name.strip())
    return name if matched is None or _NOT_OF_BODY.search(matched[1]) else matched[2]


def _vectors(
    path: Path, names: Sequence[str], understood: Sequence[str], bare: Quantity | None
) -> tuple[dict[Quantity, VectorColumns], list[Heading | None]]:
    """Vectors of a header, and what each of its columns says."""
    headings = [heading_of(name, bare) for name in understood]
    found: dict[Quantity, VectorColumns] = {}
    for quantity, axes in AXES.items():
        vector = _vector(
            path, names, [_Headed(k, h) for k, h in enumerate(headings) if h and h.quantity == quantity], axes
        )
        if vector is not None:
            found[quantity] = vector
    return found, headings


_QUATERNION_END: Final = re.compile(
    r"(.*?)(?:(?<![A-Za-z])|(?<=[a-z])(?=[QOR]))(q|quat|quaternion|ori|orient|orientation|rot|rotation)[_. ]?([wxyz])",
    re.IGNORECASE,
)
"""A component of the quaternion of a body, whose name stands in front: box_qw, stateEstimate.qx, pose1.orientation.z, RotX."""
_NOT_MEASURED: Final = re.compile(r"setpoint|desired|cmd|command|goal|target|ref|cov|std", re.IGNORECASE)


def _of_one_body(path: Path, names: Sequence[str], topic: str | None) -> list[str] | None:
    """Names without that of a body in front of them, and no names of what is not of this body; None where none has a quaternion.

    InputError: several bodies, or others than the one that is asked for.
    """
    bodies: dict[str, dict[str, int]] = {}
    for k, name in enumerate(names):
        if matched := _QUATERNION_END.fullmatch(name.strip()):
            bodies.setdefault(matched[1], {})[matched[3].lower()] = k
    whole = [body for body, own in bodies.items() if len(own) == 4 and not _NOT_MEASURED.search(body)]
    whole = [body for body in whole if body.strip("_. ").lower() not in ("rot", "rotation", "orientation")]
    called = {body: body.strip("_. ") for body in whole}
    if topic is not None:
        whole = [body for body in whole if topic in (called[body], called[body].rpartition(".")[2])]
    if len(whole) != 1:
        if not called:
            return None
        listed = ", ".join(value_text(each) for each in called.values())
        raise InputError(
            f"{path_text(path)}: has quaternions of {listed}; give {to_state('topic', 'ONE OF THEM')}"
        )
    (body,) = whole
    quaternion = {k: f"q{axis}" for axis, k in bodies[body].items()}
    found = []
    for k, name in enumerate(names):
        own = name.strip()[len(body) :] if name.strip().startswith(body) else ""
        found.append(quaternion.get(k) or own or (name if is_clock(name) else ""))
    return found


class _Headed(NamedTuple):
    """A column and what its heading says."""

    column: int
    heading: Heading


def _vector(
    path: Path, names: Sequence[str], found: list[_Headed], axes: Sequence[str]
) -> VectorColumns | None:
    """The vector of a quantity, None where a component is missing."""
    by_axis = [[(k, heading) for k, heading in found if heading.axis == axis] for axis in axes]
    if sum(map(bool, by_axis)) < len(axes):
        return None
    if any(len(each) > 1 for each in by_axis):
        twice = next(each for each in by_axis if len(each) > 1)
        listed = " and ".join(value_text(names[k]) for k, _ in twice[:2])
        raise InputError(
            f"{path_text(path)}: header: {listed} may both be the {twice[0][1].quantity} about {twice[0][1].axis}; "
            "delete or rename one"
        )
    chosen = [each[0] for each in by_axis]
    units = {heading.unit for _, heading in chosen}
    if len(units) > 1 or any(unit.startswith("?") for unit in units):
        listed = ", ".join(names[k] for k, _ in chosen)
        raise InputError(
            f"{path_text(path)}: header: no unit known here is that of {value_text(listed)}; name all three in one of "
            f"{', '.join(KNOWN_UNITS[chosen[0][1].quantity])}"
        )
    return VectorColumns(tuple(k for k, _ in chosen), units.pop(), all(h.is_si for _, h in chosen))


def _fraction(clock: int, stated: str, names: Sequence[str]) -> tuple[int, float] | None:
    """Column of what whole seconds leave: named as the clock is, as stamp.sec and stamp.nanosec, or by its unit alone."""
    if stated not in ("s", ""):
        return None
    own = words_of(names[clock])
    stem = own[:-1] if own and TIME_UNITS.get(own[-1]) == "s" else own
    for k, words in enumerate(map(words_of, names)):
        unit = TIME_UNITS.get(words[-1], "") if words else ""
        if k != clock and unit in _FRACTIONS and words[:-1] in (stem, []):
            return k, CLOCK_UNITS[unit]
    return None


_FRACTIONS: Final = ("ms", "us", "ns")


_CLOCKED: Final[tuple[Quantity, ...]] = ("rate", "position", "quaternion", "acceleration")


def _clock(
    path: Path,
    names: Sequence[str],
    headings: Sequence[Heading | None],
    found: dict[Quantity, VectorColumns],
    preferred: Callable[[Sequence[int]], Sequence[int]] | None,
) -> tuple[int, str] | None:
    """Index and unit of the clock among the columns.

    It is the only one, or the first that states its unit, with seconds preferred, and those with the first word of the rates or
    poses: where each sensor has a clock, theirs.
    """
    times = [(k, h) for k, h in enumerate(headings) if h is not None and h.quantity == "time"]
    parts = [k for k, h in times if h.unit in _FRACTIONS and "".join(words_of(names[k])) in TIME_UNITS]
    if any(k not in parts and h.axis != FOREIGN and h.unit in ("", "s") for k, h in times):
        times = [
            (k, h) for k, h in times if k not in parts
        ]  # a unit alone, beside a clock, is the part of a second
    named = [(k, h) for k, h in times if h.axis != FOREIGN]
    clocks = [(k, h.unit) for k, h in named or times]
    stated = [clock for clock in clocks if clock[1] == "s"] or [clock for clock in clocks if clock[1]]
    if stated:
        vector = next((found[each] for each in _CLOCKED if each in found), None)
        own = words_of(names[vector.indices[0]])[:1] if vector is not None else []
        return next((clock for clock in stated if own and words_of(names[clock[0]])[:1] == own), stated[0])
    if len(clocks) > 1 and preferred is not None:
        kept = preferred([k for k, _ in clocks])
        clocks = [clock for clock in clocks if clock[0] in kept]
    if len(clocks) > 1:
        listed = " and ".join(value_text(names[k]) for k, _ in clocks[:2])
        raise InputError(
            f"{path_text(path)}: header: {listed} may both be the clock; name one of them with its unit, such as time_s"
        )
    return clocks[0] if clocks else None
