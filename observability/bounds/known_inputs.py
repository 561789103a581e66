"""Motion under known torques and accelerations of the inspector.

What free motion lacks, for the bound.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from jaxtyping import Float

from observability.system import Input
from spinfilters.attitude.expressions import Expression
from spinfilters.dynamics.mass_distribution import inertia
from spinfilters.errors import InputError
from spinfilters.models.linearised_step import LinearisedStep
from spinfilters.models.measurement import row_by_row
from spinfilters.models.process import TorqueFreeProcess, derivative
from spinfilters.state.layout import StateLayout
from spinfilters.symbolic.compiled import Compiled
from spinfilters.symbolic.working_time import built_property

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

    def at(self, time: float) -> float:
        """Its value."""
        return float(self.size * np.cos(2 * np.pi * time / self.period))


class DrivenMotion:
    """A process with known inputs.

    Their torques make the scale of the inertia one more unknown constant.
    Torques act about axes g, which are the principal axes of a `observability.charts.filter_state` point; an inspector's
    acceleration is the opposite of what it gives the body in frame i. Process noise is that of the free motion.

    Parameters
    ----------
    process: the free motion.   inputs: what acts.
    scale: the inertia in kg m^2 over J(s).
    """

    def __init__(self, process: TorqueFreeProcess, inputs: Sequence[KnownInput], scale: float) -> None:
        self._process, self._inputs, self._scale = process, tuple(inputs), scale
        self.constants = int(any(each.axis.is_torque for each in inputs))

    def step(self, x: Float[np.ndarray, " m"], start: float, dt: float) -> Float[np.ndarray, " m"]:
        """The point ``dt`` s after ``start``, s."""
        return self.linearise(x, start, dt).after

    def linearise(self, x: Float[np.ndarray, " m"], start: float, dt: float) -> LinearisedStep:
        """The linearised step with the inertia's scale.

        Its transition is by the error of x and, after it, the logarithm of that scale.
        """
        n, count = self._process.layout.error_dim, self._count(x, dt)
        transition, factor = np.eye(n, n + self.constants), self._process.linearise(x, dt).noise_factor
        h = dt / count
        for k in range(count):
            time = start + k * h
            acting = [self._acting(time + share * h) for share in (0.0, 0.5, 1.0)]
            x, rows = self._substep(x, *acting, h)
            rows = rows.reshape(n, n + 1)
            transition = rows[:, :n] @ transition
            transition[:, n:] += rows[:, n : n + self.constants]
        return LinearisedStep(x, transition, factor)

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

    def _acting(self, time: float) -> Float[np.ndarray, " 6"]:
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
