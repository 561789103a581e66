"""Trajectory about which a bound linearises, with known torques and known motion of the inspector."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float

from observability.system import Input
from spinfilters.core.attitude_expressions import Expression
from spinfilters.core.compiled import Compiled
from spinfilters.core.errors import InputError, ShapeError
from spinfilters.core.mass_distribution import inertia
from spinfilters.core.working_time import building, built_property
from spinfilters.models.camera_landmarks import MOVING, with_camera_poses
from spinfilters.models.measurement import MeasurementModel, row_by_row
from spinfilters.models.process import TorqueFreeProcess, derivative
from spinfilters.models.rotation_integrator import LinearisedStep
from spinfilters.models.state_layout import StateLayout

SUBSTEP_TURN, SUBSTEPS_OF_A_PERIOD = 0.1, 60
"""Angle in rad and share of a period of the inputs that a substep of Runge-Kutta 4 takes: local errors of some 1e-7 rad."""
MOST_SUBSTEPS = 2000
"""Of one step: beyond it a bound takes minutes."""


@dataclass(frozen=True)
class InputSizes:
    """Amplitudes and period of known inputs in the bound.

    N m and m/s^2, and the period in s of the first (`KnownInput`).
    """

    torque: float = 0.1
    manoeuvre: float = 0.01
    period: float = 20.0


@dataclass(frozen=True)
class KnownInput:
    """Known input size cos(2 pi t / period) along one axis.

    N m or m/s^2, s. Its mean is 0, so that it carries no body away.
    """

    axis: Input
    size: float
    period: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.size) and np.isfinite(self.period) and self.period > 0 and self.size != 0):
            raise InputError(
                f"a known input of size {self.size:g} and period {self.period:g} s; give a finite size that is not 0 and a "
                "positive finite period"
            )

    @property
    def words(self) -> str:
        """It over time, in words."""
        return f"{self.size:g} {self.axis.unit} cos(2 pi t / {self.period:.3g} s)"

    def at(self, time: float) -> float:
        """Its value."""
        return float(self.size * np.cos(2 * np.pi * time / self.period))


@dataclass(frozen=True)
class RecordedInput:
    """Known input along one axis as a table has it, linear between its rows and 0 outside them.

    Attributes
    ----------
    axis : Input
        Which it is.
    time : ndarray of shape (n,)
        Ascending, s.
    values : ndarray of shape (n,)
        N m or m/s^2.
    """

    axis: Input
    time: Float[np.ndarray, " n"]
    values: Float[np.ndarray, " n"]

    def __post_init__(self) -> None:
        if len(self.time) < 2 or not np.all(np.diff(self.time) > 0):
            raise InputError("a known input has at least two rows at ascending times; correct the table")
        if not (np.isfinite(self.time).all() and np.isfinite(self.values).all()):
            raise InputError("a known input has a number that is not finite; correct the table")

    @property
    def period(self) -> float:
        """Of the substeps that follow it, s: each is no longer than the rows are apart."""
        return SUBSTEPS_OF_A_PERIOD * float(np.median(np.diff(self.time)))

    @property
    def words(self) -> str:
        """It over time, in words."""
        low, high = np.min(self.values), np.max(self.values)
        when = f"{len(self.time)} rows from {self.time[0]:g} to {self.time[-1]:g} s"
        return f"{when}, {low:g} to {high:g} {self.axis.unit}"

    @property
    def is_constant(self) -> bool:
        """Whether it has one value only."""
        return bool(np.ptp(self.values) == 0)

    def at(self, time: float) -> float:
        """Its value."""
        return float(np.interp(time, self.time, self.values, left=0.0, right=0.0))


class DrivenMotion:
    """A process with known inputs.

    Their torques make the scale of the inertia one more unknown constant.
    Torques act about axes g, which are the principal axes of a `observability.coordinates` point; an inspector's
    acceleration is the opposite of what it gives the body in frame i. Process noise is that of the free motion.

    Parameters
    ----------
    process : TorqueFreeProcess
        The free motion.
    inputs : Sequence[KnownInput or RecordedInput]
        What acts.
    scale : float
        The inertia in kg m^2 over J(s).
    """

    def __init__(
        self, process: TorqueFreeProcess, inputs: Sequence[KnownInput | RecordedInput], scale: float
    ) -> None:
        self._process, self._inputs, self._scale = process, tuple(inputs), scale
        self.constants = int(any(each.axis.is_torque for each in inputs))

    def step(self, x: Float[np.ndarray, " m"], start: float, dt: float) -> Float[np.ndarray, " m"]:
        """The point ``dt`` s after ``start``, s."""
        for after, _ in self._substeps(x, start, dt):
            x = after
        return x

    def linearise(self, x: Float[np.ndarray, " m"], start: float, dt: float) -> LinearisedStep:
        """The linearised step with the inertia's scale.

        Its transition is by the error of x and, after it, the logarithm of that scale.
        """
        n = self._process.layout.error_dim
        transition, factor = np.eye(n, n + self.constants), self._process.linearise(x, dt).noise_factor
        for after, rows in self._substeps(x, start, dt):
            x, jacobian = after, rows.reshape(n, n + 1)
            transition = jacobian[:, :n] @ transition
            transition[:, n:] += jacobian[:, n : n + self.constants]
        return LinearisedStep(x, transition, factor)

    def _substeps(
        self, x: Float[np.ndarray, " m"], start: float, dt: float
    ) -> Iterator[tuple[Float[np.ndarray, " m"], Float[np.ndarray, " k"]]]:
        """The point after each substep, with the derivatives of its error by that before and by the logarithm of the scale."""
        count = self._count(x, dt)
        h = dt / count
        for k in range(count):
            time = start + k * h
            acting = [self._acting_torque_and_force(time + share * h) for share in (0.0, 0.5, 1.0)]
            x, rows = self._substep(x, *acting, h)
            yield x, rows

    def _count(self, x: Float[np.ndarray, " m"], dt: float) -> int:
        turn = float(np.linalg.norm(x[self._process.layout.mean_slice("w")])) * dt
        shares = [turn / SUBSTEP_TURN, *(SUBSTEPS_OF_A_PERIOD * dt / each.period for each in self._inputs)]
        count = max(1, int(np.ceil(max(shares))))
        if count > MOST_SUBSTEPS:
            raise InputError(
                f"{dt:g} s between frames hold {turn / (2 * np.pi):.3g} turns, too many for a bound with a known input; give a "
                "shorter interval, a slower rate, a smaller torque or a longer period"
            )
        return count

    def _acting_torque_and_force(self, time: float) -> Float[np.ndarray, " 6"]:
        """Torque over the inertia's scale, then the acceleration of the body in frame i."""
        acting = np.zeros(6)
        for each in self._inputs:
            if each.axis.is_torque:
                acting[each.axis.axis] += each.at(time) / self._scale
            else:
                acting[3 + each.axis.axis] -= each.at(time)
        return acting

    @built_property
    def _substep(self) -> Compiled:
        layout = self._process.layout
        x, d, e = ca.SX.sym("x", layout.mean_dim), ca.SX.sym("d", layout.error_dim), ca.SX.sym("e")
        acting, h = [ca.SX.sym(f"u{k}", 6) for k in range(3)], ca.SX.sym("h")
        after = _runge_kutta(layout, x, (*acting, h), 0)
        moved = _runge_kutta(layout, layout.retract_expression(x, d), (*acting, h), e)
        away = layout.near_local_expression(after, moved)
        jacobian = ca.jacobian(away, ca.vertcat(d, e))
        at = ca.substitute(jacobian, ca.vertcat(d, e), ca.SX.zeros(layout.error_dim + 1))
        function = ca.Function("driven", [x, *acting, h], [after, row_by_row(at)], {"cse": True})
        return Compiled.interpreted(function)


