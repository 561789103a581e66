"""Relative error of the clock that stamps all measurements.

It scales all durations, and with them velocities and rates.
"""

from typing import Final

from spinfilters.data.consider_parameter import ConsiderParameter
from spinfilters.data.stated_values import NumberRange

CLOCK_SCALE: Final = ConsiderParameter(
    name="clock_scale_std",
    words="scale of the clock",
    allowed=NumberRange(0, 0.1, "of durations"),
    default=1e-4,
    order=5,
)
