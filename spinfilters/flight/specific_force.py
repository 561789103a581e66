"""What an accelerometer off the centre of mass feels in free flight: the rotation alone."""

from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.data.accelerometer import Acceleration

LARGEST_FORCE: Final = 2.5
"""m/s^2, root mean square, that rotation may leave unexplained: drag and scale errors leave less, a hand or a table 9.8."""
FARTHEST: Final = 2.0
"""Metres from the centre of mass at which a sensor may sit, as standard deviation."""


def unexplained_force(
    force: Acceleration, time: Float[np.ndarray, " n"], rates: Float[np.ndarray, "n 3"]
) -> float | None:
    """Rms specific force beyond the best sensor place, m/s^2.

    Without that of the best place of the sensor.
    The force at r from the centre of mass is w' x r + w x (w x r), linear in r. None where fewer than four samples were taken.

    Parameters
    ----------
    time, rates: of the gyro, s and rad/s.
    """
    inside = (force.time >= time[0]) & (force.time <= time[-1])
    if np.count_nonzero(inside) < 4 or len(time) < 4:
        return None
    stamps, measured = force.time[inside], force.values[inside]
    slope = np.gradient(rates, time, axis=0)
    rate, acceleration = (
        np.column_stack([np.interp(stamps, time, column) for column in each.T]) for each in (rates, slope)
    )
    design = (_cross(acceleration) + _cross(rate) @ _cross(rate)).reshape(-1, 3)
    prior = np.eye(3) * (LARGEST_FORCE / FARTHEST) ** 2
    place = np.linalg.solve(design.T @ design + prior, design.T @ measured.reshape(-1))
    left = measured.reshape(-1) - design @ place
    return float(np.sqrt(np.mean(left.reshape(-1, 3) ** 2) * 3))


def _cross(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    """Matrices of v x."""
    x, y, z = vectors.T
    o = np.zeros_like(x)
    return np.stack([np.stack([o, -z, y], 1), np.stack([z, o, -x], 1), np.stack([-y, x, o], 1)], 1)
