"""A disturbed motion on a fine grid of time, from before the first epoch to behind the last."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import (
    matrix_from_quaternion,
    multiply,
    quaternion_from_rotation_vector,
)
from spinfilters.core.mass_distribution import inertia_matrix
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout
from spinfilters.simulation.scenario import Motion, Scenario, first_state

LAYOUT: Final = StateLayout(FULL_BLOCKS)
SUBSTEPS: Final = 20
"""Between two epochs."""
TOUCHED: Final = 0.05
"""Share of a recording within which a contact ends or begins."""
TOUCHED_AMID: Final = 0.55
"""Share of a recording about which a contact amid it lasts, for half as long."""
Vector = Float[np.ndarray, "3"]


@dataclass(frozen=True)
class Physics:
    """What moves a body beside its inertia; all zero in free flight.

    Attributes
    ----------
    torque : ndarray of shape (3,)
        rad/s^2, g axes.
    acceleration : ndarray of shape (3,)
        m/s^2, i axes.
    drag : float
        Of the rotation, 1/rad.
    air : float
        Of the path, 1/m.
    loss : float
        Of energy, k in J w' = ... - k |h| (w less its part along h).
    rotor : ndarray of shape (3,)
        Angular momentum h inside, in units of J times rad/s.
    hinge : ndarray of shape (9,)
        What the inertia gains from begin to end, the body's own in the middle, relative to its largest entry.
    begin, amid, end : ndarray of shape (6,)
        rad/s^2 and m/s^2 while something touches the body.
    """

    torque: Vector = field(default_factory=lambda: np.zeros(3))
    acceleration: Vector = field(default_factory=lambda: np.zeros(3))
    drag: float = 0.0
    air: float = 0.0
    loss: float = 0.0
    rotor: Vector = field(default_factory=lambda: np.zeros(3))
    hinge: Float[np.ndarray, "9"] = field(default_factory=lambda: np.zeros(9))
    begin: Float[np.ndarray, "6"] = field(default_factory=lambda: np.zeros(6))
    end: Float[np.ndarray, "6"] = field(default_factory=lambda: np.zeros(6))
    amid: Float[np.ndarray, "6"] = field(default_factory=lambda: np.zeros(6))

    @classmethod
    def of(cls, per_unit: Mapping[str, Float[np.ndarray, " n"] | float], size: float) -> "Physics":
        """Physics of a fault of this size."""
        scaled: dict[str, Any] = {name: np.multiply(value, size) for name, value in per_unit.items()}
        return cls(**scaled)

    def touch(self, share: float) -> Float[np.ndarray, "6"]:
        """rad/s^2 and m/s^2 at a share of the recording."""
        middle = self.amid * (abs(share - TOUCHED_AMID) < TOUCHED / 4)
        return self.begin * (share < TOUCHED) + middle + self.end * (share > 1 - TOUCHED)

    def rate_change(self, inertia: Float[np.ndarray, "3 3"], w: Vector, share: float, span: float) -> Vector:
        """w' at a share of the recording of ``span`` s."""
        opening = np.max(inertia) * self.hinge.reshape(3, 3)
        J = inertia + (share - 0.5) * opening
        h = J @ w
        size = float(np.sqrt(h @ h))
        along = h / size
        lost = self.loss * size * (w - along * (along @ w)) + opening @ w / span
        braked = self.drag * float(np.sqrt(w @ w)) * w
        pushed = self.torque + self.touch(share)[:3] - braked
        return np.linalg.solve(J, _cross(h + self.rotor, w) - lost) + pushed

    def velocity_change(self, v: Vector, share: float) -> Vector:
        """v'."""
        return self.acceleration + self.touch(share)[3:] - self.air * np.linalg.norm(v) * v


