"""Errors of the motion: what pushes the body, and what moves inside it."""

from typing import Final

import numpy as np

from spinfilters.simulation.model_faults.model_fault import AXIS, GYRO, POSE, TRACKS, ModelFault

ALL, PLACES = (POSE, GYRO, TRACKS), (POSE, TRACKS)
TOUCH: Final = np.array([1, -1, 1, 0.1, 0.1, 0.1])
"""rad/s^2 and m/s^2."""
OPENED: Final = np.array([[0.6, 0.3, 0.0], [0.3, -0.2, 0.1], [0.0, 0.1, 0.4]])
"""Change of the inertia by a part that turns on its hinge, relative to the largest moment."""

FAULTS: Final = (
    ModelFault("torque", 4e-3, ALL, {"torque": AXIS}),
    ModelFault("drag", 1e-2, ALL, {"drag": 1.0}),
    ModelFault("energy-loss", 0.1, ALL, {"loss": 1.0}),
    ModelFault("rotor", 0.1, ALL, {"rotor": AXIS}),
    ModelFault("hinge", 0.1, ALL, {"hinge": OPENED.ravel()}),
    ModelFault("contact-at-begin", 0.2, ALL, {"begin": TOUCH}),
    ModelFault("contact-amid", 0.2, ALL, {"amid": TOUCH}),
    ModelFault("contact-at-end", 0.2, ALL, {"end": TOUCH}),
    ModelFault("acceleration", 3e-3, PLACES, {"acceleration": AXIS}),
    ModelFault("air-resistance", 0.5, PLACES, {"air": 1.0}),
)
