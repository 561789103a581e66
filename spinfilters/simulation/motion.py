"""A true motion: the stochastic process equation, integrated finely."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.conversions import matrix_from_quaternion
from spinfilters.geometry.camera_trajectory import CameraTrajectory, in_camera
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.state.layout import POSE_BLOCKS, StateLayout

SUBSTEPS = 40
"""Noise kicks per epoch interval: the splitting error falls with its square."""
Progress = Callable[[int, int], None]
"""Called with how many epochs are done, and of how many."""


def silent(done: int, total: int) -> None:
    """Progress callback that does nothing."""


@dataclass(frozen=True)
class Motion:
    """States (n, mean_dim) of one layout at ``time`` (n,) s."""

    layout: StateLayout
    time: Float[np.ndarray, " n"]
    states: Float[np.ndarray, "n m"]

    def block(self, name: str) -> Float[np.ndarray, "n b"]:
        """One block at every time; the attitude as quaternions q_ig."""
        return self.states[:, self.layout.mean_slice(name)]

    @property
    def rotations(self) -> Float[np.ndarray, "n 3 3"]:
        """R_ig at every time."""
        return matrix_from_quaternion(self.block("a"))

    def at(self, time: Float[np.ndarray, " k"]) -> "Motion":
        """The motion at some of its own times, s."""
        return Motion(self.layout, time, self.states[np.searchsorted(self.time, time)])

    def seen_from(self, inspector: CameraTrajectory | None) -> "Motion":
        """Poses of g in the epoch of a moving camera; of none the motion itself."""
        if inspector is None:
            return self
        poses = np.concatenate([self.block("t"), self.block("a")], axis=1)
        return Motion(StateLayout(POSE_BLOCKS), self.time, in_camera(poses, inspector.at(self.time)))


def simulate_motion(
    process: TorqueFreeProcess,
    start: Float[np.ndarray, "*batch m"],
    time: Float[np.ndarray, " n"],
    generator: np.random.Generator,
    progress: Progress = silent,
    substeps: int = SUBSTEPS,
) -> Float[np.ndarray, "n *batch m"]:
    """States at every time of one or many motions that begin at ``start`` (time[0]).

    Between epochs the noise-free step and white kicks of rate and velocity alternate (Strang splitting: half a kick, a step, half a
    kick), so it does not rest on the process model's own noise covariance.

    Parameters
    ----------
    progress: called after every epoch with how many are done, and of how many.   substeps: noise kicks per interval.
    """
    q, blocks = process.layout.mean_slice("a"), process.disturbed_dim // 3
    states, x = [start], start
    for interval in np.diff(time):
        drawn = generator.standard_normal((substeps, 2, blocks, *x.shape[:-1], 3))
        normal = np.moveaxis(drawn, (1, 2), (-3, -2)).reshape(substeps, *x.shape[:-1], 2, 3 * blocks)
        x = process.disturbed_steps(x, float(interval) / substeps, normal)
        x[..., q] /= np.linalg.norm(x[..., q], axis=-1, keepdims=True)
        states.append(x)
        progress(len(states), len(time))
    return np.stack(states)