def faulty_motion(
    scenario: Scenario, physics: Physics, generator: np.random.Generator, behind: float = 0.0
) -> Motion:
    """States at `SUBSTEPS` times in every interval, with the scenario's disturbances.

    From an interval before the first epoch to one, and ``behind`` s, after the last; the motion is the same, however far it goes.
    """
    x, h = first_state(scenario, LAYOUT), scenario.interval / SUBSTEPS
    J = inertia_matrix(x[LAYOUT.mean_slice("s")])
    time = h * np.arange(-SUBSTEPS, (scenario.epochs + 1) * SUBSTEPS + int(np.ceil(behind / h)))
    w, v = (x[LAYOUT.mean_slice(block)].copy() for block in "wv")
    std = np.sqrt(h * np.array([scenario.noise.torque_psd, scenario.noise.force_psd]))
    span = scenario.interval * (scenario.epochs - 1)
    rates, velocities, turns, moves = np.zeros((4, len(time), 3))
    for k, now in enumerate(time):
        rates[k], velocities[k] = w, v
        share = float(np.clip(now / span, 0.0, 1.0))
        # Rates by Runge-Kutta 4, and the rotation that its stages imply; noise kicks at the end of the step.
        k1 = physics.rate_change(J, w, share, span)
        k2 = physics.rate_change(J, w + h / 2 * k1, share, span)
        k3 = physics.rate_change(J, w + h / 2 * k2, share, span)
        k4 = physics.rate_change(J, w + h * k3, share, span)
        turns[k] = h * (w + h * (k1 + k2 + k3) / 6)
        w = w + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4) + std[0] * generator.standard_normal(3)
        acceleration = physics.velocity_change(v, share)
        moves[k] = h * v + h * h / 2 * acceleration
        v = v + h * acceleration + std[1] * generator.standard_normal(3)
    return Motion(LAYOUT, time, _states(x, _Path(rates, velocities, turns, moves)))


class _Path(NamedTuple):
    """Rates and velocities at every time, rotations and moves from each to the next."""

    rates: Float[np.ndarray, "k 3"]
    velocities: Float[np.ndarray, "k 3"]
    turns: Float[np.ndarray, "k 3"]
    moves: Float[np.ndarray, "k 3"]


def _states(first: Float[np.ndarray, " m"], path: _Path) -> Float[np.ndarray, "k m"]:
    """States at every time from that at the first."""
    states = np.tile(first, (len(path.rates), 1))
    q = np.empty((len(states), 4))
    q[0] = first[LAYOUT.mean_slice("a")]
    turned = quaternion_from_rotation_vector(path.turns[:-1])[:, None]
    for k, by in enumerate(multiply(np.tile(np.eye(4), (len(turned), 1, 1)), np.repeat(turned, 4, axis=1))):
        q[k + 1] = q[k] @ by
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    moved = np.concatenate([np.zeros((1, 3)), np.cumsum(path.moves[:-1], axis=0)])
    arms = _arms(q, states)
    for block, value in (("a", q), ("v", path.velocities), ("w", path.rates)):
        states[:, LAYOUT.mean_slice(block)] = value
    states[:, LAYOUT.mean_slice("t")] = (
        first[LAYOUT.mean_slice("t")] + first[LAYOUT.mean_slice("c")] + moved - arms
    )
    return states


def _cross(a: Vector, b: Vector) -> Vector:
    """Cross product of two vectors, without what numpy's asks of many."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def motion_at(fine: Motion, time: Float[np.ndarray, " k"]) -> Motion:
    """To first order from the nearest state of the grid."""
    step = fine.time[1] - fine.time[0]
    near = np.clip(np.searchsorted(fine.time, time + step / 2) - 1, 0, None)
    states, by = fine.states[near].copy(), (time - fine.time[near])[:, None]
    centre = fine.block("t")[near] + _arms(fine.block("a")[near], states)
    q = multiply(fine.block("a")[near], quaternion_from_rotation_vector(by * fine.block("w")[near]))
    states[:, LAYOUT.mean_slice("a")] = q
    centre += by * fine.block("v")[near]
    states[:, LAYOUT.mean_slice("t")] = centre - _arms(q, states)
    return Motion(LAYOUT, time, states)


def _arms(q: Float[np.ndarray, "k 4"], states: Float[np.ndarray, "k m"]) -> Float[np.ndarray, "k 3"]:
    """R_ig c at every time."""
    return np.einsum("kij,kj->ki", matrix_from_quaternion(q), states[:, LAYOUT.mean_slice("c")])
