"""Columns of motion tables by their names: quantity, axis and unit of each."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Final, Literal, NamedTuple

from spinfilters.core.errors import InputError
from spinfilters.io.input_file import path_text, value_text
from spinfilters.io.logger_names import understood_names
from spinfilters.io.stated_values import CLOCK_UNITS, LENGTH_UNITS, RATE_UNITS, ReadingOptions, to_state

Quantity = Literal["time", "rate", "acceleration", "position", "quaternion", "matrix", "mrp"]

TICKS: Final = "ticks"
"""Unit of the clock of Xsens: 100 us in its inertial units, 1 us in its Dots; see `spinfilters.io.motion_table`."""
TIME_UNITS: Final[dict[str, str]] = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("ms", "msec", "millis", "millisec", "milliseconds"), "ms"),
    **dict.fromkeys(("us", "usec", "µs", "μs", "micros", "microsec", "microseconds"), "us"),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanosec", "nanosecs", "nanoseconds"), "ns"),
    "days": "days",
    "minutes": "min",
    "hours": "h",
    "xsensticks": TICKS,
}
"""Unit of time by its spelling."""
_BRACKETED_TIME = {**TIME_UNITS, "d": "days", "day": "days", "min": "min", "h": "h", "hr": "h", "hrs": "h"}
"""Also those that say something else without brackets."""
SECONDS: Final[dict[str, float]] = {**CLOCK_UNITS, "min": 60.0, "h": 3600.0, "days": 86400.0}
"""Seconds in a unit of time, also in those that no user states."""
_RATE_UNITS = {
    **dict.fromkeys(
        (
            *("rad/s", "rads", "radps", "radpers", "rads-1", "rads^-1", "rads⁻¹", "1/s", "s-1", "s^-1"),
            *("radians/s", "radian/s", "radianspers", "radianperss", "radianpers"),
        ),
        "rad/s",
    ),
    **dict.fromkeys(("mrad/s", "mradps", "mrads"), "mrad/s"),
    **dict.fromkeys(
        (
            *("deg/s", "degs", "d/s", "dps", "degps", "degrees/s", "degree/s", "°/s", "º/s", "degpers"),
            *("degreespers", "degreepers", "°pers", "degs-1", "degs^-1", "°s-1", "°s^-1", "°s⁻¹", "grad/s"),
        ),
        "deg/s",
    ),
    **dict.fromkeys(("mdps", "mdeg/s"), "mdeg/s"),
    **dict.fromkeys(("rpm", "1/min"), "rpm"),
}
_ACCELERATION_UNITS = {
    **dict.fromkeys(("m/s2", "m/s^2", "m/s²", "m/s/s", "ms-2", "ms^-2", "mps2", "ms2", "mss"), "m/s^2"),
    **dict.fromkeys(("g", "gs", "g0"), "g"),
    **dict.fromkeys(("mg",), "mg"),
}
_LENGTH_UNITS = {"m": "m", "mm": "mm", "cm": "cm"}
_WORDED_UNITS = frozenset(unit for unit in (*_RATE_UNITS, *_ACCELERATION_UNITS) if len(unit) > 2) | {
    "mm",
    "cm",
}
"""Units that as a word between others say nothing else."""

_BRACKETS = re.compile(r"\s*[(\[{]\s*([^()\[\]{}]*?)\s*[)\]}]\s*$")
_TIME_WORD = re.compile(
    r"(?:t|ts|time|times|timestamp|stamp|elapsed|since|epoch|boot|unix|device|sensor|header|clock|reboot|motion|gyro|logging|"
    r"system|local|sample|monotonic|field|start|in|realtime|tout|"
    r"zeit|temps|tiempo|tempo)"
)
_OF_DATES = re.compile(
    r"utcg?|gmt|tai|local|iso ?8601|h{1,2}:m{1,2}:s{1,2}(?:[.,:][0-9sfx]+)?|(?:yyyy|dd|mm)[-/.].*"
)
"""Brackets behind a clock that say how its times are written, or in which zone."""
_WHOSE_CLOCK = re.compile(
    r"current|acquisition|rtc|simulation|sim|host|node|log|packet|capture|message|msg|receive|received|publish|published"
)
"""Words that say whose time it is, and alone are no clock."""
_LATE_WORD = re.compile(r"datetime|date|utc|gregorian|utime|unixtime|startup|offset|real|recording")
"""Words that say a time too, of columns that are a clock where no other is."""
_SOURCE = re.compile(r"^.*:(?=[^:]*[A-Za-z][^:]*$)")
"""What a column is of, in front of its name: IMU_ATTI(0):gyroX."""
_INDEXED = re.compile(r"(.*?)[\[_.]?([012])\]?$")
_SI_RATE = r"wb?|om(?:ega)?|rates?|bodyrates?|ang(?:ular)?rates?|ang(?:ular)?vel(?:ocity|ocities)?"
_STEMS: Final[dict[Quantity, re.Pattern[str]]] = {
    "rate": re.compile(
        _SI_RATE
        + r"|rot(?:ational)?vel(?:ocity)?|rot(?:ational)?rates?|imugyro|gyros|gyro(?:scope)?data"
        + r"|avel|g|gyr|gyro(?:scope|meter)?|rotationrate|gyrorotation(?:rate)?|gyroadc|gyroscaled|gyrofilt(?:ered)?|calgyro"
    ),
    "acceleration": re.compile(
        r"a|acc|accel|acceleration|accelerometer(?:acceleration)?|linearacceleration|accsmooth|accadc|accscaled"
    ),
    "position": re.compile(
        r"p|pos|position|t|trans|translation|(?:pose){1,2}position|tag|origin|loc|location"
    ),
    "quaternion": re.compile(
        r"q|quat|quaternions?|orientation|attitude|rot|rotation|(?:pose){1,2}orientation"
    ),
}
_NUMBERED: Final[tuple[Quantity, ...]] = ("rate", "acceleration")
_PREFIX = re.compile(r"field|data|imu|sensor|msg|motion|value|mpu|icm|bno|lsm|bmi|device|phone|body")
"""Word before a quantity that says whose it is."""
_OF_BODY = re.compile(r"b|bf|body|bodyframe|frd|flu")
_OF_BODY_AT_LENGTH = re.compile(r"body|bodyframe|frd|flu")
"""Word behind a quantity that says in whose axes it is: omega_b_x; of others, such as omega_i_x, it is no body rate."""
_NOT_MOTION = re.compile(r"std|cov|bias|raw|uncal|magn|setpoint|desired|temp|sum|abs|norm")
"""Beginning of a word of columns that are no measured component."""

FOREIGN: Final = "foreign"
"""Axis of a column whose unit alone shows that it is a time: phones write it in any language."""


@dataclass(frozen=True)
class Heading:
    """Quantity, axis and unit of a column.

    Attributes
    ----------
    quantity : Quantity
        Of motion.
    axis : str
        "x", "y", "z" or "w"; of a rotation matrix, row and column; empty of time.
    unit : str
        Canonical spelling, empty where none is stated, after a question mark where it is unknown.
    is_si : bool
        Whether its name, without a unit, is that of a quantity in SI by convention.
    """

    quantity: Quantity
    axis: str = ""
    unit: str = ""
    is_si: bool = False


@lru_cache(maxsize=4096)
def heading_of(text: str, bare: Quantity | None = None) -> Heading | None:
    """Parsed heading of a column; None of a column that describes no motion.

    Parameters
    ----------
    bare : Quantity | None
        Quantity of columns that are called x, y and z and no more, as the name of their file says.
    """
    name, unit = _parts(text)
    words, unit = _words(name), _spell_unit(unit)
    if "linear_acceleration" not in name and "".join(words).startswith("linearacc"):
        return None  # phones call so what is left without gravity; ROS spells the accelerometer with an underscore
    if not words or any(_NOT_MOTION.match(word) for word in (*words, *_words(text))):
        return None
    if len(words) == 2 and words[0] in ("matrix", "mrp") and words[1] in AXES[words[0]]:
        return Heading(words[0], words[1])
    clock = _time(words, unit)
    while len(words) > 1 and _PREFIX.fullmatch(words[0]):
        words = words[1:]
    behind = (
        _OF_BODY if words[0].startswith(("w", "om", "ang")) else _OF_BODY_AT_LENGTH
    )  # gyro_b may be a bias
    words = [word for k, word in enumerate(words) if not k or not behind.fullmatch(word)]
    return clock or _component(words, unit, bare)


def _parts(text: str) -> tuple[str, str]:
    """Name and bracketed unit in lower case; an index stays with the name."""
    plain = text.strip().strip('"').strip()
    if _SOURCE.match(plain):
        plain = re.sub(r"\s\d+(?=$|\s*[(\[])", "", _SOURCE.sub("", plain))
    found = _BRACKETS.search(plain)
    if found is None or found[1] in ("0", "1", "2", "txt", "float", "int"):
        return plain if found is None or found[1].isdigit() else plain[: found.start()], ""
    return plain[: found.start()], "".join(found[1].lower().split())


def _spell_unit(unit: str) -> str:
    """A unit with its second as s and its multiplication left out."""
    return (
        re.sub(r"sec(?:ond)?s?(?![a-z])", "s", unit).replace("·", "").replace("*", "")
        if unit not in _BRACKETED_TIME
        else unit
    )


def _words(name: str) -> list[str]:
    """Words of a name; a capital begins one: gyroX, wx_rad_s, angular_velocity.x, GyroADC[0]."""
    parted = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name)
    return [word for word in re.split(r"[^a-z0-9/^²°µμ]+", parted.lower()) if word]


def _time(words: list[str], unit: str) -> Heading | None:
    """A clock: words for time only, and perhaps a unit."""
    spelled = [TIME_UNITS[word] for word in words if word in TIME_UNITS]
    others = [word for word in words if word not in TIME_UNITS]
    if unit in _BRACKETED_TIME and not all(
        _TIME_WORD.fullmatch(word) or _WHOSE_CLOCK.fullmatch(word) for word in words
    ):
        return Heading("time", FOREIGN, _BRACKETED_TIME[unit])
    is_late = any(_LATE_WORD.fullmatch(word) for word in others)
    others = [word for word in others if not _LATE_WORD.fullmatch(word)]
    named = [word for word in others if not _WHOSE_CLOCK.fullmatch(word)]
    others = named if named or is_late or unit or spelled else others
    if not all(_TIME_WORD.fullmatch(word) for word in others) or len(spelled) > 1:
        return None
    if unit and unit not in _BRACKETED_TIME and not _OF_DATES.fullmatch(unit):
        return None
    unit = unit if unit in _BRACKETED_TIME else ""
    return Heading(
        "time", FOREIGN if is_late else "", _BRACKETED_TIME[unit] if unit else next(iter(spelled), "")
    )


def _component(words: list[str], unit: str, bare: Quantity | None) -> Heading | None:
    """A component of a vector or quaternion: the stem, the axis, the unit, in this order."""
    stem, axis, spelled = _stem_and_axis(words)
    if not axis:
        return None
    unit = unit or spelled
    units: tuple[tuple[Quantity, dict[str, str]], ...] = (
        ("rate", _RATE_UNITS),
        ("acceleration", _ACCELERATION_UNITS),
        ("position", _LENGTH_UNITS),
    )
    if _STEMS["quaternion"].fullmatch(stem) and not unit and not (axis != "w" and stem == "rot"):
        return Heading("quaternion", axis)
    if axis == "w":
        return None
    for quantity, spellings in units:
        named = bool(_STEMS[quantity].fullmatch(stem)) or (not stem and bare == quantity)
        if unit and unit in spellings and (named or (quantity == "rate" and _tells_rate(stem, unit))):
            return Heading(quantity, axis, spellings[unit])
        if named:
            return Heading(quantity, axis, f"? {unit}" if unit else "", bool(re.fullmatch(_SI_RATE, stem)))
    return None


def _tells_rate(stem: str, unit: str) -> bool:
    """Whether a unit is one of rates only."""
    return unit != "1/s" and not stem.startswith(("acc", "mag", "euler", "roll"))


def _stem_and_axis(words: list[str]) -> tuple[str, str, str]:
    """Stem without blanks, axis letter and unit of a heading; axis and unit are empty where it has none."""
    unit = ""
    for count in (2, 1):
        tail = _spell_unit("/".join(words[-count:]))
        if len(words) > count and tail in (*_RATE_UNITS, *_ACCELERATION_UNITS, *_LENGTH_UNITS):
            unit, words = tail, words[:-count]
            break
    for count in (2, 1):  # a unit in front of the axis: omega_radps_x
        behind = _spell_unit("/".join(words[-1 - count : -1]))
        if not unit and len(words) > count + 1 and words[-1] in tuple("xyz") and behind in _WORDED_UNITS:
            unit, words = behind, [*words[: -1 - count], words[-1]]
            break
    joined = "".join(words)
    if len(words) > 1 and len(words[-1]) == 1 and words[-1] in "xyzw":
        return "".join(words[:-1]), words[-1], unit
    if joined and joined[-1] in "xyzw" and _is_stem(joined[:-1]):
        return joined[:-1], joined[-1], unit
    if joined and joined[0] in "xyz" and _is_stem(joined[1:]):
        return joined[1:], joined[0], unit
    indexed = _INDEXED.fullmatch(joined)
    # of a quaternion an index does not show which is the scalar
    if indexed and any(_STEMS[numbered].fullmatch(indexed[1]) for numbered in _NUMBERED):
        return indexed[1], "xyz"[int(indexed[2])], unit
    return "", "", unit


def _is_stem(text: str) -> bool:
    """Whether a text is a known stem, or none."""
    return not text or any(stems.fullmatch(text) for stems in _STEMS.values())


EXAMPLE: Final = "time_s,wx,wy,wz"
AXES: Final[dict[Quantity, Sequence[str]]] = {
    "rate": "xyz",
    "acceleration": "xyz",
    "position": "xyz",
    "quaternion": "xyzw",
    "mrp": "xyz",
    "matrix": tuple(row + column for row in "xyz" for column in "xyz"),
}
KNOWN_UNITS: Final[dict[Quantity, dict[str, float]]] = {
    "rate": RATE_UNITS,
    "acceleration": {"m/s^2": 1.0, "g": 9.80665, "mg": 9.80665e-3},
    "position": LENGTH_UNITS,
    "quaternion": {},
    "matrix": {},
    "mrp": {},
}
"""SI units in the units of each quantity."""


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


def motion_columns(
    path: Path,
    names: Sequence[str],
    options: ReadingOptions,
    bare: Quantity | None = None,
    is_date: Callable[[int], bool] | None = None,
) -> MotionColumns:
    """Columns of a header.

    Parameters
    ----------
    is_date : Callable[[int], bool] | None
        Whether the stamps of a column are those of a date, which decides among clocks without a unit.
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
    if not {"quaternion", "matrix", "mrp"} & found.keys() and not is_gyro:
        try:
            own = _of_one_body(path, understood, options.topic)
        except InputError:
            if "rate" not in found:
                raise
            own = None
        if own is not None:
            understood, options = own, replace(options, topic=None)
            found, headings = _vectors(path, names, understood, bare)
    if not {"rate", "quaternion", "matrix", "mrp"} & found.keys():
        understood = [_of_source(name) for name in understood]
        found, headings = _vectors(path, names, understood, bare)
    if not {"rate", "quaternion", "matrix", "mrp"} & found.keys():
        understood = _with_quaternion(understood)
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
    clock = _clock(path, names, headings, found, is_date)
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
        heading = heading_of(name)
        is_clock = heading is not None and heading.quantity == "time"
        own = name.strip()[len(body) :] if name.strip().startswith(body) else ""
        found.append(quaternion.get(k) or own or (name if is_clock else ""))
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
    own = _words(names[clock])
    stem = own[:-1] if own and TIME_UNITS.get(own[-1]) == "s" else own
    for k, words in enumerate(map(_words, names)):
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
    is_date: Callable[[int], bool] | None,
) -> tuple[int, str] | None:
    """Index and unit of the clock among the columns.

    It is the only one, or the first that states its unit, with seconds preferred, and those with the first word of the rates or
    poses: where each sensor has a clock, theirs.
    """
    times = [(k, h) for k, h in enumerate(headings) if h is not None and h.quantity == "time"]
    parts = [k for k, h in times if h.unit in _FRACTIONS and "".join(_words(names[k])) in TIME_UNITS]
    if any(k not in parts and h.axis != FOREIGN and h.unit in ("", "s") for k, h in times):
        times = [
            (k, h) for k, h in times if k not in parts
        ]  # a unit alone, beside a clock, is the part of a second
    named = [(k, h) for k, h in times if h.axis != FOREIGN]
    clocks = [(k, h.unit) for k, h in named or times]
    stated = [clock for clock in clocks if clock[1] == "s"] or [clock for clock in clocks if clock[1]]
    if stated:
        vector = next((found[each] for each in _CLOCKED if each in found), None)
        own = _words(names[vector.indices[0]])[:1] if vector is not None else []
        return next((clock for clock in stated if own and _words(names[clock[0]])[:1] == own), stated[0])
    if len(clocks) > 1 and is_date is not None:
        clocks = [clock for clock in clocks if is_date(clock[0])] or clocks
    if len(clocks) > 1:
        listed = " and ".join(value_text(names[k]) for k, _ in clocks[:2])
        raise InputError(
            f"{path_text(path)}: header: {listed} may both be the clock; name one of them with its unit, such as time_s"
        )
    return clocks[0] if clocks else None
