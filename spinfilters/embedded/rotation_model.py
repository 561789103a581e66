"""One Runge-Kutta substep of the rotation with its exact error transition, in few operations.

The same map as `spinfilters.models.rotation_integrator.RotationIntegrator` differentiated by its structure: the body rate does not
depend on the attitude, Runge-Kutta commutes with a turn from the left, and Euler's equation does not depend on the scale of the
inertia. So five entries of J are enough, the attitude error turns by R' of the substep's own turn, and less than half of the
operations remain.
"""

import casadi as ca

from spinfilters.attitude.expressions import (
    Expression,
    conjugate,
    matrix_from_quaternion,
    normalised,
    product,
    quaternion_rate,
    short_mrp_from_quaternion,
)
from spinfilters.models.process import body_acceleration

INERTIA_ENTRIES = 5
"""Entries of J that the rate is differentiated by: J11, J21, J31, J22, J32; J33 follows from the scale, which does not matter."""
STAGES = ((0.0, 1 / 6), (0.5, 1 / 3), (0.5, 1 / 3), (1.0, 1 / 6))
"""Of Runge-Kutta 4: where a stage lies on the one before, in substeps, and its weight."""


def inertia_of(entries: Expression) -> Expression:
    """J (3 x 3) from its lower triangle, column by column."""
    j = entries
    return ca.vertcat(
        ca.horzcat(j[0], j[1], j[2]), ca.horzcat(j[1], j[3], j[4]), ca.horzcat(j[2], j[4], j[5])
    )


def substep_expression() -> tuple[list[ca.SX], list[ca.SX]]:
    """Symbolic substep of h seconds with its derivatives.

    Inputs (q 4, w 3, J 6, h) and outputs (q 4, w 3, A_aa 3x3, A_aw 3x3, A_ww 3x3, B_a 3x5, B_w 3x5).
    A is the transition of the error (a, w), B its sensitivity to the `INERTIA_ENTRIES`.
    """
    q, w, j, h = ca.SX.sym("q", 4), ca.SX.sym("w", 3), ca.SX.sym("j", 6), ca.SX.sym("h")
    rates, slopes, sensitivities = _stages(w, j, h)
    turn, by_rates = _turn(rates, h)
    by_start = ca.horzcat(ca.SX.eye(3), ca.SX(3, INERTIA_ENTRIES))
    by_both = sum(
        (by_rates[:, 3 * k : 3 * k + 3] @ each for k, each in enumerate(sensitivities)), ca.SX(3, 8)
    )
    weights = [weight for _, weight in STAGES]
    after = w + h * sum((b * k for (k, _), b in zip(slopes, weights, strict=True)), ca.SX(3, 1))
    rate_by_both = by_start + h * sum((b * K for (_, K), b in zip(slopes, weights, strict=True)), ca.SX(3, 8))
    outputs = [normalised(product(q, turn)), after, matrix_from_quaternion(turn).T]
    outputs += [by_both[:, :3], rate_by_both[:, :3], by_both[:, 3:], rate_by_both[:, 3:]]
    return [q, w, j, h], [ca.SX(each) for each in outputs]


def _stages(w: ca.SX, j: ca.SX, h: ca.SX) -> tuple[list[ca.SX], list[tuple[ca.SX, ca.SX]], list[ca.SX]]:
    """Rates at the stages with slopes and derivatives.

    Slopes with derivatives by (w, J), and derivatives (3, 8) of the rates.
    """
    at, entries, k = ca.SX.sym("at", 3), ca.SX.sym("entries", 6), ca.SX.sym("k", 3)
    J = inertia_of(entries)
    torque = (
        ca.cross(J @ at, at) - J @ k
    )  # zero at k = w': its derivatives give those of w' without any of J^-1
    both = ca.horzcat(ca.jacobian(torque, at), ca.jacobian(torque, entries)[:, :INERTIA_ENTRIES])
    slope = ca.Function("slope", [at, entries], [body_acceleration(at, J)])
    residual = ca.Function("residual", [at, entries, k], [both])
    inverse = ca.inv_minor(inertia_of(j))
    rates, slopes, sensitivities = [], [], []
    k, K = ca.SX(3, 1), ca.SX(3, 8)
    for place, _ in STAGES:
        rate = w + place * h * k
        sensitivity = ca.horzcat(ca.SX.eye(3), ca.SX(3, INERTIA_ENTRIES)) + place * h * K
        k = slope(rate, j)
        FE = residual(rate, j, k)
        K = inverse @ (FE[:, :3] @ sensitivity + ca.horzcat(ca.SX(3, 3), FE[:, 3:]))
        rates.append(rate)
        sensitivities.append(sensitivity)
        slopes.append((k, K))
    return rates, slopes, sensitivities


def _turn(rates: list[ca.SX], h: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Quaternion of the substep and the derivative (3, 12) of its error.

    From and by the rates at the stages.
    """
    symbols = [ca.SX.sym(f"w{k}", 3) for k in range(len(rates))]
    identity, k, total = ca.SX([0, 0, 0, 1]), ca.SX(4, 1), ca.SX(4, 1)
    for rate, (place, weight) in zip(symbols, STAGES, strict=True):
        k = quaternion_rate(identity + place * h * k, rate)
        total += weight * k
    turn = normalised(identity + h * total)
    there = ca.SX.sym("there", 4)
    by_rates = ca.jacobian(short_mrp_from_quaternion(product(conjugate(there), turn)), ca.vertcat(*symbols))
    by_rates = ca.substitute(by_rates, there, turn)
    made = ca.substitute([turn, by_rates], symbols, rates)
    return made[0], made[1]
