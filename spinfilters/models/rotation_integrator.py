"""Integration of the rotation over a step: substeps of attitude and body rate, and the linearised step."""

import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from math import hypot
from sys import float_info
from typing import Final, NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.attitude_expressions import (
    Expression,
    conjugate,
    normalised,
    product,
    quaternion_from_mrp,
    quaternion_rate,
    rotate,
    short_mrp_from_quaternion,
)
from spinfilters.core.compiled import Compiled
from spinfilters.core.errors import InputError, SpinfiltersError
from spinfilters.core.mass_distribution import inertia_from_entries
from spinfilters.core.vectorised import VectorisedScan
from spinfilters.core.working_time import building, built_property
from spinfilters.io.disturbances import DISTURBANCES, WHITE_FORCE, WHITE_TORQUE, noise_columns, noise_dim
from spinfilters.models.state_blocks import ACCELERATION, DRAG, LINEAR_DRAG, MASS_DISTRIBUTION, ROTOR, TORQUE
from spinfilters.models.state_layout import Places, StateLayout, entries_of


class LinearisedStep(NamedTuple):
    """A step of a motion to first order in its errors.

    Attributes
    ----------
    after : Float[np.ndarray, ' m']
        (m,) the point at its end.
    transition : Float[np.ndarray, 'n c']
        (n, n) of the multiplicative error, or (n, n + constants).
    noise_factor : Float[np.ndarray, 'n q']
        (n, q) G of the noise covariance Q = G G'.
    """

    after: Float[np.ndarray, " m"]
    transition: Float[np.ndarray, "n c"]
    noise_factor: Float[np.ndarray, "n q"]


class LinearisedSteps(NamedTuple):
    """k steps to first order in their errors: e_there = defect + transition e_here + noise_factor n.

    Attributes
    ----------
    defect : Float[np.ndarray, 'k n']
        (k, n) error that takes ``there`` to the end of the step from ``here``.
    transition : Float[np.ndarray, 'k n n']
        (k, n, n).
    noise_factor : Float[np.ndarray, 'k n q']
        (k, n, q), of unit noise.
    """

    defect: Float[np.ndarray, "k n"]
    transition: Float[np.ndarray, "k n n"]
    noise_factor: Float[np.ndarray, "k n q"]


Acceleration = Callable[..., Expression]
"""w' from the rate, the inertia (3 x 3) and, by the names of `ACCELERATION_TERMS`, the constants
that the state has; None for others."""
ACCELERATION_TERMS: Final = {"drag": DRAG, "torque": TORQUE, "rotor": ROTOR, "linear_drag": LINEAR_DRAG}
"""Optional terms of Euler's equation: the argument of `spinfilters.models.process.body_acceleration` and its state block."""


def acceleration_constants(state: Mapping[str, Expression]) -> dict[str, Expression | None]:
    """Arguments of the `ACCELERATION_TERMS` from a state; None for what it does not hold."""
    return {term: state.get(block.symbol) for term, block in ACCELERATION_TERMS.items()}


def runge_kutta_step(rate: Callable[[Expression], Expression], y: Expression, h: Expression) -> Expression:
    """y after h of y' = rate(y), by a step of Runge-Kutta 4."""
    k1 = rate(y)
    k2 = rate(y + h / 2 * k1)
    k3 = rate(y + h / 2 * k2)
    k4 = rate(y + h * k3)
    return y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


SHARED = {"cse": True}
"""Expressions that occur again are evaluated once, to the same bits."""


