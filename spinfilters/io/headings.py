"""Headings of the columns of motion tables: quantity, axis and unit of each."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, Literal

from spinfilters.io.stated_values import CLOCK_UNITS

Quantity = Literal["time", "rate", "acceleration", "position", "quaternion", "matrix", "mrp"]

AXES: Final[dict[Quantity, Sequence[str]]] = {
    "rate": "xyz",
    "acceleration": "xyz",
    "position": "xyz",
    "quaternion": "xyzw",
    "mrp": "xyz",
    "matrix": tuple(row + column for row in "xyz" for column in "xyz"),
}
"""Components of each quantity; of a rotation matrix, row and column."""
ROTATIONS: Final[frozenset[Quantity]] = frozenset({"quaternion", "matrix", "mrp"})
"""Quantities that are attitudes."""
TICKS: Final = "ticks"
"""Unit of the clock of Xsens: 100 us in its inertial units, 1 us in its Dots; see `spinfilters.io.motion_clock`."""
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
_WHAT_HAS_CLOCKS = frozenset(
    {"device", "sensor", "gyro", "motion", "logging", "system", "local", "field", "start", "in"}
)
"""Words among those for time that alone say none: a column called gyro may be a grade of its calibration."""
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
_NOT_MOTION = re.compile(r"std|cov|bias|raw|uncal|magn|setpoint|desired|temp(?!s$|o$)|sum|abs|norm")
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
    name, unit = parts_of(text)
    words, unit = words_of(name), _spell_unit(unit)
    if "linear_acceleration" not in name and "".join(words).startswith("linearacc"):
        return None  # phones call so what is left without gravity; ROS spells the accelerometer with an underscore
    if not words or any(_NOT_MOTION.match(word) for word in (*words, *words_of(text))):
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


def is_clock(text: str) -> bool:
    """Whether a column is called as a clock."""
    heading = heading_of(text)
    return heading is not None and heading.quantity == "time"


def is_of_motion(text: str) -> bool:
    """Whether a column is called as a component of a body rate or of a quaternion."""
    heading = heading_of(text)
    return heading is not None and heading.quantity in ("rate", "quaternion")


def parts_of(text: str) -> tuple[str, str]:
    """Name and bracketed unit in lower case; an index stays with the name."""
    plain = text.strip().strip('"').strip()
    if _SOURCE.match(plain):
        plain = re.sub(r"\s\d+(?=$|\s*[(\[])", "", _SOURCE.sub("", plain))
    found = _BRACKETS.search(plain)
    if found is None or found[1].isdigit() or found[1] in ("txt", "float", "int"):
        return plain if found is None or found[1].isdigit() else plain[: found.start()], ""
    return plain[: found.start()], "".join(found[1].lower().split())


def _spell_unit(unit: str) -> str:
    """A unit with its second as s and its multiplication left out."""
    return (
        re.sub(r"sec(?:ond)?s?(?![a-z])", "s", unit).replace("·", "").replace("*", "")
        if unit not in _BRACKETED_TIME
        else unit
    )


def words_of(name: str) -> list[str]:
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
    if others and not (spelled or unit or is_late) and _WHAT_HAS_CLOCKS.issuperset(others):
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


def is_unit_of_time(unit: str) -> bool:
    """Whether a unit in brackets is one of time, or says how times are written."""
    return unit in _BRACKETED_TIME or _OF_DATES.fullmatch(unit) is not None


def is_rate_unit(unit: str) -> bool:
    """Whether a unit is one of rates of rotation only."""
    return _spell_unit(unit) in _RATE_UNITS and unit not in ("1/s", "s-1", "s^-1")


def unit_within(words: Sequence[str]) -> tuple[list[str], str]:
    """Words without the first unit of a rate, an acceleration or a length that they spell, alone or as a fraction; and this."""
    for count in (2, 1):
        for place in range(len(words) - count + 1):
            unit = _spell_unit("/".join(words[place : place + count]))
            if unit in _WORDED_UNITS and unit != "1/s":
                return [*words[:place], *words[place + count :]], unit
    return list(words), ""


def _is_stem(text: str) -> bool:
    """Whether a text is a known stem, or none."""
    return not text or any(stems.fullmatch(text) for stems in _STEMS.values())
