"""Right-hand sides of model errors about a smoothed motion."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Final, NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.polynomial.legendre import legvander

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.camera_trajectory import Displacement
from spinfilters.core.compiled import Compiled
from spinfilters.core.mass_distribution import inertia_matrix
from spinfilters.core.working_time import building
from spinfilters.io.consider_parameter import ConsiderParameter
from spinfilters.io.sensor_format import sensor_format
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.process import derivative
from spinfilters.models.state_blocks import (
    ACCELERATION,
    ATTITUDE,
    CENTRE_OF_MASS,
    MASS_DISTRIBUTION,
    POSITION,
    RATE,
)
from spinfilters.models.state_blocks import VELOCITY as CENTRE_VELOCITY
from spinfilters.models.state_layout import StateLayout
from spinfilters.verdict.model_errors.linear_rows import Columns, LinearRows

CALIBRATION: Final = 3
"""First parameter of a camera's calibration (fx, fy, cx, cy px, of a pair the baseline m): the point stands before it."""
U, V, RIGHT = 0, 1, 2
"""Components of an observation: pixels of the (left) camera, column of the right one."""


class ImageCoordinates(NamedTuple):
    """Image coordinates about the principal point over the focal length, and that length (px), by component."""

    xy: Float[np.ndarray, "r i"]
    focal: Float[np.ndarray, "r i"]


@dataclass(frozen=True)
class MeasuredRows:
    """Measurements by one model, with what a shift of them needs.

    Attributes
    ----------
    sensor : int or None
        Number in `Motion.sensors`, or None of observations of unknown landmarks.
    rows : (r,) int array
        Of these observations.
    epoch : (r,) int array
        (r,).
    states : (r, m) float array
        (r, m).
    parameters : (r, p) float array
        The landmark's point first where there is one.
    whitening : (r, i, i) float array
        Zero of what does not count.
    change : (r, i) float array
        Of the whitened expected values by time, 1/s.
    """

    model: MeasurementModel
    sensor: int | None
    rows: Int[np.ndarray, " r"]
    epoch: Int[np.ndarray, " r"]
    states: Float[np.ndarray, "r m"]
    parameters: Float[np.ndarray, "r p"]
    whitening: Float[np.ndarray, "r i i"]
    change: Float[np.ndarray, "r i"]

    @cached_property
    def image(self) -> ImageCoordinates:
        """Expected pixels of observations as coordinates of the image."""
        pixels, calibration = (
            self.model.predict(self.states, self.parameters),
            self.parameters[:, CALIBRATION:],
        )
        columns = [U, V, U][: pixels.shape[1]]
        # calibration fx, fy, cx, cy: of each component the focal length and the principal point
        focal = np.stack([calibration[:, k] for k in columns], axis=1)
        centre = np.stack([calibration[:, 2 + k] for k in columns], axis=1)
        return ImageCoordinates((pixels - centre) / focal, focal)

    def whitened(self, shift: Float[np.ndarray, "r i m"]) -> Float[np.ndarray, "r i m"]:
        """W d of shifts d of the innovations, number by number: products of thousands of small matrices take longer."""
        found = np.zeros_like(shift)
        for i, j in self._entries:
            own = np.ascontiguousarray(self.whitening[:, i, j])
            for m in range(shift.shape[2]):
                found[:, i, m] += own * shift[:, j, m]
        return found

    @cached_property
    def _entries(self) -> list[tuple[int, int]]:
        """Rows and columns of the whitening that are not zero in all measurements."""
        return [(int(i), int(j)) for i, j in np.argwhere(self.whitening.any(axis=0))]

    def by_calibration(self, parameter: ConsiderParameter) -> Float[np.ndarray, "r i e"] | None:
        """Change of the innovations per unit of a calibration error; None for an error of another sensor."""
        if parameter.moved is None or self.model.name not in parameter.sensors:
            return None
        return self.model.by_error(parameter.moved, parameter.size, self.states, self.parameters)


STEADY: Final = 0.05
"""Root mean square angle of the rates to their mean direction in the body, rad: below it they spin about one axis."""
SLOW_TORQUE, SLOW_RATE = 2, 3
"""Degrees in time of slow changes of a torque, and of the rates that a gyro reads."""
LEAST_SLOW: Final = 1e-6
"""Singular value of such changes relative to the largest, below which they are the same as others."""

Shift = Callable[[MeasuredRows], Float[np.ndarray, "r i m"] | None]
"""Change of the innovations of measurements per unit of m errors; None of those that the error is not of."""


