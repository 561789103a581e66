"""Conversion between the project's states and GTSAM's variables, with derivatives.

A frame has two variables: X_k, the Pose3 of the camera in frame g (T_gi, so that `GenericStereoFactor3D` applies as it is), and
V_k = (v, w). L_j is a landmark's Point3. C = (c, e) is common, with the body s0 [+] e about that of the trial: what GTSAM adds to
is the project's own error of a mass distribution, in which a belief about a body is nearly Gaussian.

Rows of the project are by its error (t, a); with Pose3's own tangent, T_gi Exp(omega, u), to first order

    t' = t + [t x] omega - u,     a = -R_ig' omega.
"""

from collections.abc import Sequence
from importlib import import_module
from typing import Any

import numpy as np
from jaxtyping import Float

from experiments.benchmarks.motion_rows import MOVING, POSE
from spinfilters.core.errors import InputError
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout

try:
    gtsam: Any = import_module("gtsam")  # by name, so that types are checked where it is not installed
except ImportError:
    gtsam = None

MISSING = (
    "the peer GTSAM is not installed; type 'pip install gtsam' (4.3 was measured), or leave this peer out"
)
ATTITUDE, RATES, CENTRE, MASS = slice(3, 7), slice(7, 13), slice(13, 16), slice(16, 21)
"""Where q_ig, (v, w), c and s stand in a state of the full layout; t stands before them."""


def require_gtsam() -> None:
    """Say what to do where GTSAM cannot be imported.

    Raises
    ------
    InputError: there.
    """
    if gtsam is None:
        raise InputError(MISSING)


def pose_key(frame: int) -> int:
    """X_k."""
    return gtsam.symbol("x", frame)


def rates_key(frame: int) -> int:
    """V_k."""
    return gtsam.symbol("v", frame)


def constants_key() -> int:
    """C."""
    return gtsam.symbol("c", 0)


def landmark_key(number: int, life: int = 0) -> int:
    """L_j; one that left a window and comes back is another variable, of its next life."""
    return gtsam.symbol("l", number + (life << 32))


class GtsamChart:
    """Between a layout and GTSAM, with bodies as errors about one that is given.

    Parameters
    ----------
    body: s0, about which C holds the body's error.
    """

    def __init__(self, layout: StateLayout, body: Float[np.ndarray, " 5"]) -> None:
        require_gtsam()
        assert layout.blocks == FULL_BLOCKS
        self._layout = layout
        self._zero = layout.origin()
        self._zero[MASS] = body
        self._seen = np.full(8, np.nan)
        self._constants, self._by_error = np.zeros(8), np.eye(5)

    def values(self, trajectory: Float[np.ndarray, "k m"], points: Float[np.ndarray, "L 3"]) -> Any:
        """Values of a trajectory and of landmarks (m, frame g).

        Its constants are those of its first state; landmarks 0, 1 ...
        """
        values = gtsam.Values()
        for frame, state in enumerate(trajectory):
            self.insert(values, frame, state)
        values.insert(constants_key(), self.constants(trajectory[0]))
        for number, point in enumerate(points):
            values.insertPoint3(landmark_key(number), point)
        return values

    def insert(self, values: Any, frame: int, state: Float[np.ndarray, " m"]) -> None:
        """X_k and V_k of a state."""
        pose = gtsam.Pose3(_rotation(state), state[:3])
        values.insert(pose_key(frame), pose.inverse())
        values.insert(rates_key(frame), state[RATES])

    def constants(self, state: Float[np.ndarray, " m"]) -> Float[np.ndarray, " 8"]:
        """C of a state."""
        error = self._layout.local(self._zero, state)
        return np.concatenate([state[CENTRE], error[self._layout.slice("s")]])

    def trajectory(self, values: Any, epochs: int) -> Float[np.ndarray, "k m"]:
        """States of the first frames."""
        constants = values.atVector(constants_key())
        return np.array(
            [
                self.state(values.atPose3(pose_key(k)), values.atVector(rates_key(k)), constants)
                for k in range(epochs)
            ]
        )

    def state(
        self, pose: Any, rates: Float[np.ndarray, " 6"], constants: Float[np.ndarray, " 8"]
    ) -> Float[np.ndarray, " m"]:
        """State of one epoch's variables."""
        self._see(constants)
        place = pose.inverse()
        q = place.rotation().toQuaternion()
        turn = [q.x(), q.y(), q.z(), q.w()]
        return np.concatenate([place.translation(), turn, rates, self._constants])

    def by_variables(
        self,
        states: Sequence[Float[np.ndarray, " m"]],
        constants: Float[np.ndarray, " 8"],
        by_error: Float[np.ndarray, "r c"],
    ) -> list[Float[np.ndarray, "r _"]]:
        """Rows by X, V and C from rows by states' errors.

        Those errors are of a state (20), and the moving error of a second (12).
        """
        self._see(constants)
        n, blocks = self._layout.error_dim, []
        for state, first in zip(states, (0, n), strict=False):
            own = by_error[:, first : first + MOVING]
            blocks += [own[:, :POSE] @ _pose_chart(state), own[:, POSE:]]
        by_constants = by_error[:, MOVING:n].copy()
        by_constants[:, 3:] = by_constants[:, 3:] @ self._by_error
        return [*blocks, by_constants]

    def _see(self, constants: Float[np.ndarray, " 8"]) -> None:
        """Keep (c, s) of C and its derivative, shared by all frames.

        That of the error of s by e.
        """
        if not np.array_equal(constants, self._seen):
            error = np.zeros(self._layout.error_dim)
            error[MOVING:] = constants
            mass = self._layout.slice("s")
            self._constants = self._layout.retract(self._zero, error)[CENTRE.start :]
            self._by_error = self._layout.reset_jacobian(error)[mass, mass]
            self._seen = constants.copy()


def landmarks(values: Any, count: int) -> Float[np.ndarray, "L 3"]:
    """Landmarks 0 .. count - 1, m, frame g."""
    return np.array([values.atPoint3(landmark_key(number)) for number in range(count)])


def _pose_chart(state: Float[np.ndarray, " m"]) -> Float[np.ndarray, "6 6"]:
    """Derivative of (t, a) by Pose3's (omega, u)."""
    x, y, z = state[:3].tolist()
    chart = np.zeros((6, 6))
    chart[:3, :3] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    chart[:3, 3:] = -np.eye(3)
    chart[3:, :3] = -_rotation(state).matrix().T
    return chart


def _rotation(state: Float[np.ndarray, " m"]) -> Any:
    """R_ig as GTSAM's Rot3."""
    x, y, z, w = state[ATTITUDE].tolist()
    return gtsam.Rot3.Quaternion(w, x, y, z)
