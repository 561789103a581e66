"""Simulated recordings with one wrong model: of the motion, the clock, a camera, a front end, a gyro or poses.

One more is a `ModelFault` in the tuple of its kind, all of which `MODEL_FAULTS` holds. First comes the disturbed motion, on a fine
grid of time from before the first epoch to after the last; then what is wrong with the measurements of it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.attitude_conversions import (
    matrix_from_quaternion,
    multiply,
    quaternion_from_rotation_vector,
)
from spinfilters.core.mass_distribution import inertia_matrix
from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout
from spinfilters.simulation.measurement_faults import with_stream
from spinfilters.simulation.scenario import Motion, Scenario, first_state, measured

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
    """What moves a body in addition to its inertia; all zero in free flight.

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


AXIS: Final = np.array([0.5, -0.7, 0.5])
"""Of errors with a direction: none of the frames' axes."""
POSE, GYRO, TRACKS = "pose", "gyro", "stereo-tracks"


@dataclass(frozen=True)
class FaultyRates:
    """True body rates (s, rad/s) at and between epochs, and the error's size."""

    time: Float[np.ndarray, " k"]
    rates: Float[np.ndarray, "k 3"]
    fine: Motion
    size: float


@dataclass(frozen=True)
class FaultyView:
    """Observations of a pair of cameras, and the size of the error.

    Attributes
    ----------
    points : ndarray of shape (n, 3)
        In the left camera at every row, m.
    per_second : ndarray of shape (n, 3)
        Their velocities, m/s.
    epoch : ndarray of shape (n,)
        Number of every row's epoch.
    calibration : ndarray of shape (5,)
        fx, fy, cx, cy px, baseline m.
    size : float
        Of the error.
    generator : np.random.Generator
        Of what is drawn by image.
    """

    points: Float[np.ndarray, "n 3"]
    per_second: Float[np.ndarray, "n 3"]
    epoch: Int[np.ndarray, " n"]
    calibration: Float[np.ndarray, " c"]
    size: float
    generator: np.random.Generator


@dataclass(frozen=True)
class ModelFault:
    """One wrong model.

    Attributes
    ----------
    name : str
        Of the alternative that describes it.
    size : float
        A plain one, in the unit of that.
    kinds : tuple[str, ...]
        Of data sets that can have it.
    physics : Mapping[str, ndarray or float]
        Of `faulty_motion`, per unit.
    late : Callable or None
        Delay of epochs, s per unit, from (time, generator).
    seen : Callable or None
        What a front end takes the true motion for, from (motion, size, generator).
    pixels, rates : Callable or None
        Change of the measured values.
    recording : Callable or None
        The data set with the error, from the right one and the size.
    """

    name: str
    size: float
    kinds: tuple[str, ...]
    physics: Mapping[str, Float[np.ndarray, " n"] | float] = field(default_factory=dict)
    late: Callable[[Float[np.ndarray, " k"], np.random.Generator], Float[np.ndarray, " k"]] | None = None
    seen: Callable[[Motion, float, np.random.Generator], Motion] | None = None
    pixels: Callable[[FaultyView], Float[np.ndarray, "n 3"]] | None = None
    rates: Callable[[FaultyRates], Float[np.ndarray, "k 3"]] | None = None
    recording: Callable[[Dataset, float], Dataset] | None = None


ALL, PLACES = (POSE, GYRO, TRACKS), (POSE, TRACKS)
TOUCH: Final = np.array([1, -1, 1, 0.1, 0.1, 0.1])
"""rad/s^2 and m/s^2."""
OPENED: Final = np.array([[0.6, 0.3, 0.0], [0.3, -0.2, 0.1], [0.0, 0.1, 0.4]])
"""Change of the inertia by a part that turns on its hinge, relative to the largest moment."""

