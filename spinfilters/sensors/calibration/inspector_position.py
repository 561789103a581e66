"""Even drift of an inspector's known positions, along any axis of frame i.

It is a velocity of the body, which no residual shows. How well inspectors know their paths differs by orders of magnitude; the
default is that of a good visual navigation at a few metres.
"""

from typing import Final

from spinfilters.data.consider_parameter import ConsiderParameter
from spinfilters.data.stated_values import NumberRange
from spinfilters.geometry.camera_displacements import drifting

INSPECTOR_POSITION: Final = ConsiderParameter(
    name="inspector_position_std",
    words="positions of the inspector",
    allowed=NumberRange(0, 1.0, "m/min"),
    default=1e-2,
    sensors=("stereo", "monocular"),
    size=3,
    displaced=drifting,
    order=6,
)
