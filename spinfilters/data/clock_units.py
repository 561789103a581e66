"""Unit of a clock, stated or inferred from its stamps."""

from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.data.input_file import path_text
from spinfilters.data.stated_values import CLOCK_UNITS
from spinfilters.errors import InputError

SLOWEST: Final = 1.0
FASTEST: Final = 8000.0
"""Hz: gyros and trackers whose clock has no unit sample between these."""
LARGEST_ROTATION: Final[float] = np.pi
"""Between samples in the median, rad: a gyro that is sampled more slowly tells no motion."""
LONGEST_STEP: Final[float] = 2.0
"""s: larger steps of a clock without a unit are not seconds."""
_CALENDAR = (8e8, 4.2e9)  # s from 1970 of the years 1995 to 2100


def clock_unit(
    path: Path, name: str, time: Float[np.ndarray, " n"], speed: Float[np.ndarray, " n"] | None
) -> str:
    """Unit of a clock that states none, by calendar date or plausible sampling.

    Parameters
    ----------
    time: stamps.   speed: rad/s at them, None where not known.

    Raises
    ------
    InputError: several units or none are plausible.
    """
    dated = [
        unit
        for unit, second in CLOCK_UNITS.items()
        if _CALENDAR[0] < abs(float(time[0])) * second < _CALENDAR[1]
    ]
    if dated:
        return dated[0]
    step = float(np.median(np.abs(np.diff(time)))) if len(time) > 1 else 0.0
    plausible = _plausible_units(time, step)
    possible = [
        u
        for u in plausible
        if speed is None or float(np.median(speed)) * step * CLOCK_UNITS[u] <= LARGEST_ROTATION
    ]
    if len(possible) == 1:
        return possible[0]
    listed = " or ".join(possible or CLOCK_UNITS)
    raise InputError(
        f"{path_text(path)}: the clock '{name[:40]}' steps by {step:.6g}, and does not say in what; give --clock {listed}, "
        "or name it so, such as time_ms"
    )


def _plausible_units(time: Float[np.ndarray, " n"], step: float) -> list[str]:
    """Units at which the sampling rate is plausible."""
    whole = bool((time == np.round(time)).all())
    if not step or (step < LONGEST_STEP and not whole):
        return ["s"]
    return [unit for unit, second in CLOCK_UNITS.items() if SLOWEST <= 1.0 / (step * second) <= FASTEST]
