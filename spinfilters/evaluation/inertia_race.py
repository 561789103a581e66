"""Several inertias propagated without torques from one attitude and rate, as Figures 6-23 to 6-26 of Tweddle (2013)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import (
    angle_between,
    inverse,
    multiply,
    quaternion_from_matrix,
    rotate,
)
from spinfilters.core.torque_free import torque_free_motion


@dataclass(frozen=True)
class NamedInertia:
    """Principal moments and axes of a body under a name.

    Attributes
    ----------
    name : str
        Whose they are.
    moments : (3,) float array
        Principal moments of any common scale.
    axes_g : (3, 3) float array
        Rows are the principal axes in g, so that it is R_bg.
    """

    name: str
    moments: Float[np.ndarray, "3"]
    axes_g: Float[np.ndarray, "3 3"]


@dataclass(frozen=True)
class PropagatedInertia:
    """The motion of one inertia.

    Attributes
    ----------
    name : str
        Of the inertia.
    attitude : (k, 4) float array
        q_ig, scalar last.
    rate : (k, 3) float array
        About the axes of g, rad/s.
    """

    name: str
    attitude: Float[np.ndarray, "k 4"]
    rate: Float[np.ndarray, "k 3"]

    def angle_from(self, attitude: Float[np.ndarray, "k 4"]) -> Float[np.ndarray, " k"]:
        """Closest angle to other attitudes, rad."""
        return angle_between(self.attitude, attitude)

    def rate_from(self, rate: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, " k"]:
        """Length of the difference of the body rates, rad/s."""
        return np.linalg.norm(self.rate - rate, axis=1)


def propagate_inertias(
    inertias: Sequence[NamedInertia],
    attitude: Float[np.ndarray, "4"],
    rate: Float[np.ndarray, "3"],
    time: Float[np.ndarray, " k"],
) -> list[PropagatedInertia]:
    """The torque-free motion of every inertia from one state.

    Parameters
    ----------
    inertias : sequence of NamedInertia
        Bodies that are compared.
    attitude : (4,) float array
        q_ig at time zero.
    rate : (3,) float array
        About the axes of g at time zero, rad/s.
    time : (k,) float array
        Since then, s.

    Returns
    -------
    list of PropagatedInertia
        In the order of the inertias.

    Raises
    ------
    InputError
        Moments of no rigid body.
    """
    found = []
    for each in inertias:
        q_gb = quaternion_from_matrix(each.axes_g.T)
        motion = torque_free_motion(each.moments, each.axes_g @ rate, time, multiply(attitude, q_gb))
        back, turned = (np.broadcast_to(q, motion.attitude.shape) for q in (inverse(q_gb), q_gb))
        found.append(
            PropagatedInertia(each.name, multiply(motion.attitude, back), rotate(turned, motion.rate))
        )
    return found
