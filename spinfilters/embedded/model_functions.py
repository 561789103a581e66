"""CasADi functions of the embedded filter: rotation in fixed substeps, prediction, measurements, reset of the error state."""

from collections.abc import Mapping
from typing import NamedTuple

import casadi as ca
import numpy as np

from spinfilters.core.attitude_expressions import (
    Expression,
    conjugate,
    matrix_from_quaternion,
    normalised,
    product,
    quaternion_rate,
    short_mrp_from_quaternion,
)
from spinfilters.core.mass_distribution import (
    inertia,
    inertia_entries,
    inertia_from_entries,
    lower_factor,
    traceless,
)
from spinfilters.embedded.embedded_options import EmbedOptions
from spinfilters.embedded.emitted_sensors import POINT
from spinfilters.models.measurement import LandmarkSensor, MeasurementModel, row_by_row
from spinfilters.models.process import body_acceleration
from spinfilters.models.state_blocks import ACCELERATION, MASS_DISTRIBUTION
from spinfilters.models.state_layout import StateLayout, error_derivative

EVEN_SERIES = (1 / 24, 1 / 1920, 1 / 322560)
"""Of sinh(x)/x - 1 in ad_D^2; what is left out is below 1e-9 for |d| up to 0.3 and below 1e-4 for 1."""
EXPONENTIAL_ORDER = 10
"""Of the Taylor series of exp(D/2): below rounding for |d| up to 0.5, below 3e-8 for 2."""


def attitude_reset(a: Expression) -> Expression:
    """E of the attitude error a (4 x MRP), 3 x 3."""
    m = a / 4
    square = ca.dot(m, m)
    return (-(3 + square) * square * ca.DM.eye(3) - 2 * ca.skew(m) + 2 * m @ m.T) / (1 + square) ** 2


def mass_correction(s: Expression, d: Expression) -> tuple[Expression, Expression]:
    """s [+] d of a mass distribution, and E of its error d.

    `spinfilters.core.mass_distribution.retract_mass`; E is 5 x 5.
    A commutator of symmetric matrices is skew, so ad_D^2 = B A with A (3 x 5) and B (5 x 3): the series needs powers of A B.
    """
    D, e, v = traceless(d), ca.SX.sym("e", 5), ca.SX.sym("v", 3)
    A = ca.jacobian(ca.inv_skew(_commutator(D, traceless(e))), e)
    B = ca.jacobian(_components(_commutator(D, ca.skew(v))), v)
    square = A @ B
    stretched = (
        B @ (ca.SX.eye(3) * EVEN_SERIES[0] + square * EVEN_SERIES[1] + square @ square * EVEN_SERIES[2]) @ A
    )
    root = ca.SX(3, 3)  # exp(D/2) - I
    for order in range(EXPONENTIAL_ORDER, 0, -1):
        root = D @ (ca.SX.eye(3) + root) / (2 * order)
    F = _cholesky(2 * root + root @ root)
    K = _solve_identity_plus(F, root - F)  # Q - I
    X = traceless(e)
    turned = ca.jacobian(_components(K @ X + X @ K.T + K @ X @ K.T), e)
    off = lower_factor(s) @ F
    change = ca.vertcat(ca.log1p(F[0, 0]), ca.log1p(F[1, 1]), off[1, 0], off[2, 0], off[2, 1])
    return s + change, turned + stretched + turned @ stretched


def _cholesky(N: Expression) -> Expression:
    """L - I of the lower Cholesky factor L of I + N, 3 x 3, without a difference of numbers near one."""
    zero = ca.SX(0)
    a = _root(N[0, 0])
    b, c = N[1, 0] / (1 + a), N[2, 0] / (1 + a)
    e = _root(N[1, 1] - b * b)
    f = (N[2, 1] - b * c) / (1 + e)
    g = _root(N[2, 2] - c * c - f * f)
    return ca.vertcat(ca.horzcat(a, zero, zero), ca.horzcat(b, e, zero), ca.horzcat(c, f, g))