def _runge_kutta(
    layout: StateLayout, x: Expression, acting: tuple[Expression, ...], scale: Expression | float
) -> Expression:
    """One step of ``acting``'s last entry, s, under what acts at its beginning, middle and end."""
    first, middle, last, h = acting
    k1 = _rate(layout, x, first, scale)
    k2 = _rate(layout, x + h / 2 * k1, middle, scale)
    k3 = _rate(layout, x + h / 2 * k2, middle, scale)
    k4 = _rate(layout, x + h * k3, last, scale)
    values = layout.unpack(x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
    values["q"] = values["q"] / ca.sqrt(ca.dot(values["q"], values["q"]))
    return layout.pack(values)


def _rate(layout: StateLayout, x: Expression, acting: Expression, scale: Expression | float) -> Expression:
    values, rates = layout.unpack(x), layout.unpack(derivative(layout, x))
    rates["w"] = rates["w"] + ca.exp(-scale) * ca.inv_minor(inertia(values["s"])) @ acting[:3]
    if "v" in rates:
        rates["v"] = rates["v"] + acting[3:]
    return layout.pack(rates)


@dataclass(frozen=True)
class ReferenceTrajectory:
    """True states (n, mean_dim) at ``time`` (n,) s, ascending.

    The motion is of a process, ``driven`` by known inputs, or free.
    """

    process: TorqueFreeProcess
    time: Float[np.ndarray, " n"]
    states: Float[np.ndarray, "n m"]
    driven: DrivenMotion | None = None

    def __post_init__(self) -> None:
        expected = (len(self.time), self.process.layout.mean_dim)
        if self.states.shape != expected or not len(self.time):
            raise ShapeError(
                f"a flight over {len(self.time)} frames has states of shape {expected}, got {self.states.shape}"
            )
        if not (np.isfinite(self.states).all() and np.all(np.diff(self.time) > 0)):
            raise InputError("a flight has finite states at ascending times; leave out frames that repeat")

    @property
    def constants(self) -> int:
        """Unknown constants of the motion outside the state.

        The scale of the inertia where a torque is known.
        """
        return 0 if self.driven is None else self.driven.constants

    def linearise(self, frame: int) -> tuple[Float[np.ndarray, "n k"], Float[np.ndarray, "n q"]]:
        """Transition from the epoch before by state and constants, and noise factor."""
        x, start = self.states[frame - 1], float(self.time[frame - 1])
        dt = float(self.time[frame] - self.time[frame - 1])
        if self.driven is None:
            return self.process.linearise(x, dt)[1:]
        return self.driven.linearise(x, start, dt)[1:]


def free_reference(
    process: TorqueFreeProcess, start: Float[np.ndarray, " m"], frames: int, interval: float
) -> ReferenceTrajectory:
    """The motion without disturbances from a state, at equal intervals in s."""
    if frames < 1:
        raise InputError(f"a flight of {frames} frames; give at least 1")
    states = [start]
    for _ in range(frames - 1):
        states.append(process.step(states[-1], interval))
    return ReferenceTrajectory(process, interval * np.arange(frames), np.stack(states))


def driven_reference(
    process: TorqueFreeProcess,
    start: Float[np.ndarray, " m"],
    time: Float[np.ndarray, " n"],
    driven: DrivenMotion,
) -> ReferenceTrajectory:
    """The motion under known inputs from a state, at these times in s."""
    states = [start]
    for begin, end in pairwise(time.tolist()):
        states.append(driven.step(states[-1], begin, end - begin))
    return ReferenceTrajectory(process, time, np.stack(states), driven)


@dataclass(frozen=True)
class SensorSchedule:
    """One sensor over a flight.

    Attributes
    ----------
    model : MeasurementModel
        Over the layout of the flight.
    parameters : ndarray of shape (items, p)
    unknown : int
        Leading parameters of every item that are unknown constants (3 for landmarks to be mapped).
    seen : ndarray of shape (frames, items)
        Which item is measured when.
    camera_poses : ndarray of shape (frames, 7) or None
        (frames, 7) t_ic m and q_ic of a camera that moves on a known trajectory, for a model with
        `spinfilters.models.camera_landmarks.MOVING`; None for other models.
    """

    model: MeasurementModel
    parameters: Float[np.ndarray, "items p"]
    unknown: int
    seen: Bool[np.ndarray, "frames items"]
    camera_poses: Float[np.ndarray, "frames 7"] | None = None

    def __post_init__(self) -> None:
        items = len(self.parameters)
        if self.camera_poses is not None and self.camera_poses.shape != (
            len(self.seen),
            MOVING.parameter_dim,
        ):
            raise ShapeError(
                f"a camera over {len(self.seen)} frames has poses (frames, 7), got {self.camera_poses.shape}"
            )
        moving = 0 if self.camera_poses is None else MOVING.parameter_dim
        width = self.model.parameter_dim - moving
        if self.parameters.shape != (items, width) or self.seen.shape[1:] != (items,):
            raise ShapeError(
                f"{self.model.name} takes parameters (items, {width}) and seen (frames, items), got "
                f"{self.parameters.shape} and {self.seen.shape}"
            )
        if not self.seen.any():
            raise InputError(
                f"{self.model.name} measures nothing over the whole flight; give frames in which it sees something"
            )

    def at(self, frame: int) -> Float[np.ndarray, "items p"]:
        """Parameters of all items in a frame."""
        if self.camera_poses is None:
            return self.parameters
        poses = np.tile(self.camera_poses[frame], (len(self.parameters), 1))
        return with_camera_poses(self.parameters, poses)

    @property
    def own(self) -> int:
        """Unknowns that this sensor adds."""
        return self.unknown * len(self.parameters)


def rows_at(
    schedule: SensorSchedule, frame: int, x: Float[np.ndarray, " m"], start: int, total: int
) -> Float[np.ndarray, "k n"]:
    """Whitened derivatives of an epoch's measurements.

    Columns: the state's error and, from ``start`` on, the sensor's unknowns.
    """
    items = np.flatnonzero(schedule.seen[frame])
    columns, dim, unknown = schedule.model.columns, schedule.model.dim, schedule.unknown
    rows = np.zeros((len(items), dim, total))
    if len(items):
        by_state, by_own = derivatives(schedule.model, unknown)(x, schedule.at(frame)[items])
        rows[:, :, columns] = by_state.reshape(len(items), dim, len(columns))
        for k, item in enumerate(items if unknown else ()):
            at = start + item * unknown
            rows[k, :, at : at + unknown] = by_own[k].reshape(dim, unknown)
    return rows.reshape(-1, total)


@cache
@building()
def derivatives(model: MeasurementModel, unknown: int) -> Compiled:
    """(x, p) -> whitened derivatives of the innovation's negative.

    They are by the model's columns and by the leading parameters.
    """
    layout = model.layout
    x, p = ca.SX.sym("x", layout.mean_dim), ca.SX.sym("p", model.parameter_dim)
    d, e = ca.SX.sym("d", layout.error_dim), ca.SX.sym("e", unknown)
    moved = layout.unpack(layout.retract_expression(x, d))
    expected = model.symbolic(moved, ca.vertcat(p[:unknown] + e, p[unknown:]))
    measured = model.symbolic(layout.unpack(x), p)
    away = model.innovation(expected, measured)
    jacobian = [-ca.jacobian(away, d)[:, model.columns], -ca.jacobian(away, e)]
    zero = [ca.SX.zeros(*d.shape), ca.SX.zeros(*e.shape)]
    whitening = ca.solve(ca.SX(model.noise_factor(layout.unpack(x), p)), ca.SX.eye(model.dim))
    at = [row_by_row(whitening @ slope) for slope in ca.substitute(jacobian, [d, e], zero)]
    return Compiled(ca.Function(f"{model.name}_bound_{unknown}", [x, p], at))
