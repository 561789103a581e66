"""True motion over epochs with schedules of its sensors."""

from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float

from observability.bounds.known_inputs import DrivenMotion
from spinfilters.errors import InputError, ShapeError
from spinfilters.models.measurement import MeasurementModel, row_by_row
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.models.sensor_models.camera_landmark import MOVING, with_camera_poses
from spinfilters.symbolic.compiled import Compiled
from spinfilters.symbolic.working_time import building


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
    model: over the layout of the flight.   parameters: (items, p).
    unknown: leading parameters of every item that are unknown constants (3 for landmarks to be mapped).
    seen: (frames, items) which item is measured when.
    camera_poses: (frames, 7) t_ic m and q_ic of a camera that moves on a known trajectory, for a model with
        `spinfilters.models.sensor_models.camera_landmark.MOVING`; None for other models.
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
