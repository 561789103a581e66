"""Points of a process, and its derivatives by finite differences."""

import numpy as np
from jaxtyping import Float

from spinfilters.core.mass_distribution import from_inertia
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.models.state_blocks import BLOCKS
from spinfilters.models.state_layout import FULL_BLOCKS, ROTATION_BLOCKS, StateLayout

LAYOUTS = tuple(StateLayout(blocks) for blocks in ((*ROTATION_BLOCKS, "d"), FULL_BLOCKS, tuple(BLOCKS)))
"""Rotation with drag, rotation and translation without, and all that a state may have: each takes a compiler long."""
EMBEDDED_MOMENTS = np.array([1.0322, 1.0, 0.8596])


def random_point(layout: StateLayout, rate: float, generator: np.random.Generator) -> Float[np.ndarray, " m"]:
    """Any attitude, place and body, with a rate of this size in rad/s and a little drag."""
    x = layout.retract(layout.origin(), 0.5 * generator.standard_normal(layout.error_dim))
    w = generator.standard_normal(3)
    x[layout.mean_slice("w")] = rate * w / np.linalg.norm(w)
    if "d" in layout.blocks:
        x[layout.mean_slice("d")] = 0.02
    return x


def embedded_point(layout: StateLayout, rate: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " m"]:
    """The thesis' body with its principal axes along g."""
    x = layout.origin()
    x[layout.mean_slice("w")] = rate
    x[layout.mean_slice("s")] = from_inertia(np.diag(EMBEDDED_MOMENTS))
    return x


def difference_transition(
    process: TorqueFreeProcess, x: Float[np.ndarray, " m"], dt: float, step: float
) -> Float[np.ndarray, "n n"]:
    """d local(f(x), f(retract(x, d))) / dd at d = 0 by central differences of fourth order."""
    layout = process.layout
    eye, after = np.eye(layout.error_dim), process.step(x, dt)
    columns = np.zeros_like(eye)
    for multiple, weight in ((1, 8.0), (2, -1.0)):
        ahead = layout.local(after, process.step(layout.retract(x, multiple * step * eye), dt))
        behind = layout.local(after, process.step(layout.retract(x, -multiple * step * eye), dt))
        columns += weight * (ahead - behind) / (12 * step)
    return columns.T
