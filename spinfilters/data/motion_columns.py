"""Columns of a motion table: the clock and the vectors of motion among its headings."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from spinfilters.data.headings import FOREIGN, Heading, Quantity, heading_of
from spinfilters.data.input_file import path_text, value_text
from spinfilters.data.stated_values import RATE_UNITS, ReadingOptions
from spinfilters.errors import InputError

EXAMPLE: Final = "time_s,wx,wy,wz"
AXES: Final[dict[Quantity, str]] = {
    "rate": "xyz",
    "acceleration": "xyz",
    "position": "xyz",
    "quaternion": "xyzw",
}
KNOWN_UNITS: Final[dict[Quantity, dict[str, float]]] = {
    "rate": RATE_UNITS,
    "acceleration": {"m/s^2": 1.0, "g": 9.80665, "mg": 9.80665e-3},
    "position": {"m": 1.0, "mm": 1e-3, "cm": 1e-2},
    "quaternion": {},
}
"""SI units in the units of each quantity."""


@dataclass(frozen=True)
class VectorColumns:
    """Indices of a vector's components, and its unit.

    Empty where none is stated; whether its name means SI by convention.
    """

    indices: tuple[int, ...]
    unit: str
    is_si: bool


@dataclass(frozen=True)
class MotionColumns:
    """Clock and vector columns found in a header.

    Attributes
    ----------
    time: index and unit of the clock, None without one.   vectors: of each quantity that has all its components, once.
    """

    time: tuple[int, str] | None
    vectors: dict[Quantity, VectorColumns]


def motion_columns(
    path: Path, names: Sequence[str], options: ReadingOptions, bare: Quantity | None = None
) -> MotionColumns:
    """Columns of a header.

    Parameters
    ----------
    bare: see `heading_of`.

    Raises
    ------
    InputError: a quantity that stands twice, or in two units or one that is unknown; clocks among which none can be chosen.
    """
    headings = [heading_of(name, bare) for name in names]
    found: dict[Quantity, VectorColumns] = {}
    for quantity, axes in AXES.items():
        vector = _vector(
            path, names, [_Headed(k, h) for k, h in enumerate(headings) if h and h.quantity == quantity], axes
        )
        if vector is not None:
            found[quantity] = vector
    return MotionColumns(None if options.rate is not None else _clock(path, names, headings), found)


class _Headed(NamedTuple):
    """A column and what its heading says."""

    column: int
    heading: Heading


def _vector(path: Path, names: Sequence[str], found: list[_Headed], axes: str) -> VectorColumns | None:
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


def _clock(path: Path, names: Sequence[str], headings: Sequence[Heading | None]) -> tuple[int, str] | None:
    """Index and unit of the clock among the columns.

    The only one, or the first that states its unit, seconds before others.
    """
    times = [(k, h) for k, h in enumerate(headings) if h is not None and h.quantity == "time"]
    named = [(k, h) for k, h in times if h.axis != FOREIGN]
    clocks = [(k, h.unit) for k, h in named or times]
    stated = [clock for clock in clocks if clock[1] == "s"] or [clock for clock in clocks if clock[1]]
    if stated:
        return stated[0]
    if len(clocks) > 1:
        listed = " and ".join(value_text(names[k]) for k, _ in clocks[:2])
        raise InputError(
            f"{path_text(path)}: header: {listed} may both be the clock; name one of them with its unit, such as time_s"
        )
    return clocks[0] if clocks else None
