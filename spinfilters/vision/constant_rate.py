"""Pose of a body that goes on as between its last two epochs."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.conversions import (
    inverse,
    multiply,
    quaternion_from_rotation_vector,
    rotation_vector_from_quaternion,
)

FARTHEST: Final = 2.5
"""Times of the interval between the two, beyond which no pose is told."""


class TimedPose(NamedTuple):
    """Time (s) and pose (t, q_ig)."""

    time: float
    pose: Float[np.ndarray, " 7"]


def constant_rate(poses: Sequence[TimedPose], time: float) -> Float[np.ndarray, " 7"] | None:
    """Pose extrapolated from two epochs at constant velocity and rate.

    None without two, or too long after.
    """
    if len(poses) < 2:
        return None
    earlier, later = poses
    share = (time - later.time) / (later.time - earlier.time)
    if not 0 < share < FARTHEST:
        return None
    turn = rotation_vector_from_quaternion(multiply(later.pose[3:], inverse(earlier.pose[3:])))
    q = multiply(quaternion_from_rotation_vector(share * turn), later.pose[3:])
    return np.concatenate([later.pose[:3] + share * (later.pose[:3] - earlier.pose[:3]), q])
