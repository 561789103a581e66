"""Errors of a front end that takes one face of a body for another."""

from typing import Final

import numpy as np

from spinfilters.attitude.conversions import multiply, quaternion_from_rotation_vector
from spinfilters.simulation.model_faults.model_fault import AXIS, POSE, TRACKS, ModelFault
from spinfilters.simulation.motion import Motion

EARLIEST, LATEST = 0.2, 0.7
"""Share of a recording at which a front end slips."""
SHORTEST, LONGEST = 0.1, 0.3
"""Share of a recording for which it does, where it finds back; half of them do not."""


def _slipped(motion: Motion, size: float, generator: np.random.Generator) -> Motion:
    """The motion with the body turned by ``size`` rad about an axis of g, from one epoch on or for a stretch."""
    count, layout = len(motion.time), motion.layout
    first = int(generator.uniform(EARLIEST, LATEST) * count)
    length = int(generator.uniform(SHORTEST, LONGEST) * count) if generator.random() < 0.5 else count
    states = motion.states.copy()
    attitude = states[first : first + length, layout.mean_slice("a")]
    turned = quaternion_from_rotation_vector(min(size, np.pi) * AXIS / np.linalg.norm(AXIS))
    states[first : first + length, layout.mean_slice("a")] = multiply(attitude, turned)
    return Motion(layout, motion.time, states)


FAULTS: Final = (ModelFault("slip", np.pi, (POSE, TRACKS), seen=_slipped),)
