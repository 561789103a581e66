"""Rates beside an attitude: whether they are its derivative, by which factor, and which way the attitude maps.

Rates are the derivative of a quaternion if q' = q (x) (0, w) / 2, of which the rotations between samples are a test.
"""

from typing import Final, Literal

import numpy as np
from jaxtyping import Float

FEWEST_ROWS: Final = 5
_DERIVED: Final = 0.02
"""Share of the rotations that their fit by the rates leaves at most."""
CONJUGATE: Final = (-1.0, -1.0, -1.0, 1.0)
"""Factors of a quaternion, scalar last, that turn it round, also one whose digits are not yet of unit length."""
Direction = Literal["unknown", "to inertial", "to body", "contradiction"]
"""Axes to which a quaternion maps, as rates beside it show: unknown of other numbers, contradiction of rates that turn back."""


def quaternion_direction(
    time: Float[np.ndarray, " n"], q: Float[np.ndarray, "n 4"], rates: Float[np.ndarray, "n 3"]
) -> Direction:
    """Direction of a quaternion, scalar last, that rates in one unit beside it show.

    Let D(q) be defined by q' = q (x) (0, D) / 2. If q maps from body to inertial axes, D(q) is the rate in body axes, and D(q*) is
    minus that in inertial axes. If q maps the other way, the two change places. So rates in body axes are D(q) or D(q*). Rates that
    are -D(q) are those in inertial axes of the other direction, or have the wrong signs.

    Parameters
    ----------
    time : Float[np.ndarray, ' n']
        In any unit.
    q : Float[np.ndarray, 'n 4']
        As read.
    rates : Float[np.ndarray, 'n 3']
        In any unit.
    """
    step = np.diff(time)[:, None]
    if (
        len(time) < FEWEST_ROWS
        or not (step > 0).all()
        or not np.isfinite(q).all()
        or not np.isfinite(rates).all()
    ):
        return "unknown"
    forth = np.sign(factor_of_rates(time, q, rates))
    back = np.sign(factor_of_rates(time, q * CONJUGATE, rates))
    if forth > 0 or (back < 0 and not forth):
        return "to inertial"
    if forth < 0:
        return "contradiction"
    return "to body" if back > 0 else "unknown"


def factor_of_rates(
    time: Float[np.ndarray, " n"], q: Float[np.ndarray, "n 4"], rates: Float[np.ndarray, "n 3"]
) -> float:
    """Factor by which rates over the steps of a clock are the rotations of a quaternion, by least squares; 0 where none fits.

    Parameters
    ----------
    time : Float[np.ndarray, ' n']
        In any unit, rising.
    q : Float[np.ndarray, 'n 4']
        Scalar last.
    rates : Float[np.ndarray, 'n 3']
        In any unit.
    """
    turned = _turned(q)
    mean = 0.5 * (rates[1:] + rates[:-1]) * np.diff(time)[:, None]
    size = float(np.sum(mean * mean))
    if not size > 0:
        return 0.0
    factor = float(np.sum(mean * turned)) / size
    fits = float(np.linalg.norm(turned - factor * mean)) < _DERIVED * float(np.linalg.norm(turned))
    return factor if fits else 0.0


def _turned(q: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "m 3"]:
    """Rotation vectors, in body axes, from each attitude to the next: q_k* (x) q_k+1, scalar last."""
    v, s, w, r = q[:-1, :3], q[:-1, 3:], q[1:, :3], q[1:, 3:]
    vector = s * w - r * v - np.cross(v, w)
    scalar = s[:, 0] * r[:, 0] + np.sum(v * w, axis=1)
    vector = vector * np.where(scalar < 0, -1.0, 1.0)[:, None]
    size = np.linalg.norm(vector, axis=1)
    angle = 2 * np.arctan2(size, np.abs(scalar))
    return vector * (angle / np.where(size > 0, size, 1.0))[:, None]
