"""Delay of an inspector's known poses against the images.

Of a uniform circle it turns frame i, which no residual shows. The default is that of computers whose clocks nobody has set by one
another, and of a camera that is stamped when its image arrives.
"""

from typing import Final

from spinfilters.data.consider_parameter import ConsiderParameter
from spinfilters.data.stated_values import NumberRange
from spinfilters.geometry.camera_displacements import later

INSPECTOR_CLOCK: Final = ConsiderParameter(
    name="inspector_clock_std",
    words="clock of the inspector's poses",
    allowed=NumberRange(0, 10.0, "s"),
    default=0.15,
    sensors=("stereo", "monocular"),
    displaced=later,
    order=8,
)