def _root(x: Expression) -> Expression:
    """sqrt(1 + x) - 1."""
    return x / (1 + ca.sqrt(1 + x))


def _solve_identity_plus(F: Expression, right: Expression) -> Expression:
    """(I + F)^-1 right for a lower triangular F."""
    first = right[0, :] / (1 + F[0, 0])
    second = (right[1, :] - F[1, 0] * first) / (1 + F[1, 1])
    return ca.vertcat(first, second, (right[2, :] - F[2, 0] * first - F[2, 1] * second) / (1 + F[2, 2]))


def _commutator(A: Expression, B: Expression) -> Expression:
    return A @ B - B @ A


def _components(D: Expression) -> Expression:
    return ca.vertcat(D[0, 0], D[1, 1], D[1, 0], D[2, 0], D[2, 1])


INERTIA_ENTRIES = 5
"""Entries of J that the rate is differentiated by: J11, J21, J31, J22, J32; J33 follows from the scale, which does not matter."""
STAGES = ((0.0, 1 / 6), (0.5, 1 / 3), (0.5, 1 / 3), (1.0, 1 / 6))
"""Of Runge-Kutta 4: where a stage lies on the one before, in substeps, and its weight."""


def substep_expression() -> tuple[list[ca.SX], list[ca.SX]]:
    """Symbolic substep of h seconds with its derivatives.

    Inputs (q 4, w 3, J 6, h) and outputs (q 4, w 3, A_aa 3x3, A_aw 3x3, A_ww 3x3, B_a 3x5, B_w 3x5).
    A is the transition of the error (a, w), B its sensitivity to the `INERTIA_ENTRIES`.
    """
    q, w, j, h = ca.SX.sym("q", 4), ca.SX.sym("w", 3), ca.SX.sym("j", 6), ca.SX.sym("h")
    rates, slopes, sensitivities = _stages(w, j, h)
    turn, by_rates = _rotate_substep(rates, h)
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
    J = inertia_from_entries(entries)
    torque = (
        ca.cross(J @ at, at) - J @ k
    )  # zero at k = w': its derivatives give those of w' without any of J^-1
    both = ca.horzcat(ca.jacobian(torque, at), ca.jacobian(torque, entries)[:, :INERTIA_ENTRIES])
    slope = ca.Function("slope", [at, entries], [body_acceleration(at, J)])
    residual = ca.Function("residual", [at, entries, k], [both])
    inverse = ca.inv_minor(inertia_from_entries(j))
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


