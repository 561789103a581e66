"""Units, clock, sampling rate and topic stated by the user."""

from dataclasses import dataclass, fields
from typing import Final

import numpy as np

from spinfilters.data.input_file import value_text
from spinfilters.data.number_range import NumberRange
from spinfilters.errors import InputError

RATE_UNITS: Final[dict[str, float]] = {
    "rad/s": 1.0,
    "mrad/s": 1e-3,
    "deg/s": np.pi / 180.0,
    "mdeg/s": np.pi / 180e3,
    "rpm": np.pi / 30.0,
}
"""rad/s in a unit of body rate."""
CLOCK_UNITS: Final[dict[str, float]] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Seconds in a unit of time."""
SAMPLING_RATE: Final = NumberRange(1e-6, 1e6, "Hz")


@dataclass(frozen=True)
class ReadingOptions:
    """Statements about a recording; None where its file tells.

    Attributes
    ----------
    unit: of body rates, a key of `RATE_UNITS`.   clock: unit of time stamps, a key of `CLOCK_UNITS`.
    rate: samples a second, Hz, in place of a clock.   topic: of a ROS bag.

    Raises
    ------
    InputError: an unknown unit, a rate out of its range.
    """

    unit: str | None = None
    clock: str | None = None
    rate: float | None = None
    topic: str | None = None

    def __post_init__(self) -> None:
        for name, units in (("unit", RATE_UNITS), ("clock", CLOCK_UNITS)):
            value = getattr(self, name)
            if value is not None and value not in units:
                raise InputError(f"--{name} {value_text(value)} is unknown; give {', '.join(units)}")
        if self.rate is not None:
            SAMPLING_RATE.require("--rate", self.rate)
        if self.rate is not None and self.clock is not None:
            raise InputError("--rate replaces the clock; leave out --clock")

    @property
    def stated(self) -> tuple[str, ...]:
        """Names of the options that are stated."""
        return tuple(each.name for each in fields(self) if getattr(self, each.name) is not None)

    def require_only(self, allowed: tuple[str, ...], words: str) -> None:
        """Raise InputError for a statement that a format has no use for.

        Parameters
        ----------
        allowed: names of statements that can be used.   words: what the format is called.
        """
        for name in self.stated:
            if name not in allowed:
                raise InputError(f"--{name} is of no use for {words}; leave it out")


NOTHING_STATED: Final = ReadingOptions()
