"""Gauge of the geometric frame g.

Moving g against the body changes every number of the state and no measurement.
A move (theta, rho) takes a point p_g to R(theta) p_g + rho. With it

    q_ig -> q_ig (x) dq(-theta),  t -> t - R_ig R(theta)' rho,  w -> R w,  c -> R c + rho,  S -> R S R',  v -> v,  b -> R b,

the motion, the centre of mass in i and every observation stay what they were: six directions of the state in which only the
definition
of g, and nothing observed, may put information.
"""

from functools import cache

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_expressions import (
    Expression,
    matrix_from_quaternion,
    product,
    quaternion_from_mrp,
    rotate,
)
from spinfilters.core.compiled import Compiled
from spinfilters.core.working_time import building
from spinfilters.models.state_layout import StateLayout, error_derivative

GAUGE_DIM = 6
"""Rotation vector theta (rad), then translation rho (m), both in g axes."""
GAUGE_STD = 1e-6
"""Of a pose that defines a frame, m and rad."""


def gauge_move(layout: StateLayout, x: Expression, move: Expression) -> Expression:
    """The state after frame g has been moved by (theta, rho), theta as 4 x MRP; it describes the same motion."""
    values = layout.unpack(x)
    turn, rho = quaternion_from_mrp(move[:3]), move[3:]
    R = matrix_from_quaternion(turn)
    moved = dict(values)
    for block in layout.members:
        if block.after_gauge_move is not None:
            moved[block.symbol] = block.after_gauge_move(values[block.symbol], R, rho)
    moved["q"] = product(values["q"], quaternion_from_mrp(-move[:3]))
    if layout.translates:
        moved["t"] = values["t"] - rotate(moved["q"], rho)
    return layout.pack(moved)


def gauge_directions(
    layout: StateLayout, x: Float[np.ndarray, "*batch m"]
) -> Float[np.ndarray, "*batch n 6"]:
    """Errors of the state at ``x`` per unit of (theta, rho)."""
    return gauge_function(layout)(x)[0]


def gauge_of_points(points: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "l 6"]:
    """Jacobian (3 k, 6) of landmarks by the gauge move (theta, rho): theta x p + rho."""
    x, y, z = points.T
    zero = np.zeros(len(points))
    # row by row of each 3 x 3 block: -[p x], what a rotation of the frame does to the point
    turn = np.stack([zero, z, -y, -z, zero, x, y, -x, zero], axis=1).reshape(-1, 3, 3)
    shift = np.broadcast_to(np.eye(3), turn.shape)
    return np.concatenate([turn, shift], axis=2).reshape(-1, GAUGE_DIM)


def state_in_g(
    layout: StateLayout,
    mean: Float[np.ndarray, " m"],
    factor: Float[np.ndarray, "N N"],
    move: Float[np.ndarray, " 6"],
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "n N"]]:
    """State and factor rows in frame g, from the map's frame.

    The gauge move stands last in the factor.
    The move is small: the derivative of the moved state by the state is taken for one.
    """
    there = _moved_state(layout)(mean, move)[0]
    return there, factor[: layout.error_dim] + gauge_directions(layout, there) @ factor[-GAUGE_DIM:]


def moved_points(points: Float[np.ndarray, "k 3"], move: Float[np.ndarray, " 6"]) -> Float[np.ndarray, "k 3"]:
    """R(theta) p + rho."""
    return _moved_point()(points, move)[0]


@cache
@building()
def gauge_function(layout: StateLayout) -> Compiled:
    """`gauge_directions` as a compiled function."""
    x, move = ca.SX.sym("x", layout.mean_dim), ca.SX.sym("move", GAUGE_DIM)
    error = layout.near_local_expression(x, gauge_move(layout, x, move))
    return Compiled(ca.Function("gauge_directions", [x], [error_derivative(error, move)], ["x"], ["N"]))


@cache
@building()
def _moved_state(layout: StateLayout) -> Compiled:
    x, move = ca.SX.sym("x", layout.mean_dim), ca.SX.sym("move", GAUGE_DIM)
    return Compiled(ca.Function("moved_state", [x, move], [gauge_move(layout, x, move)]))


@cache
@building()
def _moved_point() -> Compiled:
    p, move = ca.SX.sym("p", 3), ca.SX.sym("move", GAUGE_DIM)
    return Compiled(
        ca.Function("moved_point", [p, move], [rotate(quaternion_from_mrp(move[:3]), p) + move[3:]])
    )