def _rotate_substep(rates: list[ca.SX], h: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Quaternion of a substep from the rates at its stages, and its error's derivative (3, 12) by these rates."""
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


SHARED = {"cse": True}
ROTATION_SHAPES = ((3, 3), (3, 3), (3, 3), (3, 5), (3, 5), (5, 5))
"""Of Psi_aa, Psi_aw, Psi_ww, Theta_a, Theta_w and dJ."""


def model_functions(options: EmbedOptions) -> list[ca.Function]:
    """Everything that is generated for these options; matrices row by row."""
    layout = options.layout
    functions = [inertia_function(), substep_function(), transition_function(layout)]
    functions.append(correction_function(layout))
    for each in options.emitted:
        if each.landmark_model is None:
            functions.append(measurement_function(each.model(layout)))
        else:
            functions += [rotation_function(layout), *landmark_functions(each.landmark_model(layout))]
    return functions


def inertia_function() -> ca.Function:
    """J and its first five entries' derivatives by the error of s.

    s (5) to J (6, lower triangle column by column), derivatives (5 x 5).
    The scale of J does not matter, so that of J33 is put into the other five.
    """
    s, d = ca.SX.sym("s", 5), ca.SX.sym("d", 5)
    L = lower_factor(s)
    moved = L @ (ca.SX.eye(3) + traceless(d)) @ L.T  # exp(D) to first order
    entries = inertia_entries(inertia(s))
    slope = ca.jacobian(inertia_entries(ca.trace(moved) * ca.DM.eye(3) - moved), d)
    slope = slope[:INERTIA_ENTRIES, :] - entries[:INERTIA_ENTRIES] @ (slope[5, :] / entries[5])
    outputs = [entries, row_by_row(ca.substitute(slope, d, ca.SX.zeros(5)))]
    return _function("inertia", {"s": s}, dict(zip(("j", "dj"), outputs, strict=True)))


def substep_function() -> ca.Function:
    """See `rotation_model.substep_expression`."""
    inputs, outputs = substep_expression()
    rows = [each if each.shape[1] == 1 else row_by_row(each) for each in outputs]
    names = ["q_after", "w_after", "a_aa", "a_aw", "a_ww", "b_a", "b_w"]
    return _function("substep", dict(zip("qwjh", inputs, strict=True)), dict(zip(names, rows, strict=True)))


def transition_expression(layout: StateLayout) -> tuple[list[ca.SX], list[ca.SX]]:
    """Symbolic step from that of its rotation.

    Inputs and (point after, transition n x n, noise factor n x k).
    Inputs, matrices row by row: the point, its rotation after the step (q 4, w 3), Psi_aa, Psi_aw, Psi_ww (3 x 3), Theta_a,
    Theta_w (3 x 5, by entries of J), dJ (5 x 5), the rotation's noise of unit density (6 x 6, lower triangle row by row), dt, and
    densities (force, torque).
    """
    x, after = ca.SX.sym("x", layout.mean_dim), ca.SX.sym("after", 7)
    flat = [ca.SX.sym("m", rows * columns) for rows, columns in ROTATION_SHAPES]
    psi_aa, psi_aw, psi_ww, theta_a, theta_w, dj = (
        ca.reshape(each, *shape[::-1]).T for each, shape in zip(flat, ROTATION_SHAPES, strict=True)
    )
    noise, dt, psd = ca.SX.sym("noise", 21), ca.SX.sym("dt"), ca.SX.sym("psd", 2)
    n, k = layout.error_dim, 12 if layout.translates else 6
    a, w, s = (layout.slice(name) for name in ("a", "w", "s"))
    transition, factor = ca.SX.eye(n), ca.SX(n, k)
    transition[a, a], transition[a, w], transition[a, s] = psi_aa, psi_aw, theta_a @ dj
    transition[w, w], transition[w, s] = psi_ww, theta_w @ dj
    root = ca.sqrt(psd[1]) * ca.chol(_symmetric(noise)).T
    factor[a, :6], factor[w, :6] = root[:3, :], root[3:, :]
    values = layout.unpack(x) | {"q": after[:4], "w": after[4:]}
    if layout.translates:
        values |= _translate(layout, _DiscreteStep(x, after[:4], dt, psd[0]), transition, factor)
    inputs = [x, after, *flat, noise, dt, psd]
    return inputs, [layout.pack(values), transition, factor]


def transition_function(layout: StateLayout) -> ca.Function:
    """`transition_expression` with structural non-zeros of its moving rows alone, row by row."""
    inputs, (after, transition, factor) = transition_expression(layout)
    moving = moving_dim(layout)
    rows = [_nonzeros_by_row(each[:moving, :]) for each in (transition, factor)]
    names = ["x", "rotation", "psi_aa", "psi_aw", "psi_ww", "th_a", "th_w", "dj", "noise", "dt", "psd"]
    return _function(
        "transition",
        dict(zip(names, inputs, strict=True)),
        dict(zip(("x_after", "phi", "g"), (after, *rows), strict=True)),
    )


def moving_dim(layout: StateLayout) -> int:
    """Error components that the process moves; they come first."""
    return sum(block.dimension for block in layout.moving)


def transition_pattern(layout: StateLayout) -> tuple[list[list[int]], list[list[int]]]:
    """Columns of structural non-zeros of each moving row of transition and noise factor."""
    _, (_, transition, factor) = transition_expression(layout)
    moving = moving_dim(layout)
    return _columns_by_row(transition[:moving, :]), _columns_by_row(factor[:moving, :])


def correction_function(layout: StateLayout) -> ca.Function:
    """x [+] d, and the reset Jacobians less the identity.

    They are of attitude (3 x 3) and mass distribution (5 x 5).
    """
    x, d = ca.SX.sym("x", layout.mean_dim), ca.SX.sym("d", layout.error_dim)
    before, y = layout.unpack(x), {}
    moved = ca.SX()
    for block in layout.members:
        value, error = before[block.symbol], d[layout.slice(block.name)]
        if block is MASS_DISTRIBUTION:
            y[block.symbol], moved = mass_correction(value, error)
            continue
        y[block.symbol] = block.chart.retract(value, error)
        if block.chart.normalised is not None:
            y[block.symbol] = block.chart.normalised(y[block.symbol])
    attitude = row_by_row(attitude_reset(d[layout.slice("a")]))
    outputs = {"y": layout.pack(y), "moved_a": attitude, "moved_s": row_by_row(moved)}
    return _function("correction", {"x": x, "d": d}, outputs)


def measurement_function(model: MeasurementModel) -> ca.Function:
    """Whitened innovation, Jacobian by the `seen_columns`, and validity of a sensor without landmarks."""
    x, p, z = (
        ca.SX.sym("x", model.layout.mean_dim),
        ca.SX.sym("p", model.parameter_dim),
        ca.SX.sym("z", model.value_dim),
    )
    d = ca.SX.sym("d", model.layout.error_dim)
    state = model.layout.unpack(x)
    moved = model.layout.unpack(model.layout.retract_expression(x, d))
    away = model.innovation(model.symbolic(moved, p), z)
    here = model.innovation(model.symbolic(state, p), z)
    seen = list(seen_columns(model))
    jacobian = -error_derivative(away, d, seen)
    root = ca.SX(model.noise_factor(state, p))
    outputs = {
        "rho": _solve_lower(root, here),
        "h": row_by_row(_solve_lower(root, jacobian)),
        "valid": model.valid(state, p),
    }
    return _function(model.name, {"x": x, "p": p, "z": z}, outputs)


def seen_columns(model: MeasurementModel) -> range:
    """Error components from the first to the last that a sensor depends on; those between have zeros in its Jacobian."""
    return range(min(model.columns), max(model.columns) + 1)


def landmark_functions(model: LandmarkSensor) -> list[ca.Function]:
    """A landmark sensor's observation, and its inverse.

    Both of the landmark's point y in frame i (3, m).
    Such a sensor sees the state through y = t + R_ig p alone, so how an observation depends on pose and landmark follows from how
    it depends on y. The sensor's own function: whitened innovation, its derivative by y (3 x 3), validity. ``new``: y, root of the
    covariance that the sensor's noise gives it (3 x 3), whether it is determined.
    """
    y, z = ca.SX.sym("y", POINT), ca.SX.sym("z", model.value_dim)
    camera = ca.SX.sym("camera", model.parameter_dim - POINT)
    p = ca.vertcat(ca.SX.zeros(POINT), camera)
    origin = model.layout.unpack(ca.SX(ca.DM(model.layout.origin())))
    state = origin | {"t": y}
    here, root = model.innovation(model.symbolic(state, p), z), ca.SX(model.noise_factor(state, p))
    observed = {
        "rho": _solve_lower(root, here),
        "by_y": row_by_row(_solve_lower(root, -ca.jacobian(here, y))),
        "valid": model.valid(state, p),
    }
    made = model.landmark(origin, z, p)
    told = ca.fmin(model.determined(z, p), model.valid(origin | {"t": made}, p))
    new = {"y": made, "spread": row_by_row(ca.jacobian(made, z) @ root), "told": told}
    return [
        _function(model.name, {"y": y, "camera": camera, "z": z}, observed),
        _function(f"new_{model.name}", {"camera": camera, "z": z}, new),
    ]


def rotation_function(layout: StateLayout) -> ca.Function:
    """R_ig (3 x 3) of a state."""
    x = ca.SX.sym("x", layout.mean_dim)
    rotation = matrix_from_quaternion(layout.unpack(x)["q"])
    return _function("rotation", {"x": x}, {"r": row_by_row(rotation)})


class _DiscreteStep(NamedTuple):
    """State before a step, q_ig after it, dt (s), the force's noise density."""

    x: ca.SX
    q_after: ca.SX
    dt: ca.SX
    force_psd: ca.SX


def _translate(
    layout: StateLayout, step: _DiscreteStep, transition: ca.SX, factor: ca.SX
) -> dict[str, Expression]:
    """Fill in the rows of t and v, give them after the step.

    t + R c + dt v - R' c, and where the state has a constant acceleration f: dt^2 / 2 f more of t, v + dt f.
    """
    values, dt = layout.unpack(step.x), step.dt
    t, a, v, w, c, s = (layout.slice(name) for name in ("t", "a", "v", "w", "c", "s"))
    before, after = matrix_from_quaternion(values["q"]), matrix_from_quaternion(step.q_after)
    lever, lever_after = before @ ca.skew(values["c"]), after @ ca.skew(values["c"])
    transition[t, a] = lever_after @ transition[a, a] - lever
    transition[t, w], transition[t, s] = lever_after @ transition[a, w], lever_after @ transition[a, s]
    transition[t, v], transition[t, c] = dt * ca.SX.eye(3), before - after
    root = ca.sqrt(step.force_psd) * ca.sqrt(dt)
    factor[t, :6] = lever_after @ factor[a, :6]
    factor[t, 6:9] = root * dt / np.sqrt(3) * ca.SX.eye(3)
    factor[v, 6:9], factor[v, 9:12] = root * np.sqrt(3) / 2 * ca.SX.eye(3), root / 2 * ca.SX.eye(3)
    moved = {
        "t": values["t"] + dt * values["v"] + (before - after) @ values["c"],
        "v": values["v"],
    }
    if layout.has(ACCELERATION):
        f = layout.slice(ACCELERATION.name)
        transition[t, f], transition[v, f] = dt**2 / 2 * ca.SX.eye(3), dt * ca.SX.eye(3)
        moved["t"] += dt**2 / 2 * values["f"]
        moved["v"] += dt * values["f"]
    return moved


def _function(name: str, inputs: Mapping[str, ca.SX], outputs: Mapping[str, Expression]) -> ca.Function:
    """A CasADi function with dense outputs, zeros written too: the C that reads them knows no sparsity."""
    dense = [ca.densify(ca.SX(each)) for each in outputs.values()]
    return ca.Function(name, list(inputs.values()), dense, list(inputs), list(outputs), SHARED)


def _solve_lower(root: ca.SX, right: ca.SX) -> ca.SX:
    """root^-1 right by forward substitution; root is lower triangular."""
    rows: list[ca.SX] = []
    for k in range(root.shape[0]):
        row = right[k, :]
        for j in range(k):
            row = row - root[k, j] * rows[j]
        rows.append(row / root[k, k])
    return ca.vertcat(*rows)


def _symmetric(entries: ca.SX) -> ca.SX:
    """6 x 6 from its lower triangle, row by row."""
    index = {(i, j): i * (i + 1) // 2 + j for i in range(6) for j in range(i + 1)}
    return ca.vertcat(
        *[ca.horzcat(*[entries[index[max(i, j), min(i, j)]] for j in range(6)]) for i in range(6)]
    )


def _columns_by_row(matrix: ca.SX) -> list[list[int]]:
    sparse = ca.sparsify(matrix).T  # its columns are the rows
    starts, columns = sparse.sparsity().colind(), sparse.sparsity().row()
    return [columns[starts[k] : starts[k + 1]] for k in range(matrix.shape[0])]


def _nonzeros_by_row(matrix: ca.SX) -> ca.SX:
    sparse = ca.sparsify(matrix).T
    return ca.vertcat(*sparse.nonzeros())  # pyright: ignore[reportCallIssue, reportArgumentType]
