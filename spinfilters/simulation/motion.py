"""A true motion: the stochastic process equation, integrated finely."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.conversions import matrix_from_quaternion
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.state.blocks.rigid_body import RATE, VELOCITY
from spinfilters.state.layout import StateLayout

SUBSTEPS = 40
"""Noise kicks per frame interval: the splitting error falls with its square."""


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


def simulate_motion(
    process: TorqueFreeProcess,
    start: Float[np.ndarray, "*batch m"],
    time: Float[np.ndarray, " n"],
    generator: np.random.Generator,
) -> Float[np.ndarray, "n *batch m"]:
    """States at every time of one or many motions that begin at ``start`` (time[0]).

    Between frames the noise-free step and white kicks of rate and velocity alternate (Strang splitting: half a kick, a step, half a
    kick), so it does not rest on the process model's own noise covariance.
    """
    q, densities = process.layout.mean_slice("a"), _densities(process)
    states, x = [start], start
    for interval in np.diff(time):
        h, x = float(interval) / SUBSTEPS, x.copy()
        for _ in range(SUBSTEPS):
            before, after = generator.standard_normal((2, len(densities), *x.shape[:-1], 3))
            _kick(x, densities, h / 2, before)
            x = process.step(x, h)
            _kick(x, densities, h / 2, after)
        x[..., q] /= np.linalg.norm(x[..., q], axis=-1, keepdims=True)
        states.append(x)
    return np.stack(states)


def _densities(process: TorqueFreeProcess) -> list[tuple[slice, float]]:
    """Where a state is disturbed, and how strongly."""
    noise, layout = process.noise, process.layout
    rotation = [(layout.mean_slice(RATE.name), noise.torque_psd)]
    return rotation + ([(layout.mean_slice(VELOCITY.name), noise.force_psd)] if layout.translates else [])


def _kick(x: np.ndarray, densities: list[tuple[slice, float]], h: float, normal: np.ndarray) -> None:
    """What the disturbances of ``h`` seconds add to the states, in place."""
    for (where, psd), values in zip(densities, normal, strict=True):
        x[..., where] += np.sqrt(psd * h) * values
