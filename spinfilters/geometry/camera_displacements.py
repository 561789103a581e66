"""Errors of a camera's known trajectory: displacements of its poses, of the time of its stamps and of its drift.

A displacement (k, 6) of poses (t_ic, q_ic) is one of the place, m, axes i, and a small rotation of the camera, rad, its own axes:
t_ic + d, q_ic (x) dq(phi).
"""

from collections.abc import Callable
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.conversions import (
    continuous_quaternions,
    inverse,
    matrix_from_quaternion,
    multiply,
    quaternion_from_rotation_vector,
    rotation_vector_from_quaternion,
)

Displacement = Callable[[Float[np.ndarray, " k"], Float[np.ndarray, "k 7"]], Float[np.ndarray, "k 6 m"]]
"""Displacements of poses at ascending times per unit of m errors: from times (k,) s and poses (k, 7)."""
MINUTE: Final = 60.0
"""In which a drift has its size, s."""


def displaced(poses: Float[np.ndarray, "k 7"], by: Float[np.ndarray, "k 6"]) -> Float[np.ndarray, "k 7"]:
    """Poses of a camera that are displaced."""
    turned = multiply(poses[:, 3:], quaternion_from_rotation_vector(by[:, 3:]))
    return np.concatenate([poses[:, :3] + by[:, :3], turned], axis=1)


def later(time: Float[np.ndarray, " k"], poses: Float[np.ndarray, "k 7"]) -> Float[np.ndarray, "k 6 1"]:
    """Displacement by the camera's own velocity, per second; zero of a single pose.

    By central differences of the place and of the attitude, of the ends by those of their neighbours.
    """
    if len(time) < 2:
        return np.zeros((len(time), 6, 1))
    q = continuous_quaternions(poses[:, 3:])
    place = np.gradient(poses[:, :3], time, axis=0)
    # rotation since the pose before, by the mean of what leads to a pose and what leads from it
    turns = rotation_vector_from_quaternion(multiply(inverse(q[:-1]), q[1:])) / np.diff(time)[:, None]
    rates = np.concatenate([turns[:1], (turns[:-1] + turns[1:]) / 2, turns[-1:]])
    return np.concatenate([place, rates], axis=1)[:, :, None]


def drifting(time: Float[np.ndarray, " k"], poses: Float[np.ndarray, "k 7"]) -> Float[np.ndarray, "k 6 3"]:
    """Places that drift evenly from the first time on, by a unit per axis of i in a minute."""
    found = np.zeros((len(time), 6, 3))
    found[:, :3] = _since(time)[:, None, None] * np.eye(3)
    return found


def turning(time: Float[np.ndarray, " k"], poses: Float[np.ndarray, "k 7"]) -> Float[np.ndarray, "k 6 3"]:
    """Attitudes that drift evenly from the first time on, by a radian about each axis of i in a minute."""
    found = np.zeros((len(time), 6, 3))
    to_camera = np.swapaxes(
        matrix_from_quaternion(poses[:, 3:]), 1, 2
    )  # a rotation about axes i in those of the camera
    found[:, 3:] = _since(time)[:, None, None] * to_camera
    return found


def levered(time: Float[np.ndarray, " k"], poses: Float[np.ndarray, "k 7"]) -> Float[np.ndarray, "k 6 3"]:
    """Places that are off by the same lever arm at all times, by a unit per axis of the camera."""
    found = np.zeros((len(time), 6, 3))
    found[:, :3] = matrix_from_quaternion(poses[:, 3:])
    return found


def _since(time: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    return (time - time[:1]) / MINUTE  # of no time at all none
