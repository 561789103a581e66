"""Lever arm from where an inspector's poses are of to its camera, in the camera's axes.

Poses of navigation are of a reference point of the spacecraft, and turning about it hardly shows in a smooth path. The default is
that of a camera whose place on a spacecraft of some decimetres is known roughly: a forgotten arm of 8 cm an axis is 4 of it.
"""

from typing import Final

from spinfilters.data.consider_parameter import ConsiderParameter
from spinfilters.data.stated_values import NumberRange
from spinfilters.geometry.camera_displacements import levered

INSPECTOR_LEVER: Final = ConsiderParameter(
    name="inspector_lever_std",
    words="lever arm of the inspector's camera",
    allowed=NumberRange(0, 10.0, "m"),
    default=2e-2,
    sensors=("stereo", "monocular"),
    size=3,
    displaced=levered,
    order=9,
)
