"""Headings of a motion table: which quantity, axis and unit a column has."""

import re
from dataclasses import dataclass
from typing import Final, Literal

Quantity = Literal["time", "rate", "acceleration", "position", "quaternion"]

TIME_UNITS: Final[dict[str, str]] = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("ms", "msec", "millis", "millisec", "milliseconds"), "ms"),
    **dict.fromkeys(("us", "usec", "µs", "μs", "micros", "microsec", "microseconds"), "us"),
    **dict.fromkeys(("ns", "nsec", "nanos", "nanosec", "nanoseconds"), "ns"),
}
"""Unit of time by its spelling."""
_RATE_UNITS = {
    **dict.fromkeys(("rad/s", "rads", "radps", "radpers", "rads-1", "1/s", "s-1"), "rad/s"),
    **dict.fromkeys(("mrad/s", "mradps", "mrads"), "mrad/s"),
    **dict.fromkeys(
        ("deg/s", "degs", "dps", "degps", "degrees/s", "degree/s", "°/s", "degpers", "degreespers"), "deg/s"
    ),
    **dict.fromkeys(("mdps", "mdeg/s"), "mdeg/s"),
    **dict.fromkeys(("rpm", "1/min"), "rpm"),
}
_ACCELERATION_UNITS = {
    **dict.fromkeys(("m/s2", "m/s^2", "m/s²", "m/s/s", "ms-2", "mps2", "ms2", "mss"), "m/s^2"),
    **dict.fromkeys(("g", "gs", "g0"), "g"),
    **dict.fromkeys(("mg",), "mg"),
}
_LENGTH_UNITS = {"m": "m", "mm": "mm", "cm": "cm"}

_BRACKETS = re.compile(r"\s*[(\[]\s*([^()\[\]]*?)\s*[)\]]\s*$")
_TIME_WORD = re.compile(
    r"(?:t|time|times|timestamp|stamp|elapsed|since|epoch|boot|unix|device|sensor|header|clock|reboot|motion|gyro|logging|"
    r"system|local|sample|monotonic|field)"
)
_INDEXED = re.compile(r"(.*?)[\[_.]?([012])\]?$")
_SI_RATE = r"wb?|om(?:ega)?|rates?|bodyrates?|ang(?:ular)?rates?|ang(?:ular)?vel(?:ocity)?"
_STEMS: Final[dict[Quantity, re.Pattern[str]]] = {
    "rate": re.compile(
        _SI_RATE
        + r"|avel|g|gyr|gyro(?:scope|meter)?|rotationrate|gyrorotation(?:rate)?|gyroadc|gyroscaled|gyrofilt(?:ered)?|calgyro"
    ),
    "acceleration": re.compile(
        r"a|acc|accel|acceleration|accelerometer(?:acceleration)?|linearacceleration|accsmooth|accadc|accscaled"
    ),
    "position": re.compile(r"p|pos|position|t|trans|translation|(?:pose){1,2}position|tag|origin"),
    "quaternion": re.compile(
        r"q|quat|quaternions?|orientation|attitude|rot|rotation|(?:pose){1,2}orientation"
    ),
}
_NUMBERED: Final[tuple[Quantity, ...]] = ("rate", "acceleration")
_PREFIX = re.compile(r"field|data|imu|sensor|msg|motion|value|mpu|icm|bno|lsm|bmi|device|phone|body")
"""Word before a quantity that says whose it is."""
_NOT_MOTION = re.compile(r"std|cov|bias|raw|uncal|magn|setpoint|desired|temp|sum|abs|norm")
"""Beginning of a word of columns that are no measured component."""

FOREIGN: Final = "foreign"
"""Axis of a column whose unit alone tells that it is a time: phones write it in any language."""


@dataclass(frozen=True)
class Heading:
    """Quantity, axis and unit of a column.

    Attributes
    ----------
    quantity: of motion.   axis: "x", "y", "z" or "w"; empty of time.
    unit: canonical spelling, empty where none is stated, behind a question mark where it is unknown.
    is_si: whether its name, without a unit, is that of a quantity in SI by convention.
    """

    quantity: Quantity
    axis: str = ""
    unit: str = ""
    is_si: bool = False


def heading_of(text: str, bare: Quantity | None = None) -> Heading | None:
    """Parsed heading of a column; None of a column that tells no motion.

    Parameters
    ----------
    bare: quantity of columns that are called x, y and z and no more, as the name of their file tells.
    """
    name, unit = _parts(text)
    words, unit = _words(name), _spelled(unit)
    if "linear_acceleration" not in name and "".join(words).startswith("linearacc"):
        return None  # phones call so what is left without gravity; ROS spells the accelerometer with an underscore
    if not words or any(_NOT_MOTION.match(word) for word in words):
        return None
    clock = _time(words, unit)
    while len(words) > 1 and _PREFIX.fullmatch(words[0]):
        words = words[1:]
    return clock or _component(words, unit, bare)


def _parts(text: str) -> tuple[str, str]:
    """Name and bracketed unit in lower case; an index stays with the name."""
    plain = text.strip().strip('"').strip()
    found = _BRACKETS.search(plain)
    if found is None or found[1] in ("0", "1", "2", "txt", "float", "int"):
        return plain if found is None or found[1].isdigit() else plain[: found.start()], ""
    return plain[: found.start()], "".join(found[1].lower().split())


def _spelled(unit: str) -> str:
    """A unit with its second as s and its multiplication left out."""
    return (
        re.sub(r"sec(?:ond)?s?(?![a-z])", "s", unit).replace("·", "").replace("*", "")
        if unit not in TIME_UNITS
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
    if unit in TIME_UNITS and not all(_TIME_WORD.fullmatch(word) for word in words):
        return Heading("time", FOREIGN, TIME_UNITS[unit])
    if not all(_TIME_WORD.fullmatch(word) for word in others) or len(spelled) > 1:
        return None
    if unit and unit not in TIME_UNITS:
        return None
    return Heading("time", "", TIME_UNITS[unit] if unit else next(iter(spelled), ""))


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
    """Stem without blanks, axis letter and unit of a heading.

    Axis and unit are empty where there is none.
    """
    unit = ""
    for count in (2, 1):
        tail = _spelled("/".join(words[-count:]))
        if len(words) > count and tail in (*_RATE_UNITS, *_ACCELERATION_UNITS, *_LENGTH_UNITS):
            unit, words = tail, words[:-count]
            break
    joined = "".join(words)
    if len(words) > 1 and len(words[-1]) == 1 and words[-1] in "xyzw":
        return "".join(words[:-1]), words[-1], unit
    if joined and joined[-1] in "xyzw" and _is_stem(joined[:-1]):
        return joined[:-1], joined[-1], unit
    if joined and joined[0] in "xyz" and _is_stem(joined[1:]):
        return joined[1:], joined[0], unit
    indexed = _INDEXED.fullmatch(joined)
    # of a quaternion an index does not tell which is the scalar
    if indexed and any(_STEMS[numbered].fullmatch(indexed[1]) for numbered in _NUMBERED):
        return indexed[1], "xyz"[int(indexed[2])], unit
    return "", "", unit


def _is_stem(text: str) -> bool:
    """Whether a text is a known stem, or none."""
    return not text or any(stems.fullmatch(text) for stems in _STEMS.values())
