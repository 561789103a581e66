"""Expressions of a rotation's steps: Runge-Kutta 4 with error transition and noise covariance.

Only attitude and rate need an integrator: the centre of mass moves in closed form. One substep, written in SX, advances
(q, w), the transition Psi of the error (a, w) with respect to itself, its sensitivity Theta to the constants (inertia and
drag), and the noise covariance. The noise integral of Psi B B' Psi' is taken by Boole's rule over the substeps, whose positive
weights keep it positive semidefinite, and which is exact for dt -> 0.
"""

from collections.abc import Callable

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.attitude.expressions import (
    Expression,
    conjugate,
    normalised,
    product,
    quaternion_from_mrp,
    quaternion_rate,
    rotate,
    short_mrp_from_quaternion,
)
from spinfilters.state.blocks.acceleration import ACCELERATION
from spinfilters.state.blocks.drag import DRAG
from spinfilters.state.blocks.linear_drag import LINEAR_DRAG
from spinfilters.state.blocks.rigid_body import MASS_DISTRIBUTION
from spinfilters.state.blocks.rotor import ROTOR
from spinfilters.state.blocks.torque import TORQUE
from spinfilters.state.layout import StateLayout

Acceleration = Callable[..., Expression]
"""w' from the rate, the inertia (3 x 3) and, where the state has them, drag, constant body torque, a flywheel's momentum and linear
drag."""

SHARED = {"cse": True}
"""Expressions that occur again are evaluated once, to the same bits."""


class RotationSubsteps:
    """Steps of a state whose rotation follows ``acceleration``, as functions of the number of substeps.

    Parameters
    ----------
    layout: blocks of the state; the acceleration may use the constants that have `RotationParameters`.
    acceleration: w' in g axes, rad/s^2.
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

    def substep(self) -> ca.Function:
        """One substep of Runge-Kutta 4 as a function."""
        y, p, h = ca.SX.sym("y", 7), ca.SX.sym("p", self._parameter_count), ca.SX.sym("h")
        return ca.Function("substep", [y, p, h], [self._runge_kutta(y, p, h)], SHARED)

    def _runge_kutta(self, y: Expression, p: Expression, h: Expression) -> Expression:
        k1 = self._rotation_rate(y, p)
        k2 = self._rotation_rate(y + h / 2 * k1, p)
        k3 = self._rotation_rate(y + h / 2 * k2, p)
        k4 = self._rotation_rate(y + h * k3, p)
        after = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return ca.vertcat(normalised(after[:4]), after[4:7])

    def _rotation_rate(self, y: Expression, p: Expression) -> Expression:
        j = p[self._parameters[MASS_DISTRIBUTION.name]]  # the lower triangle of J, column by column
        J = ca.vertcat(
            ca.horzcat(j[0], j[1], j[2]), ca.horzcat(j[1], j[3], j[4]), ca.horzcat(j[2], j[4], j[5])
        )
        constants = (
            p[self._parameters[block.name]] if self._layout.has(block) else None
            for block in (DRAG, TORQUE, ROTOR, LINEAR_DRAG)
        )
        return ca.vertcat(quaternion_rate(y[:4], y[4:7]), self._acceleration(y[4:7], J, *constants))

    def translated(
        self, values: dict[str, Expression], q: Expression, w: Expression, dt: Expression
    ) -> Expression:
        """State after dt: r = t + R c moves with v, v with f."""
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
        x, dt, densities = ca.MX.sym("x", self._layout.mean_dim), ca.MX.sym("dt"), ca.MX.sym("psd", 2)
        values = self._layout.unpack(x)
        constants, start = rotation_parameters(self._layout, values), ca.vertcat(values["q"], values["w"])
        sums = ca.vertcat(start, ca.DM.eye(6)[:], ca.DM.zeros(6 * self._parameter_count), ca.DM.zeros(36))
        weights = ca.DM(boole_weights(count)).T
        moved = _repeat(self.linear_substep(), count, sums, constants, dt / count, weights[:count])
        coarse = _repeat(self.substep(), count // 2, start, constants, 2 * dt / count)
        last = ca.diagcat(ca.DM.zeros(3, 3), ca.DM.eye(3)) * dt / count * weights[count]
        noise = ca.reshape(moved[-36:], 6, 6) + last
        after, transition, factor = self.assemble()(x, dt, densities, moved[:-36], noise)
        error = rotation_difference(coarse, moved[:7]) / 15
        names = (["x", "dt", "psd"], ["after", "error", "transition", "factor"])
        return ca.Function(
            f"linearise_{count}", [x, dt, densities], [after, error, transition, factor], *names
        )

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

    def assemble(self) -> ca.Function:
        """Whole state, transition and noise factor from those of the rotation, differentiated through the translation.

        ``d`` is the error of the state before the step, ``e`` the noise of the step: (a, w) of the rotation, then (position,
        velocity) of the centre of mass, which a state without translation does not have.
        """
        layout, n = self._layout, self._parameter_count
        x, dt, psd = ca.SX.sym("x", layout.mean_dim), ca.SX.sym("dt"), ca.SX.sym("psd", 2)
        moved, noise = ca.SX.sym("u", 43 + 6 * n), ca.SX.sym("Q", 6, 6)
        d, e = ca.SX.sym("d", layout.error_dim), ca.SX.sym("e", 12)
        Psi, Theta = ca.reshape(moved[7:43], 6, 6), ca.reshape(moved[43:], 6, n)
        after = self.translated(layout.unpack(x), moved[:4], moved[4:7], dt)
        turned = Psi @ ca.vertcat(d[layout.slice("a")], d[layout.slice("w")])
        constants = rotation_parameters(layout, layout.unpack(layout.retract_expression(x, d)))
        turned += Theta @ (ca.substitute(ca.jacobian(constants, d), d, 0) @ d)
        rotation = _rotation_retract(moved[:7], turned + e[:6])
        values = layout.unpack(layout.retract_expression(x, d))
        if layout.translates:
            values = values | {"t": values["t"] + e[6:9]}
        shifted = layout.unpack(self.translated(values, rotation[:4], rotation[4:7], dt))
        if layout.translates:
            shifted["v"] = shifted["v"] + e[9:12]
        error = layout.near_local_expression(after, layout.pack(shifted))
        zero = {"old": [d, e], "new": [ca.SX.zeros(*d.shape), ca.SX.zeros(*e.shape)]}
        transition = ca.substitute([ca.jacobian(error, d)], zero["old"], zero["new"])[0]
        entry = ca.substitute([ca.jacobian(error, e)], zero["old"], zero["new"])[0]
        root = ca.sqrt(psd[1]) * ca.chol(noise).T
        if layout.translates:
            root = ca.diagcat(root, ca.sqrt(psd[0]) * _double_integrator_root(dt))
        else:
            entry = entry[:, :6]
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
    """Boole's weights of the noise at every node of ``count`` substeps.

    Panels have four substeps; the last node is the end.
    """
    return np.array([7.0, *([32.0, 12.0, 32.0, 14.0] * (count // 4))[:-1], 7.0]) * 2 / 45


def rotation_parameters(layout: StateLayout, values: dict[str, Expression]) -> Expression:
    """Constants that enter the rotation, block after block.

    Six entries of J(s), then the drag.
    """
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
