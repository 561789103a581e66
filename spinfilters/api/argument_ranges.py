"""Ranges of arguments; nothing heavy is imported here."""

from typing import Final

from spinfilters.core.errors import InputError
from spinfilters.io.input_file import value_text
from spinfilters.io.stated_values import NumberRange

SEED: Final = NumberRange(0, 10**18, whole=True)
SEGMENT: Final = NumberRange(0, 10**9 - 1, whole=True)
FRAMES: Final = NumberRange(1, 100_000, whole=True)
INTERVAL: Final = NumberRange(1e-6, 1e5, "s")
RATE_RPM: Final = NumberRange(-1e6, 1e6, "rpm")
MOMENT: Final = NumberRange(1e-6, 1e6)
"""Of inertia, in any unit."""
LANDMARKS: Final = NumberRange(1, 200, whole=True)
GYRO_BIAS: Final = NumberRange(-100, 100, "rad/s")
WORKERS: Final = NumberRange(1, 1024, whole=True)
SECONDS_AHEAD: Final = NumberRange(1e-9, 1e9, "s")


def require_motion(
    frames: int, interval: float, rate_rpm: tuple[float, ...], moments: tuple[float, ...]
) -> None:
    """Raise InputError unless the numbers of a motion can be used.

    Parameters
    ----------
    interval: s.   rate_rpm, moments: three each, about the principal axes x, y, z.
    """
    FRAMES.require("frames", frames)
    INTERVAL.require("interval", interval)
    for name, values, allowed in (("rate_rpm", rate_rpm, RATE_RPM), ("moments", moments, MOMENT)):
        if len(values) != 3:
            raise InputError(f"{name} is {value_text(values)}; give three numbers, about the axes x, y, z")
        for value in values:
            allowed.require(name, value)
