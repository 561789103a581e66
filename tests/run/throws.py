"""Simulated logs in which a body is carried, thrown and caught."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

MOMENTS = np.array([0.22, 0.8, 1.0])
FLIGHTS = ((2.0, 3.0), (4.5, 5.5))
"""s: of the body in the air; else a hand turns it."""
INTERVAL = 0.01


@dataclass(frozen=True)
class Carried:
    """Time (s), body rates (rad/s), attitudes and position of the centre of mass (m), i axes with z up."""

    time: Float[np.ndarray, " n"]
    rates: Float[np.ndarray, "n 3"]
    attitude: Rotation
    position: Float[np.ndarray, "n 3"]


def in_flight(time: float) -> bool:
    """Whether the body is in the air."""
    return any(start <= time <= end for start, end in FLIGHTS)


def hand(time: float, rate: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
    """Torque of a hand over the largest moment, rad/s^2: it leads the body along a rate of its own, rad/s."""
    if in_flight(time):
        return np.zeros(3)
    wanted = np.array([10.0, 12.0, 8.0]) * np.sin(
        np.array([3.0, 4.3, 5.7]) * time + np.array([0.1, 1.0, 0.4])
    )
    return 10.0 * (wanted - rate)


def carried(noise: float, generator: np.random.Generator) -> Carried:
    """A log with gyro noise (rad/s) and without noise of the positions."""
    time = np.arange(0.0, 7.0, INTERVAL)

    def slope(t: float, state: Float[np.ndarray, " 13"]) -> Float[np.ndarray, " 13"]:
        w, q, v = state[:3], state[3:7], state[10:]
        acceleration = (hand(t, w) - np.cross(w, MOMENTS * w)) / MOMENTS
        x, y, z, s = q
        turning = 0.5 * np.array(
            [
                s * w[0] + y * w[2] - z * w[1],
                s * w[1] + z * w[0] - x * w[2],
                s * w[2] + x * w[1] - y * w[0],
                -q[:3] @ w,
            ]
        )
        force = (
            np.array([0.0, 0.0, -9.81]) if in_flight(t) else 6.0 * np.sin([5.0 * t, 4.0 * t + 1, 3.0 * t + 2])
        )
        return np.concatenate([acceleration, turning, v, force])

    start = np.concatenate([[3.0, 5.0, -2.0], [0, 0, 0, 1.0], np.zeros(6)])
    states: list[Float[np.ndarray, " 13"]] = [start]
    edges = [0.0, *(edge for flight in FLIGHTS for edge in flight), time[-1]]
    stamps = [time[0:1]]
    for first, last in pairwise(edges):
        inside = time[(time > first + 1e-9) & (time <= last + 1e-9)]
        found = solve_ivp(slope, (first, last), start, dense_output=True, rtol=1e-8, atol=1e-9)
        start = found.y[:, -1]
        states.extend(found.sol(inside).T)
        stamps.append(inside)
    history = np.array(states)
    rates = history[:, :3] + noise * generator.standard_normal((len(history), 3))
    return Carried(np.concatenate(stamps), rates, Rotation.from_quat(history[:, 3:7]), history[:, 7:10])