def centred_time(time: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Times scaled so that they go from -1 to 1."""
    return 2 * (time - time[0]) / (time[-1] - time[0]) - 1


class _WhitenedShift(NamedTuple):
    """Measurements, and the change of their whitened innovations per unit of m errors."""

    measured: MeasuredRows
    shift: Float[np.ndarray, "r i m"]


@dataclass(frozen=True)
class SmoothedMotion:
    """The most probable motion of some epochs about which everything is linearised.

    Attributes
    ----------
    time : (k,) float array
        Time, s.
    rows : LinearRows
        Of the linear problem.
    has_common_map : bool
        Whether poses have errors in common: those of a map of the body that all were registered to.
    """

    time: Float[np.ndarray, " k"]
    rows: LinearRows
    has_common_map: bool = False

    def block(self, name: str) -> Float[np.ndarray, "k b"]:
        """Points of a state block at every epoch."""
        return self.rows.here.trajectory[:, self.rows.problem.layout.mean_slice(name)]

    @property
    def translates(self) -> bool:
        """Whether the state has a place."""
        return self.rows.problem.layout.translates

    @cached_property
    def rates(self) -> Float[np.ndarray, "k 3"]:
        """Body rates, g axes, rad/s."""
        return self.block(RATE.name)

    @cached_property
    def inertia(self) -> Float[np.ndarray, "3 3"]:
        """Inertia up to scale, g axes."""
        return inertia_matrix(self.block(MASS_DISTRIBUTION.name)[0])

    @cached_property
    def rate_change(self) -> Float[np.ndarray, "k 3"]:
        """w' without disturbances, rad/s^2: of the body with what the state holds of drag, torque and a flywheel."""
        return self.change[:, self.rows.problem.layout.slice(RATE.name)]

    @cached_property
    def change(self) -> Float[np.ndarray, "k n"]:
        """Derivative of the state's error by time, components in the order of the layout, 1/s."""
        layout = self.rows.problem.layout
        by_time = _derivative(layout)(self.rows.here.trajectory)[0]
        found = np.zeros((len(self.time), layout.error_dim))
        found[:, layout.slice(ATTITUDE.name)] = self.rates
        for name in (RATE.name, *((POSITION.name, CENTRE_VELOCITY.name) if self.translates else ())):
            found[:, layout.slice(name)] = by_time[:, layout.mean_slice(name)]
        return found

    def disturbed(
        self,
        angular: Float[np.ndarray, "k 3 m"] | None = None,
        linear: Float[np.ndarray, "k 3 m"] | None = None,
    ) -> Columns:
        """Right-hand sides of angular (g axes) and linear (centre of mass, i axes) accelerations per unit of m errors.

        Each step takes half of it before and half of it after, which is enough for a direction to test.
        """
        layout = self.rows.problem.layout
        given = [(RATE.name, angular), (CENTRE_VELOCITY.name, linear)]
        count = next(each.shape[2] for _, each in given if each is not None)
        kicks = np.zeros((len(self.time), layout.error_dim, count))
        for name, each in given:
            if each is not None:
                kicks[:, layout.slice(name)] = each
        return self._drive_states(kicks)

    def longer(self) -> Columns:
        """Right-hand sides of taking all durations for longer, per unit of their relative error."""
        return self._drive_states(-self.change[:, :, None])

    def scaling(self, measured: Columns) -> Columns:
        """Right-hand sides of a unit of length: what disturbs the motion is read in it, too.

        A unit that is wrong by e makes the estimated motion larger by e, with all that disturbs it, and its residuals are as many
        deviations as the disturbances were. Held to the densities, such residuals would always be least of a motion without any:
        the score of the unit would be minus their squares, whose expectation is not zero but minus their redundancy. So the
        densities move with the unit. With `a` the states per unit of scale, about the place of the first pose,

            a: t_k - R_k R_0' t_0,  v,  c + R_0' t_0,  f,      H_steps = -J_steps a,

        which leaves every step as it is along (e, a e). Lengths other than the motion's own then determine the unit, such as the
        path of an inspector.

        Parameters
        ----------
        measured : Columns
            One column, the change of the whitened innovations per unit of scale.
        """
        layout, dynamics = self.rows.problem.layout, self.rows.here.dynamics.rows
        ordering, states = self.rows.problem.ordering, np.zeros((len(self.time), layout.error_dim, 1))
        place, turned = self.block(POSITION.name), matrix_from_quaternion(self.block(ATTITUDE.name))
        first = turned[0].T @ place[0]  # in g: the origin of a g that the scale leaves at the first pose
        states[:, layout.slice(POSITION.name), 0] = place - turned @ first
        states[:, layout.slice(CENTRE_VELOCITY.name), 0] = self.block(CENTRE_VELOCITY.name)
        states[:, layout.slice(CENTRE_OF_MASS.name), 0] = self.block(CENTRE_OF_MASS.name) + first
        if layout.has(ACCELERATION):
            states[:, layout.slice(ACCELERATION.name), 0] = self.block(ACCELERATION.name)
        d, moving = len(ordering.moving), states[:, ordering.moving]
        steps = -(dynamics[:, :, :d] @ moving[:-1] + dynamics[:, :, d : 2 * d] @ moving[1:])
        steps -= dynamics[:, :, 2 * d : -1] @ states[0, ordering.constant]
        return replace(measured, steps=measured.steps + steps)

    def _drive_states(self, change: Float[np.ndarray, "k n m"]) -> Columns:
        """Right-hand sides of time derivatives of the state, 1/s per unit, components in the order of the layout."""
        ordering, rows, count = self.rows.problem.ordering, self.rows.here.dynamics.rows, change.shape[2]
        kicks, d = change[:, ordering.moving], len(ordering.moving)
        half = np.diff(self.time)[:, None, None] / 2
        steps = half * (rows[:, :, :d] @ kicks[:-1] - rows[:, :, d : 2 * d] @ kicks[1:])
        nothing = self.rows.nothing(count, is_measured=False)
        return replace(nothing, steps=steps)

    def kicks_of_steps(self, kicks: Float[np.ndarray, "k n m"]) -> Float[np.ndarray, "j d m"]:
        """Whitened rows of every step by kicks of the state at its end, components in the order of the layout."""
        ordering, rows = self.rows.problem.ordering, self.rows.here.dynamics.rows
        d = len(ordering.moving)
        return -rows[:, :, d : 2 * d] @ kicks[1:, ordering.moving]

    def kicked(self, kick: Float[np.ndarray, "n m"], step: int) -> Columns:
        """Right-hand sides of a kick at the end of a step, as later measurements see it.

        For the solution the same as the kick itself: M J = 0.
        """
        ordering, transitions = self.rows.problem.ordering, self._transitions
        d, states = len(ordering.moving), np.zeros((len(self.time), len(ordering.order), kick.shape[1]))
        states[step + 1, :d] = kick[ordering.moving]
        for k in range(step + 1, len(self.time) - 1):
            states[k + 1, :d] = transitions[k] @ states[k, :d]
        return self.rows.seen(states)

    @cached_property
    def _transitions(self) -> Float[np.ndarray, "j d d"]:
        """Of the errors of moving components over every step."""
        rows, d = self.rows.here.dynamics.rows, len(self.rows.problem.ordering.moving)
        return -np.linalg.solve(rows[:, :, d : 2 * d], rows[:, :, :d])

    def shifted(self, shift: Shift) -> Columns | None:
        """Right-hand sides of errors of measurements; None where no measurement has them."""
        found = [(each, shift(each)) for each in self.measured]
        made = [_WhitenedShift(each, each.whitened(by)) for each, by in found if by is not None]
        return self._place_columns(made) if made else None

    def in_time(self, late: Callable[[MeasurementModel], Float[np.ndarray, "k m"]]) -> Columns | None:
        """Right-hand sides of measurements ``late`` s later than stamped, per unit of m errors, by epoch."""
        if not self.measured:
            return None
        sensors, count = self.rows.problem.motion.sensors, late(self.measured[0].model).shape[1]
        errors = [self.change[:, s.model.columns, None] * late(s.model)[:, None] for s in sensors]
        observed = None
        if self.rows.observation_rows is not None:
            observed = np.zeros((len(self.rows.observation_rows), 3, count))
            for each in self.measured:
                if each.sensor is None:
                    own = each.change[:, :, None] * late(each.model)[each.epoch, None]
                    observed[each.rows, : own.shape[1]] = own
        return self.rows.seen_by(errors, observed, count)

    def _place_columns(self, made: list[_WhitenedShift]) -> Columns:
        rows, count = self.rows, made[0].shift.shape[2]
        by_sensor = {each.sensor: whitened for each, whitened in made if each.sensor is not None}
        sensors = tuple(
            by_sensor[k] if k in by_sensor else np.zeros((*own.shape[:2], count))
            for k, own in enumerate(rows.sensor_rows)
        )
        found = replace(rows.nothing(count, is_measured=False), sensors=sensors, seen=(), is_measured=True)
        for each, whitened in made:
            if each.sensor is None and found.observations is not None:
                found.observations[each.rows, : whitened.shape[1]] = whitened
        return found

    @cached_property
    def slow_changes(self) -> Float[np.ndarray, "r s"] | None:
        """Orthonormal residuals that slow changes of torque and gyro explain in a spin about one axis.

        Columns of whitened residuals; None of another motion, or without a gyro. With constant rates every error of the motion
        is a slow torque, and a slow torque looks like a slow bias.
        """
        read = self.shifted(lambda each: self._slow(SLOW_RATE)[each.epoch] if each.model.reads_rate else None)
        if read is None or not is_steady(self.rates):
            return None
        return self._basis_of(Columns.joined([read, self.disturbed(angular=self._slow(SLOW_TORQUE))]))

    @cached_property
    def map_changes(self) -> Float[np.ndarray, "r s"] | None:
        """Orthonormal residuals that errors of a map explain which poses were registered to; None without one.

        Scans of alike views are registered to the same part of the map, and what that part is shifted and turned by they are, too.
        So shift and rotation, g axes, are polynomials of second degree of the direction in which the body is seen. A constant one
        is none, for frame g is that of the map.
        """
        if not (self.has_common_map and self.translates):
            return None
        R, place = matrix_from_quaternion(self.block(ATTITUDE.name)), self.block(POSITION.name)
        seen = np.einsum("kji,kj->ki", R, place / np.linalg.norm(place, axis=1, keepdims=True))
        x, y, z = seen.T
        changes = np.column_stack([seen, x * y, x * z, y * z, x**2 - y**2, z**2 - 1 / 3])

        def shift(each: MeasuredRows) -> Float[np.ndarray, "r i m"] | None:
            """Change of the innovations, shifts before rotations; None of what is no pose."""
            if not sensor_format(each.model.name).quaternion:
                return None
            by, found = (
                changes[each.epoch],
                np.zeros((2, len(each.epoch), each.model.dim, 3 * changes.shape[1])),
            )
            found[0, :, :3] = np.einsum("rm,rij->rimj", by, R[each.epoch]).reshape(len(by), 3, -1)
            found[1, :, 3:6] = np.einsum("rm,ij->rimj", by, np.eye(3)).reshape(len(by), 3, -1)
            return np.concatenate(list(found), axis=2)

        columns = self.shifted(shift)
        return None if columns is None else self._basis_of(columns)

    def _basis_of(self, columns: Columns) -> Float[np.ndarray, "r s"] | None:
        """Orthonormal residuals that right-hand sides leave; None where they are not finite."""
        every = self.rows.residual(columns)
        flattened = np.concatenate([part.reshape(-1, every.count) for part in every.parts])
        size = np.linalg.norm(flattened, axis=0)
        if not np.isfinite(flattened).all():
            return None
        basis, values, _ = np.linalg.svd(flattened / np.where(size > 0, size, 1.0), full_matrices=False)
        return basis[:, values > LEAST_SLOW * values.max(initial=0.0)]

    def _slow(self, degree: int) -> Float[np.ndarray, "k 3 s"]:
        """Polynomials of time up to a degree, for every axis."""
        return np.kron(legvander(centred_time(self.time), degree)[:, None], np.eye(3))

    @cached_property
    def measured(self) -> tuple[MeasuredRows, ...]:
        """Measurements of every sensor, and observations of unknown landmarks."""
        return (*self._of_sensors(), *self._of_landmarks())

    def _of_sensors(self) -> list[MeasuredRows]:
        found, rows = [], self.rows
        for k, (sensor, made) in enumerate(zip(rows.problem.motion.sensors, rows.by_epoch, strict=True)):
            x = rows.here.trajectory[sensor.epoch]
            whitening = sensor.model.whitening(x, sensor.parameters)
            if sensor.scale is not None:
                whitening = whitening / sensor.scale[:, None]
            whitening[np.flatnonzero(~rows.counted[k])] = 0.0
            change = made.products(self.change[:, sensor.model.columns, None])[:, :, 0]
            every = np.arange(len(x))
            found.append(
                MeasuredRows(*(sensor.model, k, every, sensor.epoch, x, sensor.parameters, whitening, change))
            )
        return found

    def _of_landmarks(self) -> list[MeasuredRows]:
        observations, made = self.rows.problem.observations, self.rows.observation_rows
        fit = self.rows.normal.eliminated
        if observations is None or made is None or fit is None:
            return []
        found, here = [], self.rows.here
        weight = np.where(fit.used, np.sqrt(fit.weight), 0.0) / observations.scale
        for group in observations.groups:
            epoch = observations.epoch[group.rows]
            points, x = here.points[observations.landmark[group.rows]], here.trajectory[epoch]
            parameters = np.concatenate([points, group.parameters], axis=1)
            change = np.einsum("rin,rn->ri", made[group.rows, : group.model.dim, :6], self.change[epoch, :6])
            whitening = group.model.whitening(x, parameters) * weight[group.rows, None, None]
            found.append(MeasuredRows(group.model, None, group.rows, epoch, x, parameters, whitening, change))
        return found


def is_steady(rates: Float[np.ndarray, "k 3"]) -> bool:
    """Whether body rates (rad/s) keep their direction in the body, within `STEADY`."""
    direction = rates / np.linalg.norm(rates, axis=1, keepdims=True)
    mean = direction.mean(axis=0)
    across = 1 - (direction @ mean) ** 2 / (mean @ mean)
    return bool(across.mean() < STEADY**2)


@cache
@building()
def _derivative(layout: StateLayout) -> Compiled:
    """Time derivative of a state without noise.

    Interpreted, for it is called a few times in a run.
    """
    x = ca.SX.sym("x", layout.mean_dim)
    return Compiled.interpreted(ca.Function("change", [x], [derivative(layout, x)]))


@dataclass(frozen=True)
class KnownCamera:
    """Known poses of the camera at the epochs in which it sees landmarks.

    Attributes
    ----------
    seen : (k,)
        Whether it has measurements in an epoch.
    poses : (k, 7)
        t_ic m and q_ic, the identity of a camera at rest and where it sees nothing.
    moves : bool
        Whether a trajectory is given (`inspector.tum`).
    """

    seen: Bool[np.ndarray, " k"]
    poses: Float[np.ndarray, "k 7"]
    moves: bool

    @classmethod
    def of(cls, motion: SmoothedMotion) -> "KnownCamera | None":
        """The camera of a motion; None where none sees it in two epochs, or nothing determines the place."""
        rows = [each for each in motion.measured if _is_of_camera(each)]
        if not rows or not motion.translates:
            return None
        seen, poses = np.zeros(len(motion.time), dtype=bool), np.zeros((len(motion.time), 7))
        poses[:, 6] = 1.0
        moves = False
        for each in rows:
            seen[each.epoch] = True
            if each.model.known_pose is not None:
                moves = True
                poses[each.epoch] = each.parameters[:, each.model.known_pose]
        return cls(seen, poses, moves) if np.count_nonzero(seen) > 1 else None


def displaced_camera(motion: SmoothedMotion, by: Displacement, camera: KnownCamera) -> Columns:
    """Right-hand sides of a camera that stands displaced from its known poses, per unit of m errors."""
    layout, ordering = motion.rows.problem.layout, motion.rows.problem.ordering
    own = by(motion.time[camera.seen], camera.poses[camera.seen])
    moved = np.zeros((len(motion.time), 6, own.shape[2]))
    moved[camera.seen] = own
    R_ic = matrix_from_quaternion(camera.poses[:, 3:])
    R_ig = matrix_from_quaternion(motion.block(ATTITUDE.name))
    away = motion.block(POSITION.name) - camera.poses[:, :3]
    turned = R_ic @ moved[:, 3:]  # axes i
    states = np.zeros((len(motion.time), layout.error_dim, own.shape[2]))
    states[:, layout.slice(POSITION.name)] = -moved[:, :3] - np.cross(turned, away[:, :, None], axis=1)
    states[:, layout.slice(ATTITUDE.name)] = -np.swapaxes(R_ig, 1, 2) @ turned
    found = motion.rows.seen(states[:, ordering.order])
    for each in motion.measured:  # sensors other than the camera are not displaced with it
        if each.sensor is not None and not _is_of_camera(each):
            found.seen[each.sensor].errors[:] = 0.0
    return found


def _is_of_camera(each: MeasuredRows) -> bool:
    return each.model.images > 0
