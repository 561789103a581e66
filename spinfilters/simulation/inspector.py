"""Inspectors of simulated data sets: known trajectories of the camera about the body."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.conversions import quaternion_from_rotation_vector, rotate
from spinfilters.geometry.camera_trajectory import CameraTrajectory

STATIC: Final = "static"
"""Of an inspector that does not move, so that frame i is its camera's."""
CIRCLE_PERIOD: Final = 60.0
"""Of a circle about the body, s."""


def circling(time: Float[np.ndarray, " n"], centre: Float[np.ndarray, " 3"]) -> CameraTrajectory:
    """Circle in the xz plane about a point in view.

    m, frame i; begins as frame i.
    It goes round -y, against the spin of the scenarios' bodies: an inspector that flies along with a body sees it rotate less, and
    learns less of it (a tenth less, once a minute beside a body of 10 rpm).
    """
    angles = -2 * np.pi / CIRCLE_PERIOD * (time - time[0])
    q = quaternion_from_rotation_vector(angles[:, None] * np.array([0.0, 1.0, 0.0]))
    return CameraTrajectory(
        time, np.concatenate([centre - rotate(q, np.tile(centre, (len(time), 1))), q], axis=1)
    )


INSPECTORS: Final[Mapping[str, Callable[..., CameraTrajectory] | None]] = MappingProxyType(
    {STATIC: None, "circle": circling}
)
"""By name: from times (n,) s and the body's place (3,) m in i to a trajectory."""