BODY_DISTURBANCES: Final = (
    ModelFault("torque", 4e-3, ALL, {"torque": AXIS}),
    ModelFault("drag", 1e-2, ALL, {"drag": 1.0}),
    ModelFault("energy-loss", 0.1, ALL, {"loss": 1.0}),
    ModelFault("rotor", 0.1, ALL, {"rotor": AXIS}),
    ModelFault("hinge", 0.1, ALL, {"hinge": OPENED.ravel()}),
    ModelFault("contact-at-begin", 0.2, ALL, {"begin": TOUCH}),
    ModelFault("contact-amid", 0.2, ALL, {"amid": TOUCH}),
    ModelFault("contact-at-end", 0.2, ALL, {"end": TOUCH}),
    ModelFault("acceleration", 3e-3, PLACES, {"acceleration": AXIS}),
    ModelFault("air-resistance", 0.5, PLACES, {"air": 1.0}),
)


ONLY: Final = (TRACKS,)
NAMES: Final = ("fx", "fy", "cx", "cy", "baseline")
RIGHT: Final = np.array([0.0, 0.0, 1.0])
Pixels = Float[np.ndarray, "n 3"]


def _project_points(points: Pixels, calibration: Float[np.ndarray, " c"], k1: float = 0.0) -> Pixels:
    """(u_left, v, u_right) px, of a lens with x (1 + k1 r^2)."""
    fx, fy, cx, cy, baseline = calibration[:5]
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    right = (points[:, 0] - baseline) / points[:, 2]
    left_by, right_by = 1 + k1 * (x * x + y * y), 1 + k1 * (right * right + y * y)
    return np.stack([fx * x * left_by + cx, fy * y * left_by + cy, fx * right * right_by + cx], axis=1)


def _pixel_change(view: FaultyView, k1: float = 0.0, **by: float) -> Pixels:
    """Difference that another calibration makes."""
    other = view.calibration.copy()
    for name, value in by.items():
        other[NAMES.index(name)] += value
    return _project_points(view.points, other, k1) - _project_points(view.points, view.calibration)


def _focal(view: FaultyView) -> Pixels:
    return _pixel_change(view, fx=view.size * view.calibration[0], fy=view.size * view.calibration[1])


def _centre(view: FaultyView) -> Pixels:
    return _pixel_change(view, cx=view.size, cy=-view.size)


def _distorted(view: FaultyView) -> Pixels:
    return _pixel_change(view, k1=view.size)


def _baseline(view: FaultyView) -> Pixels:
    return _pixel_change(view, baseline=view.size * view.calibration[4])


def _delay_view(view: FaultyView) -> Pixels:
    ahead = _project_points(view.points + view.size * view.per_second, view.calibration)
    return (ahead - _project_points(view.points, view.calibration)) * RIGHT


def _rotate_camera(view: FaultyView) -> Pixels:
    x = (view.points[:, 0] - view.calibration[4]) / view.points[:, 2]
    y = view.points[:, 1] / view.points[:, 2]
    by = view.size * view.calibration[0] * (0.3 * (1 + x * x) + x * y + y)
    return by[:, None] * RIGHT


def _shake(view: FaultyView) -> Pixels:
    shift = view.generator.standard_normal((int(view.epoch.max()) + 1, 2))
    return view.size * shift[view.epoch][:, [0, 1, 0]]


def _rescale_lengths(dataset: Dataset, size: float) -> Dataset:
    """Lengths ``size`` times too large: 1000 for mm that are read as m."""
    if dataset.rig is not None and dataset.rig.baseline_m:
        return replace(dataset, rig=replace(dataset.rig, baseline_m=size * dataset.rig.baseline_m))
    (stream,) = dataset.log.streams
    values = np.concatenate([size * stream.values[:, :3], stream.values[:, 3:]], axis=1)
    return replace(dataset, log=MeasurementLog((replace(stream, values=values),)))