class RotationSubsteps:
    """Steps of a state whose rotation follows ``acceleration``, as functions of the number of substeps.

    Parameters
    ----------
    layout : StateLayout
        Blocks of the state; the acceleration may use the constants that have `RotationParameters`.
    acceleration : Acceleration
        w' in g axes, rad/s^2.
    """

    def __init__(self, layout: StateLayout, acceleration: Acceleration) -> None:
        self._layout = layout
        self._acceleration = acceleration
        self._parameters = rotation_parameter_slices(layout)
        self._parameter_count = max(at.stop for at in self._parameters.values())

    def step(self, count: int) -> ca.Function:
        """(x, dt) to (the point after dt in ``count`` substeps, an estimate of its error)."""
        x, dt = ca.MX.sym("x", self._layout.mean_dim), ca.MX.sym("dt")
        values = self._layout.unpack(x)
        rotation, error = self._rotation(values, dt, count)
        after = self.translated(values, rotation[:4], rotation[4:7], dt)
        return ca.Function(f"step_{count}", [x, dt], [after, error], ["x", "dt"], ["after", "error"])

    def _rotation(
        self, values: dict[str, Expression], dt: Expression, count: int
    ) -> tuple[Expression, Expression]:
        """(q, w) after dt in ``count`` substeps, and an estimate of its error by step doubling."""
        constants, start = rotation_parameters(self._layout, values), ca.vertcat(values["q"], values["w"])
        fine = _repeat(self.substep(), count, start, constants, dt / count)
        coarse = _repeat(self.substep(), count // 2, start, constants, 2 * dt / count)
        return fine, rotation_difference(coarse, fine) / 15

    def step_constants(self) -> ca.Function:
        """x to the constants of its rotation, in the matrices of `step`, whose products scalars would sum in another order."""
        x = ca.MX.sym("x", self._layout.mean_dim)
        constants = rotation_parameters(self._layout, self._layout.unpack(x))
        return ca.Function("step_constants", [x], [constants])

    def step_scan(self) -> VectorisedScan:
        """Substeps of many points side by side, to the bits of `step`.

        Inputs: points, the constants of their rotation, and of all of them dt and the duration h of a substep. Outputs: the points
        after dt, and their rotation (q, w). A turn for every substep, without numbers of its own.
        """
        x, p = ca.SX.sym("x", self._layout.mean_dim), ca.SX.sym("p", self._parameter_count)
        dt, h, y, none = ca.SX.sym("dt"), ca.SX.sym("h"), ca.SX.sym("y", 7), ca.SX.sym("none")
        values, substep = self._layout.unpack(x), self.substep()
        moved = self.translated(values, y[:4], y[4:7], dt)
        return VectorisedScan(
            ca.Function("begin", [x, p, dt, h], [ca.vertcat(values["q"], values["w"]), p, h]),
            ca.Function("step_substeps", [y, p, h, none], [substep(y, p, h)]),
            ca.Function("end", [x, p, dt, h, y], [moved, y]),
        )

    def linearised_scan(self) -> "LinearisedScan":
        """`linearised_step` of many points side by side, to rounding.

        Inputs: points, and of each dt and the duration h of a substep; densities. A turn for every substep, with the
        `substep_numbers`. Outputs: the points after dt, errors, and the entries of transition and noise factor.
        """
        x, dt, h = ca.SX.sym("x", self._layout.mean_dim), ca.SX.sym("dt"), ca.SX.sym("h")
        psd, n = ca.SX.sym("psd", len(DISTURBANCES)), self._parameter_count
        values = self._layout.unpack(x)
        rotation, rest = ca.vertcat(values["q"], values["w"]), ca.SX.zeros(6 * n + 36)
        state, p = ca.SX.sym("state", 7 + 7 + 36 + 6 * n + 36), ca.SX.sym("p", n)
        numbers = ca.SX.sym("numbers", 2)
        coarse, sums = ca.vertsplit(state, [0, 7, state.numel()])
        turn = ca.vertcat(
            self.substep()(coarse, p, numbers[1] * h), self.linear_substep(sums, p, h, numbers[0])
        )
        last = ca.diagcat(ca.DM.zeros(3, 3), ca.DM.eye(3)) * h * boole_weights(FEWEST)[-1]
        noise = ca.reshape(sums[-36:], 6, 6) + last
        after, transition, factor = self.assemble(x, dt, psd, sums[:-36], noise)
        error = rotation_difference(coarse, sums[:7]) / 15
        made = [after, error, entries_of(transition), entries_of(factor)]
        parameters = rotation_parameters(self._layout, values)
        scan = VectorisedScan(
            ca.Function(
                "begin_linear",
                [x, dt, h, psd],
                [ca.densify(ca.vertcat(rotation, rotation, ca.SX.eye(6)[:], rest)), parameters, h],
            ),
            ca.Function("linear_substeps", [state, p, h, numbers], [turn]),
            ca.Function("end_linear", [x, dt, h, psd, state], [ca.densify(each) for each in made]),
        )
        moved = [
            i
            for i in range(transition.shape[0])
            if not (transition[i, :].nnz() == 1 and transition[i, i].is_one() and factor[i, :].nnz() == 0)
        ]
        return LinearisedScan(scan, 1 + max(moved), Places.of(transition), Places.of(factor))

    def step_error(self) -> ca.Function:
        """(q, w) after coarse and fine substeps to the estimate of the latter's error."""
        coarse, fine = ca.SX.sym("coarse", 7), ca.SX.sym("fine", 7)
        return ca.Function("step_error", [coarse, fine], [rotation_difference(coarse, fine) / 15])

    def substep(self) -> ca.Function:
        """One substep of Runge-Kutta 4 as a function."""
        y, p, h = ca.SX.sym("y", 7), ca.SX.sym("p", self._parameter_count), ca.SX.sym("h")
        return ca.Function("substep", [y, p, h], [self._runge_kutta(y, p, h)], SHARED)

    def _runge_kutta(self, y: Expression, p: Expression, h: Expression) -> Expression:
        after = runge_kutta_step(lambda at: self._rotation_rate(at, p), y, h)
        return ca.vertcat(normalised(after[:4]), after[4:7])

    def _rotation_rate(self, y: Expression, p: Expression) -> Expression:
        J = inertia_from_entries(p[self._parameters[MASS_DISTRIBUTION.name]])
        constants = {
            term: p[self._parameters[block.name]] if self._layout.has(block) else None
            for term, block in ACCELERATION_TERMS.items()
        }
        return ca.vertcat(quaternion_rate(y[:4], y[4:7]), self._acceleration(y[4:7], J, **constants))

    def translated(
        self, values: dict[str, Expression], q: Expression, w: Expression, dt: Expression
    ) -> Expression:
        """State after dt: r = t + R c moves with v, v with f.

        Filters, smoother and simulation take the motion of the centre of mass from here; `spinfilters.models.process.derivative`
        holds the same terms for the verdict and the observability analyser.
        """
        after = dict(values) | {"q": q, "w": w}
        if self._layout.translates:
            centre = values["t"] + rotate(values["q"], values["c"]) + dt * values["v"]
            if self._layout.has(ACCELERATION):
                centre = centre + dt**2 / 2 * values["f"]
                after["v"] = values["v"] + dt * values["f"]
            after["t"] = centre - rotate(q, values["c"])
        return self._layout.pack(after)

    def linearised_step(self, count: int) -> ca.Function:
        """(x, dt, densities) to the point after dt, its error, transition and noise factor."""
        x, dt = ca.MX.sym("x", self._layout.mean_dim), ca.MX.sym("dt")
        densities = ca.MX.sym("psd", len(DISTURBANCES))
        values = self._layout.unpack(x)
        constants, start = rotation_parameters(self._layout, values), ca.vertcat(values["q"], values["w"])
        sums = ca.vertcat(start, ca.DM.eye(6)[:], ca.DM.zeros(6 * self._parameter_count), ca.DM.zeros(36))
        weights = ca.DM(boole_weights(count)).T
        moved = _repeat(self.linear_substep, count, sums, constants, dt / count, weights[:count])
        coarse = _repeat(self.substep(), count // 2, start, constants, 2 * dt / count)
        last = ca.diagcat(ca.DM.zeros(3, 3), ca.DM.eye(3)) * dt / count * weights[count]
        noise = ca.reshape(moved[-36:], 6, 6) + last
        after, transition, factor = self.assemble(x, dt, densities, moved[:-36], noise)
        error = rotation_difference(coarse, moved[:7]) / 15
        names = (["x", "dt", "psd"], ["after", "error", "transition", "factor"])
        return ca.Function(
            f"linearise_{count}", [x, dt, densities], [after, error, transition, factor], *names
        )

    @built_property
    def linear_substep(self) -> ca.Function:
        """One substep of (q, w, Psi, Theta, noise).

        Node noise enters weighted. The state u is [q w (7) | Psi (6 x 6) | Theta (6 x n) | noise (6 x 6)], matrices column by
        column: Psi by the first error (a, w), Theta by the n parameters of the rotation. G = [A B] is one substep's own
        derivative by the same (a, w) and parameters, so Psi <- A Psi, Theta <- A Theta + B, noise <- A noise A'.
        """
        n = self._parameter_count
        sums, p, h, weight = (
            ca.SX.sym("u", 7 + 36 + 6 * n + 36),
            ca.SX.sym("p", n),
            ca.SX.sym("h"),
            ca.SX.sym("b"),
        )
        y, after = sums[:7], self._runge_kutta(sums[:7], p, h)
        e = ca.SX.sym("e", 6 + n)
        moved = self._runge_kutta(_rotation_retract(y, e[:6]), p + e[6:], h)
        G = ca.substitute(ca.jacobian(_rotation_local(after, moved), e), e, 0)
        Psi, Theta = ca.reshape(sums[7:43], 6, 6), ca.reshape(sums[43 : 43 + 6 * n], 6, n)
        noise = ca.reshape(sums[-36:], 6, 6) + ca.diagcat(ca.SX.zeros(3, 3), weight * h * ca.SX.eye(3))
        A, B = G[:, :6], G[:, 6:]
        out = ca.vertcat(after, (A @ Psi)[:], (A @ Theta + B)[:], (A @ noise @ A.T)[:])
        return ca.Function("linear_substep", [sums, p, h, weight], [out], SHARED)

    @built_property
    def assemble(self) -> ca.Function:
        """Whole state, transition and noise factor from those of the rotation, differentiated through the translation.

        ``d`` is the error of the state before the step, ``e`` the noise of the step, with the columns of each disturbance in
        `noise_columns`: (a, w) of the torque, (position, velocity of the centre of mass) of the force, which a state without
        translation does not have. A further disturbance adds its part of e here, and to ``roots`` the factor of that part's
        covariance at density 1.
        """
        layout, n = self._layout, self._parameter_count
        columns = noise_columns(layout.blocks)
        x, dt, psd = ca.SX.sym("x", layout.mean_dim), ca.SX.sym("dt"), ca.SX.sym("psd", len(DISTURBANCES))
        moved, noise = ca.SX.sym("u", 43 + 6 * n), ca.SX.sym("Q", 6, 6)
        d, e = ca.SX.sym("d", layout.error_dim), ca.SX.sym("e", noise_dim(layout.blocks))
        Psi, Theta = ca.reshape(moved[7:43], 6, 6), ca.reshape(moved[43:], 6, n)
        after = self.translated(layout.unpack(x), moved[:4], moved[4:7], dt)
        turned = Psi @ ca.vertcat(d[layout.slice("a")], d[layout.slice("w")])
        constants = rotation_parameters(layout, layout.unpack(layout.retract_expression(x, d)))
        turned += Theta @ (ca.substitute(ca.jacobian(constants, d), d, 0) @ d)
        rotation = _rotation_retract(moved[:7], turned + e[columns[WHITE_TORQUE.name]])
        roots = {WHITE_TORQUE.name: ca.chol(noise).T}
        values = layout.unpack(layout.retract_expression(x, d))
        if layout.translates:
            roots[WHITE_FORCE.name] = _double_integrator_root(dt)
            values = values | {"t": values["t"] + e[columns[WHITE_FORCE.name]][:3]}
        shifted = layout.unpack(self.translated(values, rotation[:4], rotation[4:7], dt))
        if layout.translates:
            shifted["v"] = shifted["v"] + e[columns[WHITE_FORCE.name]][3:]
        error = layout.near_local_expression(after, layout.pack(shifted))
        zero = {"old": [d, e], "new": [ca.SX.zeros(*d.shape), ca.SX.zeros(*e.shape)]}
        transition = ca.substitute([ca.jacobian(error, d)], zero["old"], zero["new"])[0]
        entry = ca.substitute([ca.jacobian(error, e)], zero["old"], zero["new"])[0]
        density = {each.name: psd[k] for k, each in enumerate(DISTURBANCES)}
        root = ca.diagcat(*(ca.sqrt(density[name]) * roots[name] for name in columns))
        return ca.Function("assemble", [x, dt, psd, moved, noise], [after, transition, entry @ root], SHARED)


def _repeat(
    substep: ca.Function,
    count: int,
    start: Expression,
    constants: Expression,
    h: Expression,
    *each: Expression,
) -> Expression:
    if count == 1:
        return substep(start, constants, h, *each)
    fold = substep.mapaccum(f"{substep.name()}_{count}", count)
    columns = [ca.repmat(constants, 1, count), ca.repmat(h, 1, count), *each]
    return fold(start, *columns)[:, -1]


def _rotation_retract(y: Expression, e: Expression) -> Expression:
    return ca.vertcat(product(y[:4], quaternion_from_mrp(e[:3])), y[4:7] + e[3:6])


def _rotation_local(y: Expression, z: Expression) -> Expression:
    return ca.vertcat(short_mrp_from_quaternion(product(conjugate(y[:4]), z[:4])), z[4:7] - y[4:7])


def rotation_difference(coarse: Expression, fine: Expression) -> Expression:
    """Largest component of the difference: attitude in rad, rate relative to |w|."""
    turn = 2 * (fine[3] * coarse[:3] - coarse[3] * fine[:3] - ca.cross(fine[:3], coarse[:3]))
    scale = ca.sqrt(ca.dot(fine[4:7], fine[4:7])) + 1e-300
    return ca.mmax(ca.fabs(ca.vertcat(turn, (fine[4:7] - coarse[4:7]) / scale)))


def _double_integrator_root(dt: Expression) -> Expression:
    """Lower covariance factor (6 x 6) of (position, velocity) after white acceleration."""
    root = ca.sqrt(dt)
    block = ca.vertcat(ca.horzcat(dt * root / np.sqrt(3), 0), ca.horzcat(np.sqrt(3) / 2 * root, root / 2))
    return ca.kron(block, ca.DM.eye(3))


def boole_weights(count: int) -> Float[np.ndarray, " nodes"]:
    """Boole's weights of the noise at the nodes of ``count`` substeps, in panels of four; the last node is the end."""
    return np.array([7.0, *([32.0, 12.0, 32.0, 14.0] * (count // 4))[:-1], 7.0]) * 2 / 45


def rotation_parameters(layout: StateLayout, values: dict[str, Expression]) -> Expression:
    """Constants that enter the equation of the body rate: six entries of J(s), then those of the other blocks in order."""
    return ca.vertcat(
        *[block.rotation.of(values[block.symbol]) for block in layout.members if block.rotation]
    )


def rotation_parameter_slices(layout: StateLayout) -> dict[str, slice]:
    """Slices of each block's numbers among the `rotation_parameters`."""
    places, end = {}, 0
    for block in layout.members:
        if block.rotation is not None:
            places[block.name] = slice(end, end + block.rotation.count)
            end += block.rotation.count
    return places


MAX_SUBSTEPS = 1 << 14
"""Budget of one step, in substeps: forty revolutions at a tolerance of 1e-8. What needs more raises `IntegrationError`."""
FEWEST = 4
"""Substeps of a step: a panel of Boole's rule."""
BOOLE_ERROR, NOISE_ERROR = 0.1, 1e-6
"""Relative error of the noise covariance per rad^4 of turn and sixth power of the number of substeps, and what is allowed of it."""
STEP_ERROR = 6e-4
"""Error of a turn per rad and per fourth power of the substep's angle: where the step control starts. A guess that proves too
coarse costs one more evaluation, one that is too fine would cost every one."""


class IntegrationError(SpinfiltersError, np.linalg.LinAlgError):
    """Step beyond the budget of substeps."""


class LinearisedLoops(NamedTuple):
    """Compiled loops of a linearised step, for other compiled code to call.

    Attributes
    ----------
    limits : Float[np.ndarray, ' c']
        (c,) largest turn of a step (rad) that each takes, ascending.
    loops : Int[np.ndarray, ' c']
        (c,) their addresses, 0 of those not built.
    error_dim : int
        Components of the estimated error of integration.
    noise_dim : int
        Columns of the noise factor.
    tolerance : float
        Bound on every component of that error.
    densities : Float[np.ndarray, ' p']
        (p,) of the white noise, in the order of `DISTURBANCES`.
    """

    limits: Float[np.ndarray, " c"]
    loops: Int[np.ndarray, " c"]
    error_dim: int
    noise_dim: int
    tolerance: float
    densities: Float[np.ndarray, " p"]


class StepLoops(NamedTuple):
    """Compiled loops of steps of many points side by side, for other compiled code to call.

    Attributes
    ----------
    constants : int
        Address of the loop from points to the constants of their rotation.
    constant_dim : int
        How many constants a point has.
    substeps : int
        Address of the scan over substeps.
    error : int
        Address of the loop from coarse and fine rotations to the estimated error.
    fewest : int
        Substeps of the first of `turn_limits`; each further one has twice as many.
    """

    constants: int
    constant_dim: int
    substeps: int
    error: int
    fewest: int


class LinearisedScan(NamedTuple):
    """Linearised steps of many points side by side.

    Attributes
    ----------
    scan : VectorisedScan
        See `RotationSubsteps.linearised_scan`.
    moving : int
        Errors before the last ones that stay as they are and gather no noise.
    transition, noise : Places
        Of the entries that it gives of transition and noise factor.
    """

    scan: VectorisedScan
    moving: int
    transition: Places
    noise: Places


class RotationIntegrator:
    """Steps and linearises a state whose rotation follows ``acceleration``.

    Parameters
    ----------
    layout, acceleration
        See `RotationSubsteps`.
    tolerance : float
        Bound on the estimated error of attitude (rad) and rate (relative) of one call.

    Raises
    ------
    IntegrationError
        By every method that steps, when `MAX_SUBSTEPS` do not meet the tolerance.
    """

    def __init__(self, layout: StateLayout, acceleration: Acceleration, tolerance: float) -> None:
        if not tolerance > 0:
            raise InputError(f"integration tolerance is {tolerance}; give a positive number such as 1e-9")
        self.expressions = RotationSubsteps(layout, acceleration)
        self._layout = layout
        self.tolerance = tolerance
        self._rate = layout.mean_slice("w")
        self._stepper = lru_cache(maxsize=None)(self._build_step)
        self._linearisers: dict[int, Compiled] = {}

    def step(self, x: Float[np.ndarray, "*batch m"], dt: float) -> Float[np.ndarray, "*batch m"]:
        """Points after dt > 0 seconds."""
        count = self.first_count(x, dt)
        together = self._are_stepped_together(x)
        while True:
            after, error = self._steps_together(x, dt, count) if together else self._stepper(count)(x, dt)
            if self.good(error, count):
                return after
            count *= 2

    def _are_stepped_together(self, x: np.ndarray) -> bool:
        return x.ndim == 2 and len(x) >= FEWEST_TOGETHER and self._scan.is_c

    def _steps_together(
        self, x: Float[np.ndarray, "k m"], dt: float | Float[np.ndarray, " k"], count: int
    ) -> tuple[Float[np.ndarray, "k m"], Float[np.ndarray, "k e"]]:
        """Points after dt, one or each its own, and the estimates of their errors, by vector instructions."""
        (constants,) = self._step_constants(x)
        whole = np.reshape(dt, (-1, 1))
        after, fine = self._scan(x, constants, whole, whole / count, each=np.zeros((count, 1)))
        _, coarse = self._scan(x, constants, whole, 2 * whole / count, each=np.zeros((count // 2, 1)))
        return after, self._step_error(coarse, fine)[0]

    def steps(self, x: Float[np.ndarray, "k m"], dt: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k m"]:
        """Points after dt > 0 seconds, each with its own dt.

        Points of equal dt take the same number of substeps, as in one `step` of them.
        """
        if not (np.isfinite(dt) & (dt > 0)).all():
            raise InputError("time steps must be positive and finite")
        intervals, of_interval = np.unique(dt, return_inverse=True)
        fastest = np.zeros(len(intervals))
        np.maximum.at(fastest, of_interval, self.speeds(x))
        counts = self.counts_at(fastest, intervals)
        after = np.empty_like(x)
        for count in np.unique(counts).tolist():
            rows = np.flatnonzero(counts[of_interval] == count)
            after[rows] = self._step_intervals(x[rows], dt[rows], of_interval[rows], count)
        return after

    def _step_intervals(
        self,
        x: Float[np.ndarray, "k m"],
        dt: Float[np.ndarray, " k"],
        of_interval: Int[np.ndarray, " k"],
        count: int,
    ) -> Float[np.ndarray, "k m"]:
        """`steps` with at least so many substeps; the intervals whose error is too large take twice as many."""
        if self._are_stepped_together(x):
            after, error = self._steps_together(x, dt, count)
        else:
            after, error = self._stepper(count)(x, dt[:, None])
        if float(error.max(initial=0.0)) <= self.tolerance:
            return after
        worst = np.zeros(of_interval.max() + 1)
        np.maximum.at(worst, of_interval, error.reshape(len(x), -1).max(axis=1))
        is_coarse = (worst > self.tolerance) & np.isfinite(worst)
        if is_coarse.any() and not self.good(worst[is_coarse], count):
            rows = np.flatnonzero(is_coarse[of_interval])
            after[rows] = self._step_intervals(x[rows], dt[rows], of_interval[rows], 2 * count)
        return after

    def linearise(
        self, x: Float[np.ndarray, " m"], dt: float, densities: Float[np.ndarray, " p"]
    ) -> LinearisedStep:
        """The step of dt > 0 seconds under white noise of these densities; see `TorqueFreeProcess.linearise`."""
        count = self.first_count(x, dt)
        while True:
            after, error, transition, factor = self._lineariser(count)(x, dt, densities)
            if self.good(error, count):
                return LinearisedStep(after, transition, factor)
            count *= 2

    @property
    def noise_dim(self) -> int:
        """Columns of the noise factor: rotation (a, w), and where the state translates position and velocity."""
        return noise_dim(self._layout.blocks)

    def speeds(self, x: Float[np.ndarray, "k m"]) -> Float[np.ndarray, " k"]:
        """|w| of many states, rad/s; infinite where it is beyond all numbers."""
        return speeds(x[:, self._rate])

    def first_count(self, x: np.ndarray, dt: float) -> int:
        """Substeps with which the step control starts."""
        if not (np.isfinite(dt) and dt > 0):
            raise InputError(f"time step is {dt} s; it must be positive and finite")
        w = x[..., self._rate]
        speed = hypot(*w.tolist()) if w.ndim == 1 else float(np.max(speeds(w), initial=0.0))
        return self.count_at(speed, dt)

    def count_at(self, speed: float, dt: float) -> int:
        """`first_count` at a largest time step dt > 0 (s) and largest rate ``speed`` (rad/s)."""
        turn = speed * dt
        if not np.isfinite(turn):
            return FEWEST  # no step count helps: the caller sees that the result is not finite
        count = substeps(turn, self.tolerance)
        if count > MAX_SUBSTEPS:
            raise IntegrationError(
                f"a step of {dt:.6g} s turns the body by {turn:.3g} rad, which {MAX_SUBSTEPS} substeps do not resolve to "
                f"{self.tolerance:.3g}"
            )
        return count

    def good(self, error: np.ndarray, count: int) -> bool:
        """Whether the tolerance is met, or the result is not finite."""
        worst = float(error.max()) if error.size else 0.0
        if worst <= self.tolerance or not np.isfinite(worst):
            return True
        if count >= MAX_SUBSTEPS:
            raise IntegrationError(
                f"{count} substeps of a step leave an error of {worst:.3g}, the tolerance is {self.tolerance:.3g}"
            )
        return False

    def counts_at(self, speed: Float[np.ndarray, " k"], dt: Float[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
        """`count_at` of many points, each at its own rate (rad/s) and time step (s)."""
        if not (np.isfinite(dt) & (dt > 0)).all():
            raise InputError("time steps must be positive and finite")
        limits = turn_limits(self.tolerance)
        with np.errstate(over="ignore"):
            place = np.searchsorted(list(limits.values()), speed * dt)  # of what is no number the last
        counts = np.array([*limits, 0])[place]
        for k in np.flatnonzero(place == len(limits)).tolist():
            counts[k] = self.count_at(float(speed[k]), float(dt[k]))
        return counts

    def are_good(self, error: Float[np.ndarray, "k e"], count: int) -> Bool[np.ndarray, " k"]:
        """`good` of many points by the errors of each."""
        worst = error.max(axis=1, initial=0.0)
        good = (worst <= self.tolerance) | ~np.isfinite(worst)
        if not good.all():
            self.good(worst[~good], count)  # raises at the most substeps
        return good

    @building()
    def _build_step(self, count: int) -> Compiled:
        return Compiled(self.expressions.step(count))

    def step_loops(self) -> StepLoops | None:
        """Compiled loops of `step`; None without compiled code."""
        constants, scan, error = self._step_constants.loop, self._scan.loop, self._step_error.loop
        if constants is None or scan is None or error is None:
            return None
        return StepLoops(constants, math.prod(self._step_constants.output_shapes[0]), scan, error, FEWEST)

    @built_property
    def linearised_scan(self) -> LinearisedScan:
        """`linearise` of many points side by side."""
        return self.expressions.linearised_scan()

    @built_property
    def _scan(self) -> VectorisedScan:
        return self.expressions.step_scan()

    @built_property
    def _step_constants(self) -> Compiled:
        return Compiled(self.expressions.step_constants())

    @built_property
    def _step_error(self) -> Compiled:
        return Compiled(self.expressions.step_error())

    def _lineariser(self, count: int) -> Compiled:
        if count not in self._linearisers:
            with building():
                self._linearisers.setdefault(count, Compiled(self.expressions.linearised_step(count)))
        return self._linearisers[count]

    def linearised_loops(self, densities: Float[np.ndarray, " p"]) -> LinearisedLoops | None:
        """Compiled loops of `linearise` by substeps, those that were used so far; None without compiled code, or any use."""
        built = {count: each for count, each in self._linearisers.items() if each.loop is not None}
        if not built:
            return None
        limits = turn_limits(self.tolerance)
        loops = [built[count].loop or 0 if count in built else 0 for count in limits]
        shapes = next(iter(built.values())).output_shapes
        turns_of_loops = np.array(list(limits.values()))
        error_dim, noise_dim = math.prod(shapes[1]), shapes[3][1]
        return LinearisedLoops(
            turns_of_loops, np.array(loops), error_dim, noise_dim, self.tolerance, densities
        )


def speeds(rates: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch"]:
    """Length |w| of rates, rad/s, scaled so that squares do not overflow; infinite only where the length itself is."""
    scale = np.abs(rates).max(axis=-1, keepdims=True, initial=float_info.min)
    with np.errstate(over="ignore", invalid="ignore"):
        return scale[..., 0] * np.linalg.norm(rates / scale, axis=-1)


def turns(
    rates: Float[np.ndarray, "*batch 3"], dt: Float[np.ndarray, "*batch"]
) -> Float[np.ndarray, "*batch"]:
    """Rotation |w| dt of steps, rad; infinite where it is beyond all numbers."""
    with np.errstate(over="ignore", invalid="ignore"):
        return speeds(rates) * dt


def substeps(turn: float, tolerance: float) -> int:
    """Substeps needed for a rotation (rad) in one step, a power of two; above `MAX_SUBSTEPS` if more are needed."""
    angle = (tolerance / (STEP_ERROR * max(turn, tolerance))) ** 0.25
    noise_angle = (NOISE_ERROR / BOOLE_ERROR) ** (1 / 6) * max(turn, NOISE_ERROR) ** (1 / 3)
    count = FEWEST
    while count * min(angle, noise_angle) < turn and count <= MAX_SUBSTEPS:
        count *= 2
    return count


@lru_cache(maxsize=64)
def substep_numbers(count: int) -> Float[np.ndarray, "c 2"]:
    """Noise weight and coarse step length of every substep of ``count``, the latter in substeps."""
    numbers = np.zeros((count, 2))
    if count:
        numbers[:, 0], numbers[::2, 1] = boole_weights(count)[:count], 2.0
    return numbers


FEWEST_TOGETHER: Final = 8
"""Points of one call from which they are stepped side by side."""
MOST_LIMITS: Final = 6
"""Numbers of substeps whose largest turn is computed beforehand: up to 32 times the fewest."""


@lru_cache(maxsize=64)
def turn_limits(tolerance: float) -> dict[int, float]:
    """Largest turn of a step (rad) that needs no more than so many `substeps`, by bisection."""
    limits: dict[int, float] = {}
    for count in (FEWEST << k for k in range(MOST_LIMITS)):
        low, high = 0.0, 1e3
        for _ in range(80):
            middle = (low + high) / 2
            low, high = (middle, high) if substeps(middle, tolerance) <= count else (low, middle)
        limits[count] = low
    return limits
