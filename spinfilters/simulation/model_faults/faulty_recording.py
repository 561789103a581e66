"""Simulated recordings with one wrong model, and the table of all that can be wrong.

The disturbed motion is on a fine grid of time, from before the first epoch to behind the last.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from pkgutil import iter_modules
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.conversions import (
    matrix_from_quaternion,
    multiply,
    quaternion_from_rotation_vector,
)
from spinfilters.data.dataset import Dataset
from spinfilters.dynamics.mass_distribution import inertia_matrix
from spinfilters.simulation.faults import with_stream
from spinfilters.simulation.model_faults.model_fault import FaultyRates, FaultyView, ModelFault
from spinfilters.simulation.motion import Motion
from spinfilters.simulation.scenario import Scenario, first_state, measured
from spinfilters.state.layout import FULL_BLOCKS, StateLayout

FOLDER = "spinfilters.simulation.model_faults"
STEP = 1e-3
"""Between two views that tell how fast points move, s."""


def model_faults() -> Mapping[str, ModelFault]:
    """All by name."""
    modules = (
        import_module(module.name) for module in iter_modules(import_module(FOLDER).__path__, f"{FOLDER}.")
    )
    every = [fault for module in modules for fault in getattr(module, "FAULTS", ())]
    return MappingProxyType({fault.name: fault for fault in every})


def faulty_recording(
    scenario: Scenario, fault: ModelFault, size: float, seeds: tuple[np.random.SeedSequence, ...]
) -> Dataset:
    """A recording with a fault of a size in its unit.

    What is drawn comes from (motion, measurements, faults).
    The motion, the surface and the sensors' noise are drawn alike whatever the fault.
    """
    motion, values, own = seeds
    fine = faulty_motion(scenario, Physics.of(fault.physics, size), np.random.default_rng(motion))
    time, drawn = scenario.interval * np.arange(scenario.epochs), np.random.default_rng(own)
    truth = motion_at(fine, time)
    dataset = measured(scenario, truth, np.random.default_rng(values))
    if fault.late is not None:
        moved = Motion(truth.layout, time, motion_at(fine, time + size * fault.late(time, drawn)).states)
        dataset = replace(dataset, log=measured(scenario, moved, np.random.default_rng(values)).log)
    stream = dataset.log.streams[0]
    if fault.rates is not None:
        rates = FaultyRates(time, truth.block("w"), fine, size)
        dataset = with_stream(dataset, replace(stream, values=stream.values + fault.rates(rates)))
    if fault.pixels is not None:
        pixels = fault.pixels(_view(dataset, fine, size, drawn))
        dataset = with_stream(dataset, replace(stream, values=stream.values + pixels))
    return dataset if fault.recording is None else fault.recording(dataset, size)


def _view(dataset: Dataset, fine: Motion, size: float, generator: np.random.Generator) -> FaultyView:
    stream, known, rig = dataset.log.streams[0], dataset.known_map, dataset.rig
    assert known is not None
    assert rig is not None
    assert stream.ids is not None
    own = known.points[np.searchsorted(known.ids, stream.ids)]
    points = _seen(motion_at(fine, stream.time), own)
    later = _seen(motion_at(fine, stream.time + STEP), own)
    epoch = np.searchsorted(np.unique(stream.time), stream.time)
    return FaultyView(points, (later - points) / STEP, epoch, rig.calibration, size, generator)


def _seen(motion: Motion, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return motion.block("t") + np.einsum("kij,kj->ki", motion.rotations, points)


LAYOUT: Final = StateLayout(FULL_BLOCKS)
SUBSTEPS: Final = 20
"""Between two epochs."""
TOUCHED: Final = 0.05
"""Share of a recording within which a contact ends or begins."""
Vector = Float[np.ndarray, "3"]


@dataclass(frozen=True)
class Physics:
    """Disturbances of a body's motion; all zero in free flight.

    Attributes
    ----------
    torque: rad/s^2, g axes.   acceleration: m/s^2, i axes.   drag: of the rotation, 1/rad.   air: of the path, 1/m.
    loss: of energy, k in J w' = ... - k |h| (w less its part along h).   rotor: h inside, in units of J times rad/s.
    hinge: (9,) what the inertia gains from begin to end, the body's own in the middle, relative to its largest entry.
      begin, end: (6,) rad/s^2 and m/s^2 while something touches the body.
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

    @classmethod
    def of(cls, per_unit: Mapping[str, Float[np.ndarray, " n"] | float], size: float) -> "Physics":
        """Physics of a fault of this size."""
        scaled: dict[str, Any] = {name: np.multiply(value, size) for name, value in per_unit.items()}
        return cls(**scaled)

    def touch(self, share: float) -> Float[np.ndarray, "6"]:
        """rad/s^2 and m/s^2 at a share of the recording."""
        return self.begin * (share < TOUCHED) + self.end * (share > 1 - TOUCHED)

    def rate_change(self, inertia: Float[np.ndarray, "3 3"], w: Vector, share: float, span: float) -> Vector:
        """w' at a share of the recording of ``span`` s."""
        opening = np.max(inertia) * self.hinge.reshape(3, 3)
        J = inertia + (share - 0.5) * opening
        h = J @ w
        along = h / np.linalg.norm(h)
        lost = self.loss * np.linalg.norm(h) * (w - along * (along @ w)) + opening @ w / span
        braked = self.drag * np.linalg.norm(w) * w
        pushed = self.torque + self.touch(share)[:3] - braked
        return np.linalg.solve(J, np.cross(h + self.rotor, w) - lost) + pushed

    def velocity_change(self, v: Vector, share: float) -> Vector:
        """v'."""
        return self.acceleration + self.touch(share)[3:] - self.air * np.linalg.norm(v) * v


