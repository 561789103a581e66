"""Vectors among columns whose names are of no known spelling: names that differ in the word for an axis alone.

``Sat1.BodyRates[0]``, ``angular_velocity_frd.forward_rad_s`` and ``/bus/imu/gyro/x_dps`` are written as no logger known here does.
Still, three of them that differ in an axis only are a vector, their other words say of what, and a unit among them what in.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from spinfilters.core.errors import InputError
from spinfilters.io.headings import is_rate_unit, parts_of, unit_within, words_of
from spinfilters.io.input_file import path_text, value_text

_THREE: Final = (
    ("x", "y", "z"),
    ("roll", "pitch", "yaw"),
    ("forward", "right", "down"),
    ("forward", "left", "up"),
    ("1", "2", "3"),
    ("0", "1", "2"),
    ("i", "j", "k"),
    ("p", "q", "r"),
)
"""Words for the axes x, y and z."""
_FOUR: Final = (
    ("x", "y", "z", "w"),
    ("x", "y", "z", "s"),
    ("i", "j", "k", "r"),
    ("i", "j", "k", "real"),
    ("i", "j", "k", "w"),
    ("x", "y", "z", "scalar"),
    ("vx", "vy", "vz", "s"),
)
"""Words for x, y, z and w; of numbers the order is in doubt."""
_JOINED: Final = re.compile(
    r"(?P<stem>gyro(?:scope)?|gyr|omega|w|q|quat|rot|rate|acc(?:el)?|p|pos|t)(?P<axis>[xyzw])"
)
"""A stem and its axis in one word: tx of tx_world_device."""
_SPIN: Final = re.compile(r"omega|ang(?:ular)?(?:vel|rate|speed)")
"""Words of rates that are in rad/s by convention."""
_RATE: Final = re.compile(
    rf"{_SPIN.pattern}|gyr|bodyrate|rot(?:ation(?:al)?)?(?:rate|vel)|turnrate|rateofturn"
)
_RATE_WORDS: Final = ("w", "wb", "avel")
_FLIGHT: Final = ("rate", "rates", "speed", "velocity")
"""Words that say a rate beside roll, pitch and yaw, or p, q and r."""
_ROTATION: Final = re.compile(r"q|quat(?:ernions?)?|qbody|attitude|orientation|rotation|rot|ori|qatt")
_POSITION: Final = re.compile(r"p|r|pos|position|t|trans|translation|location|loc|xyz")
_FORCE: Final = re.compile(r"acc(?:el(?:eration|erometer)?)?|specificforce")
_NOT_MEASURED: Final = (
    *(
        "bias",
        "std",
        "stddev",
        "cov",
        "var",
        "uncal",
        "temp",
        "norm",
        "setpoint",
        "sp",
        "desired",
        "des",
        "cmd",
    ),
    *(
        "command",
        "commanded",
        "goal",
        "target",
        "ref",
        "reference",
        "err",
        "error",
        "noise",
        "sigma",
        "delta",
        "offset",
    ),
    *("wheel", "motor", "rotor", "joint", "gimbal", "rw", "scale", "gain", "dot", "unfiltered", "max", "min"),
)
"""Words of what was not measured, or turns by itself."""
_REFERENCE: Final = (
    *(
        "world",
        "inertial",
        "global",
        "spatial",
        "earth",
        "map",
        "odom",
        "eci",
        "ecef",
        "ned",
        "enu",
        "lvlh",
        "orbit",
    ),
    *("j2000", "icrf", "eme2000", "i", "n", "rel", "relative"),
)
"""Words for axes that do not turn with the body."""
_BODY: Final = ("body", "device", "imu", "base", "link", "sensor", "vehicle", "b", "cam", "camera")
_OTHERS: Final = (
    "acc",
    "accel",
    "acceleration",
    "mag",
    "magnetometer",
    "magnetic",
    "euler",
    "linear",
    "lin",
    "user",
)
"""Words of other vectors, with which no rate is meant."""
_CONTROL: Final = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")
"""In what is no name: a terminal would obey it."""


@dataclass(frozen=True)
class _Group:
    """Columns by axis, the words that they share, and their unit, empty where none is known."""

    columns: dict[str, int]
    words: tuple[str, ...]
    unit: str
    axes: tuple[str, ...]

    @property
    def joined(self) -> str:
        return "".join(self.words)

    @property
    def is_measured(self) -> bool:
        """Whether no word says that a model, a controller or a calibration made it; raw counts have no unit."""
        return not any(word in _NOT_MEASURED or (word == "raw" and not self.unit) for word in self.words)


def with_vectors(path: Path, names: Sequence[str]) -> list[str]:
    """Names of columns, those of one body rate, quaternion and position of a body in plain words.

    Raises
    ------
    InputError
        Two vectors that may be the body rate.
    """
    groups = [group for group in _groups(names) if group.is_measured]
    found = list(names)
    rotations = [group for group in groups if len(group.axes) == 4 and _is_rotation(group)]
    if len(rotations) == 1:
        _rename(found, rotations[0], "q")
        positions = [g for g in groups if _is_position(g) and _context(g) == _context(rotations[0])]
        if len(positions) == 1:
            _rename(found, positions[0], "p")
    taken = {k for group in rotations for k in group.columns.values()}
    rates = [group for group in groups if _is_rate(group) and not taken & set(group.columns.values())]
    rates = [group for group in rates if group.unit] or rates
    if len(rates) > 1:
        listed = " and ".join(value_text(names[group.columns["x"]]) for group in rates[:2])
        raise InputError(
            f"{path_text(path)}: header: {listed} may both be the body rate about x; delete or rename one"
        )
    if rates:
        _rename(found, rates[0], "omega" if _is_spin(rates[0]) else "gyro")
    forces = [group for group in groups if len(group.axes) == 3 and any(map(_FORCE.fullmatch, group.words))]
    if len(forces) == 1 and not {"linear", "user", "lin"} & set(forces[0].words):
        _rename(found, forces[0], "acc")
    return found


def _rename(names: list[str], group: _Group, stem: str) -> None:
    for axis, k in group.columns.items():
        names[k] = f"{stem}_{axis} ({group.unit})" if group.unit else f"{stem}_{axis}"


def _groups(names: Sequence[str]) -> Iterator[_Group]:
    """Groups of columns that have one of each axis, whose names are alike otherwise."""
    places: dict[tuple[tuple[str, ...], str, tuple[str, ...]], dict[str, list[int]]] = {}
    for k, name in enumerate(names):
        words, unit = ([], "") if _CONTROL.search(name) else _words_and_unit(name)
        for place, word in enumerate(words):
            rest = (*words[:place], "", *words[place + 1 :])
            for axes in (*_THREE, *_FOUR):
                if word in axes:
                    axis = "xyzw"[axes.index(word)]
                    places.setdefault((rest, unit, axes), {}).setdefault(axis, []).append(k)
    for (rest, unit, axes), columns in places.items():
        if len(columns) == len(axes) and all(len(own) == 1 for own in columns.values()):
            words = tuple(word for word in rest if word)
            yield _Group({axis: columns[axis][0] for axis in "xyzw"[: len(axes)]}, words, unit, axes)


def _words_and_unit(name: str) -> tuple[list[str], str]:
    """Words of a name, a stem and its axis parted, without its unit; and this."""
    plain, unit = parts_of(name)
    words, within = unit_within(words_of(plain))
    parted = []
    for word in filter(None, "/".join(words).split("/")):
        matched = _JOINED.fullmatch(word)
        parted += [matched["stem"], matched["axis"]] if matched else [word]
    return parted, unit or within


def _is_rate(group: _Group) -> bool:
    """Whether words or the unit say that three columns are the rate of a body about its own axes."""
    words = set(group.words)
    if len(group.axes) != 3 or words & {*_OTHERS, *_REFERENCE}:
        return False
    if (group.words == ("w",) and group.axes[2] in "23") or ("b" in words and not _is_spin(group)):
        return False  # w_1 may be that of a wheel, and gyro_b a bias
    if _RATE.search(group.joined) or words & set(_RATE_WORDS):
        return True
    is_flight = group.axes in (("roll", "pitch", "yaw"), ("p", "q", "r")) and bool(words & set(_FLIGHT))
    return is_flight or is_rate_unit(group.unit)


def _is_spin(group: _Group) -> bool:
    return bool(_SPIN.search(group.joined)) or bool(set(group.words) & set(_RATE_WORDS))


def _is_rotation(group: _Group) -> bool:
    """Whether four columns are a quaternion from the body's axes to those of reference, as far as their words say."""
    if not any(_ROTATION.fullmatch(word) for word in group.words):
        return False
    reference = [k for k, word in enumerate(group.words) if word in _REFERENCE]
    body = [k for k, word in enumerate(group.words) if word in _BODY and k > 0]
    if not reference or not body:
        return True
    # q_world_body maps from the body to the world, and so does q_body_to_world
    is_to = any(word in ("to", "2") for word in group.words[min(*reference, *body) : max(*reference, *body)])
    return (reference[0] < body[-1]) != is_to


def _is_position(group: _Group) -> bool:
    return len(group.axes) == 3 and (
        any(_POSITION.fullmatch(word) for word in group.words) or not set(group.words) - {"m", "mm", "cm"}
    )


def _context(group: _Group) -> tuple[str, ...]:
    """Words that say of which body a vector is."""
    return tuple(w for w in group.words if not (_POSITION.fullmatch(w) or _ROTATION.fullmatch(w) or w == "m"))
