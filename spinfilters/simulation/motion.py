"""A true motion: the stochastic process equation, integrated finely."""

import numpy as np
from jaxtyping import Float

from spinfilters.models.process import TorqueFreeProcess

SUBSTEPS = 40
"""Noise kicks per frame interval: the splitting error falls with its square."""


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
    layout, states, x = process.layout, [start], start
    for interval in np.diff(time):
        h = float(interval) / SUBSTEPS
        for _ in range(SUBSTEPS):
            x = _kick(process, x, h / 2, generator)
            x = process.step(x, h)
            x = _kick(process, x, h / 2, generator)
        q = layout.mean_slice("a")
        x[..., q] /= np.linalg.norm(x[..., q], axis=-1, keepdims=True)
        states.append(x)
    return np.stack(states)


def _kick(process: TorqueFreeProcess, x: np.ndarray, h: float, generator: np.random.Generator) -> np.ndarray:
    x = x.copy()
    blocks = {"w": process.noise.torque_psd, "v": process.noise.force_psd}
    for block, psd in blocks.items():
        if block in process.layout.blocks:
            where = process.layout.mean_slice(block)
            x[..., where] += np.sqrt(psd * h) * generator.standard_normal((*x.shape[:-1], 3))
    return x
