"""Even drift of an inspector's known attitudes, about any axis of frame i.

It is hardly told from a rotation of the body. The default is that of a small gyro without a star tracker.
"""

from typing import Final

from spinfilters.data.consider_parameter import ConsiderParameter
from spinfilters.data.stated_values import NumberRange
from spinfilters.geometry.camera_displacements import turning

INSPECTOR_ROTATION: Final = ConsiderParameter(
    name="inspector_rotation_std",
    words="attitudes of the inspector",
    allowed=NumberRange(0, 1.0, "rad/min"),
    default=2e-2,
    sensors=("stereo", "monocular"),
    size=3,
    displaced=turning,
    order=7,
)