CAMERA_FAULTS: Final = (
    ModelFault("camera-shake", 1.0, ONLY, pixels=_shake),
    ModelFault("right-camera-late", 5e-3, ONLY, pixels=_delay_view),
    ModelFault("right-camera-turned", 5e-3, ONLY, pixels=_rotate_camera),
    ModelFault("focal-length", 0.03, ONLY, pixels=_focal),
    ModelFault("principal-point", 5.0, ONLY, pixels=_centre),
    ModelFault("distortion", 0.1, ONLY, pixels=_distorted),
    ModelFault("baseline", 0.03, ONLY, pixels=_baseline),
    ModelFault("length-unit", 1e3, (POSE, TRACKS), recording=_rescale_lengths),
)


def _jitter(time: Float[np.ndarray, " k"], generator: np.random.Generator) -> Float[np.ndarray, " k"]:
    return generator.standard_normal(len(time))


def _drift(time: Float[np.ndarray, " k"], generator: np.random.Generator) -> Float[np.ndarray, " k"]:
    return 4 * ((time - time.mean()) / (time[-1] - time[0])) ** 2


def _rescale_clock(dataset: Dataset, size: float) -> Dataset:
    """Stamps ``size`` times too large, 1000 for ms that are read as s, of the truth too; true rates and speeds stay."""
    streams = tuple(replace(stream, time=stream.time * size) for stream in dataset.log.streams)
    truth = None if dataset.truth is None else replace(dataset.truth, time=size * dataset.truth.time)
    return replace(dataset, log=MeasurementLog(streams), truth=truth)


CLOCK_FAULTS: Final = (
    ModelFault("clock-jitter", 0.03, ALL, late=_jitter),
    ModelFault("clock-drift", 0.3, ALL, late=_drift),
    ModelFault("clock-unit", 1e3, ALL, recording=_rescale_clock),
)


EARLIEST, LATEST = 0.2, 0.7
"""Share of a recording at which a front end slips."""
SHORTEST, LONGEST = 0.1, 0.3
"""Share of a recording for which it does, where it finds back; half of them do not."""


def _slipped(motion: Motion, size: float, generator: np.random.Generator) -> Motion:
    """The motion with the body turned by ``size`` rad about an axis of g, from one epoch on or for a stretch."""
    count, layout = len(motion.time), motion.layout
    first = int(generator.uniform(EARLIEST, LATEST) * count)
    length = int(generator.uniform(SHORTEST, LONGEST) * count) if generator.random() < 0.5 else count
    states = motion.states.copy()
    attitude = states[first : first + length, layout.mean_slice("a")]
    turned = quaternion_from_rotation_vector(min(size, np.pi) * AXIS / np.linalg.norm(AXIS))
    states[first : first + length, layout.mean_slice("a")] = multiply(attitude, turned)
    return Motion(layout, motion.time, states)


FRONT_END_FAULTS: Final = (ModelFault("slip", np.pi, (POSE, TRACKS), seen=_slipped),)


OF_GYROS: Final = (GYRO,)


def _bias(each: FaultyRates) -> Float[np.ndarray, "k 3"]:
    return np.tile(each.size * AXIS, (len(each.rates), 1))


def _drifting_bias(each: FaultyRates) -> Float[np.ndarray, "k 3"]:
    """A bias that grows from -size to size."""
    along = np.linspace(-1.0, 1.0, len(each.rates))
    return each.size * along[:, None] * AXIS


def _scale(each: FaultyRates) -> Float[np.ndarray, "k 3"]:
    return each.size * each.rates


def _misaligned(each: FaultyRates) -> Float[np.ndarray, "k 3"]:
    return each.size * each.rates[:, [1, 0, 2]] * [1, 1, 0]


def _low_pass(each: FaultyRates) -> Float[np.ndarray, "k 3"]:
    """First-order low-pass filter, half of the power at ``1 / sqrt(size)`` rad/s, with its lag set back."""
    tau, time, rates = float(np.sqrt(each.size)), each.fine.time, each.fine.block("w")
    out, share = rates.copy(), 1 - np.exp(-(time[1] - time[0]) / tau)
    for k in range(1, len(time)):
        out[k] = out[k - 1] + share * (rates[k] - out[k - 1])
    later = np.minimum(each.time + tau, time[-1])
    passed = np.stack([np.interp(later, time, out[:, axis]) for axis in range(3)], axis=1)
    return passed - each.rates


