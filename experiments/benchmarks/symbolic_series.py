"""Lie derivatives and gradients as CasADi expressions. To look at, to count, or to compile."""

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Float

from observability.system import System
from observability.tape import Tape
from spinfilters.core.errors import InputError


class Dual(NamedTuple):
    """A coefficient and its sparse gradient (1, n) by all unknowns.

    What is structurally 0 costs nothing.
    """

    value: ca.SX
    gradient: ca.SX


@dataclass(frozen=True)
class LieDerivatives:
    """Lie derivatives of one sensor of a system without inputs.

    Two functions hold them, so that many items cost no more expression than one.

    Attributes
    ----------
    motion: x -> Taylor coefficients of the state (n, orders) and their gradients by x (n orders, n), sparse.
    sensor: (coefficients, gradients, parameters) -> Lie derivatives (values orders, 1), not divided by k!, order by order, and
        their gradients (values orders, n + unknown) by the chart's numbers, quaternions included, and the unknown parameters.
    """

    motion: ca.Function
    sensor: ca.Function

    @property
    def nodes(self) -> int:
        """Operations of both expressions."""
        return self.motion.n_nodes() + self.sensor.n_nodes()

    def __call__(
        self, x: Float[np.ndarray, " n"], parameters: Float[np.ndarray, "items p"]
    ) -> tuple[Float[np.ndarray, "items k"], Float[np.ndarray, "items k m"]]:
        """Derivatives and gradients of every item."""
        moved = self.motion(x)
        found = [self.sensor(*moved, item) for item in parameters]
        return np.stack([np.asarray(a)[:, 0] for a, _ in found]), np.stack(
            [np.asarray(ca.densify(b)) for _, b in found]
        )


def lie_derivatives(system: System, index: int, orders: int) -> LieDerivatives:
    """Lie derivatives 0 to orders - 1 of sensor ``index`` by power series.

    The expression grows as the square of the order.

    Raises
    ------
    InputError: for a system with inputs.
    """
    if system.inputs:
        raise InputError("Lie derivatives along known inputs are made by numbers: use gradient_rows")
    motion = _motion(system, orders)
    return LieDerivatives(motion, _sensor(system, index, motion))


def _motion(system: System, orders: int) -> ca.Function:
    x = ca.SX.sym("x", system.chart.mean_dim)
    state = [[Dual(x[k], _unit(k, x.numel())) for k in range(x.numel())]]
    series = _SymbolicSeries(system.motion, x.numel())
    for order in range(orders - 1):
        series.put(0, state[order])
        state.append([_scaled(dual, 1 / (order + 1)) for dual in series.advance(order)])
    values = ca.horzcat(*[ca.vertcat(*[dual.value for dual in row]) for row in state])
    gradients = ca.vertcat(*[dual.gradient for row in state for dual in row])
    return ca.Function("motion", [x], [values, ca.sparsify(gradients)])


def _sensor(system: System, index: int, motion: ca.Function) -> ca.Function:
    """The sensor over symbols of the motion's coefficients, zeros of gradients kept."""
    sensor, (size, orders) = system.sensors[index], motion.size_out(0)
    width = size + sensor.unknown
    values, gradients = ca.SX.sym("x", size, orders), ca.SX.sym("G", motion.sparsity_out(1))
    p = ca.SX.sym("p", sensor.model.parameter_dim)
    padded, zero = (
        ca.horzcat(gradients, ca.SX(size * orders, sensor.unknown)),
        Dual(ca.SX(1, 1), ca.SX(1, width)),
    )
    own = [_unit(size + k, width) if k < sensor.unknown else ca.SX(1, width) for k in range(p.numel())]
    series = _SymbolicSeries(system.outputs[index], width)
    rows, factorial = [], 1.0
    for order in range(orders):
        factorial *= max(order, 1)
        series.put(0, [Dual(values[k, order], padded[size * order + k, :]) for k in range(size)])
        series.put(1, [Dual(p[k], own[k]) if order == 0 else zero for k in range(p.numel())])
        rows += [_scaled(dual, factorial) for dual in series.advance(order)]
    outputs = [ca.vertcat(*[dual.value for dual in rows]), ca.vertcat(*[dual.gradient for dual in rows])]
    return ca.Function("sensor", [values, gradients, p], outputs)


def _unit(index: int, count: int) -> ca.SX:
    gradient = ca.SX(1, count)
    gradient[0, index] = 1
    return gradient


class _SymbolicSeries:
    """Registers of a tape, each a list of coefficients."""

    def __init__(self, tape: Tape, count: int) -> None:
        self._tape = tape
        self._zero = Dual(ca.SX(1, 1), ca.SX(1, count))
        self._registers: list[list[Dual]] = [[] for _ in range(tape.size)]

    def put(self, index: int, values: list[Dual]) -> None:
        """Append the coefficients of one input, order by order."""
        for register, dual in zip(self._tape.inputs[index], values, strict=True):
            self._registers[register].append(dual)

    def advance(self, order: int) -> list[Dual]:
        """Coefficients of this order of all outputs, by the tape's instructions."""
        for register, value in self._tape.constants:
            constant = Dual(ca.SX(float(value)), self._zero.gradient)
            self._registers[register].append(constant if order == 0 else self._zero)
        for group in self._tape.groups:
            for out, left, right in zip(group.out, group.left, group.right, strict=True):
                self._registers[out].append(self._coefficient(group.operation, out, left, right, order))
        return [self._registers[register][order] for register in self._tape.output]

    def _coefficient(self, operation: str, at: int, left: int, right: int, order: int) -> Dual:
        out, a, b = (self._registers[register] for register in (at, left, right))
        match operation:
            case "add":
                return Dual(a[order].value + b[order].value, a[order].gradient + b[order].gradient)
            case "sub":
                return Dual(a[order].value - b[order].value, a[order].gradient - b[order].gradient)
            case "neg" | "twice":
                return _scaled(a[order], -1 if operation == "neg" else 2)
            case "mul" | "sq":
                return self._sum(a, b, range(order + 1), order)
            case "div":
                return _divided(_less(a[order], self._sum(out, b, range(order), order)), b[0])
            case "exp" if order == 0:
                power = ca.exp(a[0].value)
                return Dual(power, power * a[0].gradient)
            case "exp":
                weighted = [_scaled(dual, j / order) for j, dual in enumerate(a)]
                return self._sum(weighted, out, range(1, order + 1), order)
            case "fmax":
                return a[order]
            case _:
                raise InputError(f"{self._tape.name} contains {operation}: use the numeric series")

    def _sum(self, a: list[Dual], b: list[Dual], terms: range, order: int) -> Dual:
        """sum of a_j b_{order-j} with its gradient."""
        total = self._zero
        for j in terms:
            p, q = a[j], b[order - j]
            if p.value.is_zero() and q.value.is_zero():
                continue
            gradient = p.value * q.gradient + p.gradient * q.value
            total = Dual(total.value + p.value * q.value, total.gradient + ca.sparsify(gradient))
        return total


def _less(a: Dual, b: Dual) -> Dual:
    return Dual(a.value - b.value, a.gradient - b.gradient)


def _scaled(dual: Dual, factor: float) -> Dual:
    return Dual(factor * dual.value, factor * dual.gradient)


def _divided(a: Dual, b: Dual) -> Dual:
    value = a.value / b.value
    return Dual(value, ca.sparsify((a.gradient - value * b.gradient) / b.value))
