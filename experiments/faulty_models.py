"""Recordings whose models are wrong in one known way: the motion, the clock, the gyro or the cameras."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.conversions import (
    matrix_from_quaternion,
    multiply,
    quaternion_from_rotation_vector,
)
from spinfilters.data.dataset import Dataset
from spinfilters.data.measurement_log import MeasurementLog
from spinfilters.dynamics.mass_distribution import inertia_matrix
from spinfilters.simulation.motion import Motion
from spinfilters.simulation.scenario import Scenario, first_state, measured, without_map
from spinfilters.state.layout import FULL_BLOCKS, StateLayout

LAYOUT: Final = StateLayout(FULL_BLOCKS)
SUBSTEPS: Final = 20
"""Between two epochs."""
Shift = Callable[[float, np.random.Generator, Dataset], Float[np.ndarray, "n v"]]


@dataclass(frozen=True)
class Fault:
    """One wrong model.

    Attributes
    ----------
    name: the `Alternative` that describes it.   sizes: in the unit of that, ascending.
    physics: of `fine_motion`, per unit.   late: of epochs, s per unit, from (time, generator).
    pixels, rates: change of measured values per unit from (dataset's own truth).
    """

    name: str
    sizes: tuple[float, ...]
    physics: Mapping[str, np.ndarray | float] = field(default_factory=dict)
    late: Callable[[np.ndarray, np.random.Generator], np.ndarray] | None = None
    pixels: Callable[["Seen"], np.ndarray] | None = None
    rates: Callable[["Rates"], np.ndarray] | None = None


@dataclass(frozen=True)
class Seen:
    """True points in the left camera, m, at every row, a moment later too, and the calibration."""

    points: Float[np.ndarray, "n 3"]
    per_second: Float[np.ndarray, "n 3"]
    epoch: np.ndarray
    calibration: Float[np.ndarray, " c"]
    size: float
    generator: np.random.Generator

    def pixels(self, points: np.ndarray, calibration: np.ndarray, k1: float = 0.0) -> np.ndarray:
        """(u_left, v, u_right)."""
        f, cx, cy, b = calibration[0], calibration[2], calibration[3], calibration[4]
        x, y, xr = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2], (points[:, 0] - b) / points[:, 2]
        left, right = 1 + k1 * (x * x + y * y), 1 + k1 * (xr * xr + y * y)
        return np.stack([f * x * left + cx, f * y * left + cy, f * xr * right + cx], axis=1)

    def changed(self, **values: float) -> np.ndarray:
        """Difference that another calibration makes."""
        other, names = self.calibration.copy(), ("fx", "fy", "cx", "cy", "baseline")
        for name, factor in values.items():
            if name in names:
                other[names.index(name)] += factor
        nominal = self.pixels(self.points, self.calibration)
        return self.pixels(self.points, other, values.get("k1", 0.0)) - nominal


@dataclass(frozen=True)
class Rates:
    """True body rates at every epoch and their time."""

    time: np.ndarray
    w: np.ndarray
    size: float


def fine_motion(scenario: Scenario, generator: np.random.Generator, **physics: np.ndarray) -> Motion:
    """A disturbed motion on a fine grid, from before the first epoch to behind the last.

    Parameters
    ----------
    physics: torque (3,), acceleration (3,), drag, loss, rotor (3,), and begin or end as (share, torque (6,)).
    """
    x, h = first_state(scenario, LAYOUT), scenario.interval / SUBSTEPS
    J, c = inertia_matrix(x[LAYOUT.mean_slice("s")]), x[LAYOUT.mean_slice("c")]
    time = h * np.arange(-SUBSTEPS, (scenario.epochs + 1) * SUBSTEPS)
    q, w = x[LAYOUT.mean_slice("a")].copy(), x[LAYOUT.mean_slice("w")].copy()
    v = x[LAYOUT.mean_slice("v")].copy()
    r = x[LAYOUT.mean_slice("t")] + c
    std = np.sqrt(h * np.array([scenario.noise.torque_psd, scenario.noise.force_psd]))
    states = np.empty((len(time), LAYOUT.mean_dim))
    span = scenario.interval * (scenario.epochs - 1)
    for k, now in enumerate(time):
        x = x.copy()
        R = matrix_from_quaternion(q)
        x[LAYOUT.mean_slice("t")], x[LAYOUT.mean_slice("a")] = r - R @ c, q
        x[LAYOUT.mean_slice("v")], x[LAYOUT.mean_slice("w")] = v, w
        states[k] = x
        alpha, acceleration = _pushes(physics, now / span)

        k1 = _rate_change(J, w, physics) + alpha
        k2 = _rate_change(J, w + h / 2 * k1, physics) + alpha
        k3 = _rate_change(J, w + h / 2 * k2, physics) + alpha
        k4 = _rate_change(J, w + h * k3, physics) + alpha
        middle = w + h / 2 * k1
        q = multiply(q, quaternion_from_rotation_vector(h * (w + 4 * middle + w + h * k2) / 6))
        w = w + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4) + std[0] * generator.standard_normal(3)
        r = r + h * v + h * h / 2 * acceleration
        v = v + h * acceleration + std[1] * generator.standard_normal(3)
    return Motion(LAYOUT, time, states)


def _pushes(physics: Mapping[str, np.ndarray], share: float) -> tuple[np.ndarray, np.ndarray]:
    alpha = np.array(physics.get("torque", np.zeros(3)), dtype=float)
    acceleration = np.array(physics.get("acceleration", np.zeros(3)), dtype=float)
    touch = np.array(physics.get("begin", np.zeros(6)), dtype=float) * (share < 0.05)
    touch = touch + np.array(physics.get("end", np.zeros(6)), dtype=float) * (share > 0.95)
    return alpha + touch[:3], acceleration + touch[3:]


def _rate_change(J: np.ndarray, w: np.ndarray, physics: Mapping[str, np.ndarray]) -> np.ndarray:
    h = J @ w
    total = h + np.array(physics.get("rotor", np.zeros(3)), dtype=float)
    lost = 0.0
    if physics.get("loss"):
        along = h / np.linalg.norm(h)
        lost = float(physics["loss"]) * np.linalg.norm(h) * (w - along * (along @ w))
    drag = float(physics.get("drag", 0.0)) * np.linalg.norm(w) * w
    return np.linalg.solve(J, np.cross(total, w) - lost) - drag


def faulty(scenario: Scenario, fault: Fault | None, size: float) -> Dataset:
    """A recording with a fault of this size; of size 0 without one."""
    generator = np.random.default_rng(scenario.seed)
    physics = {} if fault is None else {n: np.asarray(np.multiply(v, size)) for n, v in fault.physics.items()}
    fine = fine_motion(scenario, generator, **physics)
    time = scenario.interval * np.arange(scenario.epochs)
    truth = _at(fine, time)
    late = np.zeros(len(time))
    if fault is not None and fault.late is not None:
        late = size * fault.late(time, np.random.default_rng(scenario.seed + 999))
    dataset = measured(scenario, truth, np.random.default_rng(scenario.seed + 1))
    if late.any():
        moved = Motion(LAYOUT, time, _at(fine, time + late).states)
        seen = measured(scenario, moved, np.random.default_rng(scenario.seed + 1))
        dataset = replace(dataset, log=seen.log)
    stream = dataset.log.streams[0]
    if fault is not None and fault.rates is not None:
        rates = Rates(time, truth.block("w"), size)
        stream = replace(stream, values=stream.values + fault.rates(rates))
    if fault is not None and fault.pixels is not None:
        assert dataset.rig is not None
        points, speed, epoch = _points(dataset, fine)
        seen = Seen(
            points, speed, epoch, dataset.rig.calibration, size, np.random.default_rng(scenario.seed + 2)
        )
        stream = replace(stream, values=stream.values + fault.pixels(seen))
    dataset = replace(dataset, log=MeasurementLog((stream,)))
    return without_map(dataset) if dataset.known_map is not None else dataset


def _at(fine: Motion, time: np.ndarray) -> Motion:
    """To first order from the nearest state of the grid."""
    near = np.clip(np.searchsorted(fine.time, time + (fine.time[1] - fine.time[0]) / 2) - 1, 0, None)
    states, by = fine.states[near].copy(), (time - fine.time[near])[:, None]
    w, q, c = fine.block("w")[near], fine.block("a")[near], fine.block("s")[near]
    c = states[:, LAYOUT.mean_slice("c")]
    centre = states[:, LAYOUT.mean_slice("t")] + np.einsum("kij,kj->ki", matrix_from_quaternion(q), c)
    turned = multiply(q, quaternion_from_rotation_vector(by * w))
    states[:, LAYOUT.mean_slice("a")] = turned
    centre += by * states[:, LAYOUT.mean_slice("v")]
    states[:, LAYOUT.mean_slice("t")] = centre - np.einsum("kij,kj->ki", matrix_from_quaternion(turned), c)
    return Motion(LAYOUT, time, states)


def _points(dataset: Dataset, fine: Motion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    stream, known = dataset.log.streams[0], dataset.known_map
    assert known is not None
    assert stream.ids is not None
    own = known.points[np.searchsorted(known.ids, stream.ids)]
    step = 1e-3
    at = [_at(fine, stream.time + by) for by in (0.0, step)]
    points = [m.block("t") + np.einsum("kij,kj->ki", m.rotations, own) for m in at]
    epoch = np.searchsorted(np.unique(stream.time), stream.time)
    return points[0], (points[1] - points[0]) / step, epoch


def _jitter(time: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    return generator.standard_normal(len(time))


def _drift(time: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    return 4 * ((time - time.mean()) / (time[-1] - time[0])) ** 2


def _late(seen: Seen) -> np.ndarray:
    ahead = seen.pixels(seen.points + seen.size * seen.per_second, seen.calibration)
    return (ahead - seen.pixels(seen.points, seen.calibration)) * np.array([0, 0, 1])


def _turned(seen: Seen) -> np.ndarray:
    x, y = (
        (seen.points[:, 0] - seen.calibration[4]) / seen.points[:, 2],
        seen.points[:, 1] / seen.points[:, 2],
    )
    by = seen.size * seen.calibration[0] * (0.3 * (1 + x * x) + x * y + y)
    return by[:, None] * np.array([0, 0, 1])


def _shake(seen: Seen) -> np.ndarray:
    shift = seen.size * seen.generator.standard_normal((int(seen.epoch.max()) + 1, 2))[seen.epoch]
    return shift[:, [0, 1, 0]]


AXIS: Final = np.array([0.5, -0.7, 0.5])
MOTION: Final = (
    Fault("torque", (1e-3, 4e-3, 1.6e-2), {"torque": AXIS}),
    Fault("drag", (2e-3, 1e-2, 5e-2), {"drag": 1.0}),
    Fault("energy-loss", (2e-2, 0.1, 0.3), {"loss": 1.0}),
    Fault("rotor", (0.02, 0.1, 0.4), {"rotor": AXIS}),
    Fault("contact-at-begin", (0.05, 0.2, 0.8), {"begin": np.array([1, -1, 1, 0.1, 0.1, 0.1])}),
    Fault("contact-at-end", (0.05, 0.2, 0.8), {"end": np.array([1, -1, 1, 0.1, 0.1, 0.1])}),
)
PLACE: Final = (Fault("acceleration", (3e-4, 3e-3, 3e-2), {"acceleration": AXIS}),)
CLOCK: Final = (
    Fault("clock-jitter", (0.01, 0.03, 0.1), late=_jitter),
    Fault("clock-drift", (0.1, 0.3, 0.6), late=_drift),
)
GYRO: Final = (
    Fault("gyro-bias", (0.01, 0.03, 0.1), rates=lambda r: np.tile(r.size * AXIS, (len(r.w), 1))),
    Fault("gyro-scale", (0.02, 0.1), rates=lambda r: r.size * r.w),
    Fault("gyro-misalignment", (0.01, 0.05, 0.15), rates=lambda r: r.size * r.w[:, [1, 0, 2]] * [1, 1, 0]),
)
CAMERA: Final = (
    Fault("camera-shake", (0.5, 1.0, 3.0), pixels=_shake),
    Fault("right-camera-late", (2e-3, 5e-3, 2e-2), pixels=_late),
    Fault("right-camera-turned", (2e-3, 5e-3, 2e-2), pixels=_turned),
    Fault("focal-length", (0.01, 0.03, 0.1), pixels=lambda s: s.changed(fx=s.size * s.calibration[0])),
    Fault("principal-point", (2.0, 5.0, 20.0), pixels=lambda s: s.changed(cx=s.size, cy=-s.size)),
    Fault("distortion", (0.02, 0.1, 0.3), pixels=lambda s: s.changed(k1=s.size)),
)
FAULTS: Final[Mapping[str, tuple[Fault, ...]]] = {
    "pose": (*MOTION, *PLACE, *CLOCK),
    "gyro": (*MOTION, *CLOCK, *GYRO),
    "stereo-tracks": (*MOTION, *PLACE, *CLOCK, *CAMERA),
}