def faulty_motion(scenario: Scenario, physics: Physics, generator: np.random.Generator) -> Motion:
    """States at `SUBSTEPS` times in every interval, with the scenario's disturbances."""
    x, h = first_state(scenario, LAYOUT), scenario.interval / SUBSTEPS
    J, c = inertia_matrix(x[LAYOUT.mean_slice("s")]), x[LAYOUT.mean_slice("c")]
    time = h * np.arange(-SUBSTEPS, (scenario.epochs + 1) * SUBSTEPS)
    q, w, v = (x[LAYOUT.mean_slice(block)].copy() for block in "awv")
    r = x[LAYOUT.mean_slice("t")] + c
    std = np.sqrt(h * np.array([scenario.noise.torque_psd, scenario.noise.force_psd]))
    states, span = np.tile(x, (len(time), 1)), scenario.interval * (scenario.epochs - 1)
    for k, now in enumerate(time):
        states[k, LAYOUT.mean_slice("t")] = r - matrix_from_quaternion(q) @ c
        for block, value in (("a", q), ("v", v), ("w", w)):
            states[k, LAYOUT.mean_slice(block)] = value
        share = float(np.clip(now / span, 0.0, 1.0))
        k1 = physics.rate_change(J, w, share, span)
        k2 = physics.rate_change(J, w + h / 2 * k1, share, span)
        k3 = physics.rate_change(J, w + h / 2 * k2, share, span)
        k4 = physics.rate_change(J, w + h * k3, share, span)
        turned = w + h * (k1 + k2 + k3) / 6
        q = multiply(q, quaternion_from_rotation_vector(h * turned))
        w = w + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4) + std[0] * generator.standard_normal(3)
        acceleration = physics.velocity_change(v, share)
        r = r + h * v + h * h / 2 * acceleration
        v = v + h * acceleration + std[1] * generator.standard_normal(3)
    return Motion(LAYOUT, time, states)


def motion_at(fine: Motion, time: Float[np.ndarray, " k"]) -> Motion:
    """Motion to first order from the nearest state of the grid."""
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