def _rescale_rates(dataset: Dataset, size: float) -> Dataset:
    """Rates ``size`` times too large: 57.3 for degrees that are read as radians."""
    streams = tuple(replace(stream, values=stream.values * size) for stream in dataset.log.streams)
    return replace(dataset, log=MeasurementLog(streams))


GYRO_FAULTS: Final = (
    ModelFault("gyro-bias", 0.03, OF_GYROS, rates=_bias),
    ModelFault("gyro-drift", 0.03, OF_GYROS, rates=_drifting_bias),
    ModelFault("gyro-scale", 0.05, OF_GYROS, rates=_scale),
    ModelFault("gyro-misalignment", 0.05, OF_GYROS, rates=_misaligned),
    ModelFault("gyro-low-pass", 0.1, OF_GYROS, rates=_low_pass),
    ModelFault("gyro-unit", float(np.degrees(1.0)), OF_GYROS, recording=_rescale_rates),
)


def _drifting(dataset: Dataset, size: float) -> Dataset:
    """The tracked point moves evenly in the body, by ``size`` m over the recording."""
    (stream,) = dataset.log.streams
    since = (stream.time - stream.time[0]) / (stream.time[-1] - stream.time[0])
    direction = matrix_from_quaternion(stream.values[:, 3:7]) @ (AXIS / np.linalg.norm(AXIS))
    values = stream.values.copy()
    values[:, :3] += size * since[:, None] * direction
    return with_stream(dataset, replace(stream, values=values))


POSE_FAULTS: Final = (ModelFault("point-drift", 0.03, (POSE,), recording=_drifting),)


MODEL_FAULTS: Final[tuple[ModelFault, ...]] = (
    *BODY_DISTURBANCES,
    *CAMERA_FAULTS,
    *CLOCK_FAULTS,
    *FRONT_END_FAULTS,
    *GYRO_FAULTS,
    *POSE_FAULTS,
)
"""Every model of a recording that can be wrong."""
STEP = 1e-3
"""Between two views that determine how fast points move, s."""


def model_faults() -> Mapping[str, ModelFault]:
    """All by name."""
    return MappingProxyType({fault.name: fault for fault in MODEL_FAULTS})


def faulty_recording(
    scenario: Scenario, fault: ModelFault, size: float, seeds: tuple[np.random.SeedSequence, ...]
) -> Dataset:
    """A recording with a fault of a size in its unit.

    What is drawn comes from (motion, measurements, faults).
    The motion, the surface and the sensors' noise are drawn alike whatever the fault.
    """
    motion, values, own = seeds
    time, drawn = scenario.interval * np.arange(scenario.epochs), np.random.default_rng(own)
    late = np.zeros(len(time)) if fault.late is None else size * fault.late(time, drawn)
    physics = Physics.of(fault.physics, size)
    fine = faulty_motion(scenario, physics, np.random.default_rng(motion), max(float(late.max()), 0.0))
    truth = motion_at(fine, time)
    dataset = measured(scenario, truth, np.random.default_rng(values))
    if fault.late is not None:
        moved = Motion(truth.layout, time, motion_at(fine, np.maximum(time + late, fine.time[0])).states)
        dataset = replace(dataset, log=measured(scenario, moved, np.random.default_rng(values)).log)
    if fault.seen is not None:
        taken = fault.seen(truth, size, drawn)
        dataset = replace(dataset, log=measured(scenario, taken, np.random.default_rng(values)).log)
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
    points = _place_points(motion_at(fine, stream.time), own)
    later = _place_points(motion_at(fine, stream.time + STEP), own)
    epoch = np.searchsorted(np.unique(stream.time), stream.time)
    return FaultyView(points, (later - points) / STEP, epoch, rig.calibration, size, generator)


def _place_points(motion: Motion, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return motion.block("t") + np.einsum("kij,kj->ki", motion.rotations, points)
