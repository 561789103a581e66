"""Motion of a scanned body: pose of the mesh in the lidar's frame at any time."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from spinfilters.attitude.conversions import matrix_from_quaternion, quaternion_from_matrix
from spinfilters.dynamics.torque_free import torque_free_motion


class BodyMotion(Protocol):
    """Poses of the mesh's frame g in the lidar's frame L."""

    def poses(
        self, time: Float[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 3"]]:
        """R_Lg and the origin of g in L, m, at times in s."""
        ...


@dataclass(frozen=True, eq=False)
class Still:
    """A body at rest."""

    rotation: Float[np.ndarray, "3 3"]
    translation: Float[np.ndarray, "3"]

    def poses(
        self, time: Float[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 3"]]:
        """See `BodyMotion`; one pose for all times, broadcast."""
        n = len(time)
        return np.broadcast_to(self.rotation, (n, 3, 3)), np.broadcast_to(self.translation, (n, 3))


@dataclass(frozen=True, eq=False)
class TorqueFreeTumble:
    """A rigid body that drifts and tumbles without torque.

    Attributes
    ----------
    principal_moments: (3,) any scale.   principal_axes: (3, 3) rows, right-handed, in g.   center_of_mass: (3,) in g, m.
    rate: (3,) at t = 0 about the principal axes, rad/s.   attitude: (3, 3) R_Lg at t = 0.
    position, velocity: (3,) of the centre of mass in L, m and m/s.
    """

    principal_moments: Float[np.ndarray, "3"]
    principal_axes: Float[np.ndarray, "3 3"]
    center_of_mass: Float[np.ndarray, "3"]
    rate: Float[np.ndarray, "3"]
    attitude: Float[np.ndarray, "3 3"]
    position: Float[np.ndarray, "3"]
    velocity: Float[np.ndarray, "3"]

    def poses(
        self, time: Float[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 3"]]:
        """See `BodyMotion`."""
        R, _ = self._attitudes(time)
        centre = self.position + np.asarray(time)[:, None] * self.velocity
        return R, centre - R @ self.center_of_mass

    def rates(self, time: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        """Body rates in axes of L, rad/s."""
        R, rate = self._attitudes(time)
        return np.einsum("nij,kj,nk->ni", R, self.principal_axes, rate)

    def _attitudes(
        self, time: Float[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 3"]]:
        """R_Lg, and rates about the principal axes."""
        start = quaternion_from_matrix(self.attitude @ self.principal_axes.T)
        motion = torque_free_motion(self.principal_moments, self.rate, np.asarray(time), start)
        return matrix_from_quaternion(motion.attitude) @ self.principal_axes, motion.rate


def thesis_rotation(z_deg: float, y_deg: float, x_deg: float) -> Float[np.ndarray, "3 3"]:
    """Rotated points Rx (Ry (Rz P)) by Euler angles "(3, 2, 1)", deg.

    It is applied as printed (Decoust 2008, section 2.2.2). The name says an intrinsic sequence about z, y, x, which would be
    Rz Ry Rx: this is the extrinsic one.
    """
    return Rotation.from_euler("zyx", [z_deg, y_deg, x_deg], degrees=True).as_matrix()
