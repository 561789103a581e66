"""Number of substeps of an integration step, and the weights of its noise."""

import numpy as np
from jaxtyping import Float

MAX_SUBSTEPS = 1 << 14
"""Budget of one step, in substeps: forty revolutions at a tolerance of 1e-8. What needs more raises `IntegrationError`."""
FEWEST = 4
"""Substeps of a step: a panel of Boole's rule."""
BOOLE_ERROR, NOISE_ERROR = 0.1, 1e-6
"""Relative error of the noise covariance per rad^4 of turn and sixth power of the number of substeps, and what is allowed of it."""
STEP_ERROR = 6e-4
"""Error of a turn per rad and per fourth power of the substep's angle: where the step control starts. A guess that proves too
coarse costs one more evaluation, one that is too fine would cost every one."""


def turns(
    rates: Float[np.ndarray, "*batch 3"], dt: Float[np.ndarray, "*batch"]
) -> Float[np.ndarray, "*batch"]:
    """Rotation |w| dt of steps, rad.

    Infinite where it is beyond all numbers, which no square on the way is.
    """
    scale = np.abs(rates).max(axis=-1, keepdims=True, initial=np.finfo(float).tiny)
    with np.errstate(over="ignore", invalid="ignore"):
        return scale[..., 0] * np.linalg.norm(rates / scale, axis=-1) * dt


def substeps(turn: float, tolerance: float) -> int:
    """Substeps that a rotation (rad) in one step needs.

    A power of two; above `MAX_SUBSTEPS` for what needs more.
    """
    angle = (tolerance / (STEP_ERROR * max(turn, tolerance))) ** 0.25
    noise_angle = (NOISE_ERROR / BOOLE_ERROR) ** (1 / 6) * max(turn, NOISE_ERROR) ** (1 / 3)
    count = FEWEST
    while count * min(angle, noise_angle) < turn and count <= MAX_SUBSTEPS:
        count *= 2
    return count


def boole_weights(count: int) -> Float[np.ndarray, " nodes"]:
    """Boole's weights of the noise at every node of ``count`` substeps.

    Panels have four substeps; the last node is the end.
    """
    return np.array([7.0, *([32.0, 12.0, 32.0, 14.0] * (count // 4))[:-1], 7.0]) * 2 / 45
