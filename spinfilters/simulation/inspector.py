"""Inspectors of simulated data sets: how the camera that sees the body moves."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.conversions import inverse, multiply, quaternion_from_rotation_vector, rotate
from spinfilters.geometry.camera_trajectory import CameraTrajectory
from spinfilters.simulation.limit_cycle import limit_cycle

InspectorPath = Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, "n 7"]]
"""Poses (t_ic m, q_ic) in frame i at times since the first epoch, s, before it and after the last, too; i is that of time zero."""

STATIC: Final = "static"
"""Of an inspector that does not move, so that frame i is its camera's."""
CIRCLE_PERIOD: Final = 60.0
"""Of a circle about the body, s."""
SWAY_PERIODS: Final = np.array([[23.0, 31.0, 37.0], [19.0, 29.0, 17.0]])
"""Of place and attitude about every axis, s: no two of them agree."""
SWAY: Final = np.array([[0.05], [0.05]])
"""Amplitudes of place, m, and attitude, rad."""
BAND: Final = np.array([[0.008], [0.015]])
"""Dead band of place, m, and attitude, rad, either way."""
PULSE: Final = np.array([[0.002], [0.004]])
"""Velocity behind a pulse of the thrusters, m/s and rad/s."""
PUSH: Final = np.array([[1e-4], [2e-4]])
"""Largest constant acceleration between pulses, m/s^2 and rad/s^2."""


def circle(centre: Float[np.ndarray, " 3"], seed: int = 0) -> InspectorPath:
    """Circle in the xz plane about a point in view, m, frame i.

    It goes round -y, against the spin of the scenarios' bodies: an inspector that flies along with a body sees it rotate less, and
    learns less of it (a tenth less, once a minute beside a body of 10 rpm).
    """

    def path(time: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 7"]:
        """Poses that look at the centre."""
        angles = -2 * np.pi / CIRCLE_PERIOD * time
        q = quaternion_from_rotation_vector(angles[:, None] * np.array([0.0, 1.0, 0.0]))
        return np.concatenate([centre - rotate(q, np.tile(centre, (len(time), 1))), q], axis=1)

    return path


def sway(centre: Float[np.ndarray, " 3"], seed: int = 0) -> InspectorPath:
    """Place and attitude that swing about every axis, each with a period of its own."""

    def path(time: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 7"]:
        """Poses, the identity at time zero."""
        swung = SWAY[:, :, None] * np.sin(2 * np.pi * time / SWAY_PERIODS[:, :, None])
        return _poses(swung)

    return path


def dead_band(centre: Float[np.ndarray, " 3"], seed: int = 0) -> InspectorPath:
    """Limit cycle of thrusters that fire where place or attitude leave a dead band: parabolas in between."""
    generator = np.random.default_rng([seed, 7])
    cycles = [
        [limit_cycle(float(band), float(pulse), float(push), generator) for _ in range(3)]
        for (band,), (pulse,), (push,) in zip(BAND, PULSE, PUSH, strict=True)
    ]

    def path(time: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 7"]:
        """Poses in the frame of the one at time zero."""
        poses = _poses(np.array([[cycle(time) for cycle in three] for three in cycles]))
        begin = _poses(np.array([[cycle(np.zeros(1)) for cycle in three] for three in cycles]))[0]
        back = inverse(begin[3:])
        place = rotate(np.tile(back, (len(time), 1)), poses[:, :3] - begin[:3])
        return np.concatenate([place, multiply(np.tile(back, (len(time), 1)), poses[:, 3:])], axis=1)

    return path


def _poses(coordinates: Float[np.ndarray, "2 3 n"]) -> Float[np.ndarray, "n 7"]:
    """Poses of places and rotation vectors."""
    place, turned = coordinates.transpose(0, 2, 1)
    return np.concatenate([place, quaternion_from_rotation_vector(turned)], axis=1)


def circling(time: Float[np.ndarray, " n"], centre: Float[np.ndarray, " 3"]) -> CameraTrajectory:
    """Circle about a point, m, that begins as frame i at the first of these times."""
    return CameraTrajectory(time, circle(centre)(time - time[0]))


INSPECTORS: Final[Mapping[str, Callable[[Float[np.ndarray, " 3"], int], InspectorPath] | None]] = (
    MappingProxyType({STATIC: None, "circle": circle, "sway": sway, "dead-band": dead_band})
)
"""By name: from the body's place (3,) m in i and a seed to a path."""
