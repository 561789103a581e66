"""Attitude on NumPy arrays: every representation to and from the unit quaternion, over any leading axes.

The formulas are those of `spinfilters.core.attitude_expressions`, interpreted until they have been called so often
that compiled C repays, so that a single call never waits for a compiler; they are built at their first call. Quaternions are
Hamilton, scalar last, q_ab maps b to a (`spinfilters.core.conventions`); within `UNIT_TOLERANCE` of unit norm they are normalised.
Batch axes broadcast.

Errors of every function: ShapeError for a wrong trailing shape, InputError for values that are not finite and
for quaternions, axes and matrices that are not a rotation; the text names the value.
"""

from collections.abc import Callable
from functools import cache
from inspect import signature
from typing import Any, Final

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.core import attitude_expressions as expressions
from spinfilters.core.compiled import Compiled
from spinfilters.core.errors import InputError, ShapeError
from spinfilters.core.working_time import building

Angles = Float[np.ndarray, "*batch"]
Vectors = Float[np.ndarray, "*batch 3"]
Quaternions = Float[np.ndarray, "*batch 4"]
Matrices = Float[np.ndarray, "*batch 3 3"]

UNIT_TOLERANCE: Final[float] = 1e-6
"""A norm further than this from 1 is a mistake of the caller (a wrong column, say), not rounding."""


def matrix_from_quaternion(q: Quaternions) -> Matrices:
    """R_ab of q_ab."""
    return _numeric(expressions.matrix_from_quaternion, 4)(_unit("q", q))[0]


def quaternion_from_matrix(R: Matrices) -> Quaternions:
    """q_ab of R_ab with a non-negative scalar part, accurate at every angle, 180 degrees included."""
    R = finite_array("R", R, 3, 3)
    off = np.abs(np.swapaxes(R, -1, -2) @ R - np.eye(3)).max(axis=(-2, -1))
    _require(off <= UNIT_TOLERANCE, "R", R, "is not orthonormal")
    _require(np.linalg.det(R) > 0, "R", R, "is a reflection, not a rotation")
    return _numeric(expressions.quaternion_from_matrix, (3, 3))(R)[0]


def quaternion_from_mrp(a: Vectors) -> Quaternions:
    """Quaternion of a 4 x MRP a = 4 tan(angle/4) n (Tweddle 2013, Eq. 2.35)."""
    return _numeric(expressions.quaternion_from_mrp, 3)(finite_array("a", a, 3))[0]


def mrp_from_quaternion(q: Quaternions) -> Vectors:
    """4 x MRP of the short way round, |a| <= 4 (Tweddle 2013, Eq. 2.34)."""
    return _numeric(expressions.short_mrp_from_quaternion, 4)(_unit("q", q))[0]


def quaternion_from_rotation_vector(r: Vectors) -> Quaternions:
    """Quaternion of the rotation by |r| rad about r, of any length."""
    return _numeric(expressions.quaternion_from_rotation_vector, 3)(finite_array("r", r, 3))[0]


def rotation_vector_from_quaternion(q: Quaternions) -> Vectors:
    """Rotation vector of the short way round, |r| <= pi rad."""
    return _numeric(expressions.rotation_vector_from_quaternion, 4)(_unit("q", q))[0]


def matrix_from_rotation_vector(r: Vectors) -> Matrices:
    """Matrix of the rotation by |r| rad about r, of any length."""
    return matrix_from_quaternion(quaternion_from_rotation_vector(r))


def rotation_vector_from_matrix(R: Matrices) -> Vectors:
    """Rotation vector of the short way round, |r| <= pi rad; its length is the angle."""
    return rotation_vector_from_quaternion(quaternion_from_matrix(R))


def angle_from_matrix(R: Matrices) -> Angles:
    """Angle of rotation matrices in [0, pi] rad, accurate for tiny angles."""
    return np.linalg.norm(rotation_vector_from_matrix(R), axis=-1)


def cross_matrix(v: Vectors) -> Matrices:
    """[v x], with [v x] u = v x u."""
    x, y, z = np.moveaxis(v, -1, 0)
    zero = np.zeros_like(x)
    rows = [np.stack(row, axis=-1) for row in ((zero, -z, y), (z, zero, -x), (-y, x, zero))]
    return np.stack(rows, axis=-2)


def axial_vector(A: Matrices) -> Vectors:
    """The v whose [v x] is the antisymmetric part of A; what is symmetric is no rotation."""
    skew = (A - np.swapaxes(A, -1, -2)) / 2
    return np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], axis=-1)


def quaternion_from_euler321(angles: Vectors) -> Quaternions:
    """q_ib of yaw, pitch and roll [psi, theta, phi] in rad, of any size: R_ib = Rz(psi) Ry(theta) Rx(phi).

    R_ib maps body to inertial. It is the transpose of Tweddle 2013, Eq. 2.14, which is printed inertial to body.
    """
    return _numeric(expressions.quaternion_from_euler321, 3)(finite_array("angles", angles, 3))[0]


def euler321_from_quaternion(q: Quaternions) -> Vectors:
    """Yaw, pitch and roll [psi, theta, phi] of q_ib, rad: |psi|, |phi| <= pi, |theta| <= pi/2; roll is 0 in gimbal lock."""
    return _numeric(expressions.euler321_from_quaternion, 4)(_unit("q", q))[0]


def quaternion_from_axis_angle(axis: Vectors, angle: Angles | float) -> Quaternions:
    """Quaternion of the rotation by ``angle`` rad about the unit vector ``axis`` (Tweddle 2013, Eq. 2.17)."""
    angle = finite_array("angle", angle)[..., np.newaxis]
    return _numeric(expressions.quaternion_from_axis_angle, 3, 1)(_unit("axis", axis, 3), angle)[0]


def axis_angle_from_quaternion(q: Quaternions) -> tuple[Vectors, Angles]:
    """Unit axis and angle in [0, pi] rad of the short way round; no rotation has axis x and angle 0."""
    axis, angle = _numeric(expressions.axis_angle_from_quaternion, 4)(_unit("q", q))
    return axis, angle[..., 0]


def unit_quaternion(q: Quaternions) -> Quaternions:
    """The quaternion normalised; InputError where its norm is further than `UNIT_TOLERANCE` from one."""
    return _unit("q", q)


def multiply(q: Quaternions, p: Quaternions) -> Quaternions:
    """q_ab (x) p_bc = q_ac, with R(q (x) p) = R(q) R(p)."""
    return _numeric(expressions.product, 4, 4)(_unit("q", q), _unit("p", p))[0]


def quaternion_product(
    left: Float[np.ndarray, "*#batch 4"], right: Float[np.ndarray, "*#batch 4"]
) -> Float[np.ndarray, "*#batch 4"]:
    """Hamilton product of quaternions of any norm, as `multiply` but unchecked: R(product) = R(left) R(right)."""
    v, s, u, w = left[..., :3], left[..., 3:], right[..., :3], right[..., 3:]
    vector = s * u + w * v + np.cross(v, u)
    scalar = s * w - np.sum(v * u, axis=-1, keepdims=True)
    return np.concatenate([vector, scalar], axis=-1)


def inverse(q: Quaternions) -> Quaternions:
    """q_ba of q_ab."""
    return _numeric(expressions.conjugate, 4)(_unit("q", q))[0]


def rotate(q: Quaternions, v: Vectors) -> Vectors:
    """v_a = R(q_ab) v_b, in the unit of v."""
    return _numeric(expressions.rotate, 4, 3)(_unit("q", q), finite_array("v", v, 3))[0]


def rotation_between(q: Quaternions, p: Quaternions) -> Vectors:
    """Rotation vector in rad from q_ab to p_ac, in axes b: p = q (x) exp(r)."""
    return rotation_vector_from_quaternion(multiply(inverse(q), p))


def angle_between(q: Quaternions, p: Quaternions) -> Angles:
    """Angle in [0, pi] rad between two attitudes, accurate for tiny angles and for either sign of q and p."""
    return _numeric(expressions.angle_between, 4, 4)(_unit("q", q), _unit("p", p))[0][..., 0]


def continuous_quaternions(q: Float[np.ndarray, "n *batch 4"]) -> Float[np.ndarray, "n *batch 4"]:
    """The same attitudes with continuous signs along the first axis: each has the sign nearest to its predecessor."""
    unit = _unit("q", q)
    if unit.ndim < 2:
        raise ShapeError(f"q must have shape (n, ..., 4), got {unit.shape}")
    flips = np.where(np.einsum("...i,...i->...", unit[1:], unit[:-1]) < 0, -1.0, 1.0)
    return np.concatenate([q[:1], q[1:] * np.cumprod(flips, axis=0)[..., np.newaxis]])


def integrate_gyro(
    time: Float[np.ndarray, " n"], rate: Float[np.ndarray, "n 3"], attitude0: Float[np.ndarray, "4"]
) -> Float[np.ndarray, "n 4"]:
    """q_ib at every stamp of a gyro log, from q_ib = ``attitude0``.

    The signs are continuous.
    The rate (rad/s, body axes, free of bias) is taken as linear between stamps, which need not be evenly
    spaced; each step is the turn of `expressions.linear_rate_rotation`. The error is of fourth order in the
    spacing where the rate is linear between stamps, of second order where it is curved.

    Raises
    ------
    InputError
        When the stamps (s) do not increase.
    ShapeError
        When there is no stamp, or not one rate per stamp.
    """
    time, rate = finite_array("time", time), finite_array("rate", rate, 3)
    if time.ndim != 1 or not len(time) or rate.shape != (len(time), 3):
        raise ShapeError(f"time must be (n,) with n > 0 and rate (n, 3), got {time.shape} and {rate.shape}")
    if np.shape(attitude0) != (4,):
        raise ShapeError(f"attitude0 must have shape (4,), got {np.shape(attitude0)}")
    spacing = np.diff(time)
    _require(spacing > 0, "time step", spacing, "s is not positive; sort the log and drop repeats")
    turn = _numeric(expressions.linear_rate_rotation, 3, 3, 1)
    (turns,) = turn(rate[:-1], rate[1:], spacing[:, np.newaxis])
    steps = quaternion_from_rotation_vector(turns)
    return _prefix_products(np.concatenate([_unit("attitude0", attitude0)[np.newaxis], steps]))


def _prefix_products(q: np.ndarray) -> np.ndarray:
    """Prefix products q_0, q_0 (x) q_1, ... by recursive pairing.

    Rounding grows with log n instead of n, and a level of the recursion is two vectorised products.
    """
    count = len(q)
    if count < 2:
        return q
    result = q.copy()
    result[1::2] = _prefix_products(multiply(q[: count - 1 : 2], q[1::2]))
    result[2::2] = multiply(result[1 : count - 1 : 2], q[2::2])
    return result


@cache
@building()
def _numeric(expression: Callable[..., Any], *shapes: int | tuple[int, int]) -> Compiled:
    """The expression on arrays, its inputs named as its parameters and shaped as given."""
    names = list(signature(expression).parameters)
    sizes = [shape if isinstance(shape, tuple) else (shape, 1) for shape in shapes]
    symbols = [ca.SX.sym(name, *size) for name, size in zip(names, sizes, strict=True)]
    outputs = expression(*symbols)
    listed = outputs if isinstance(outputs, tuple) else (outputs,)
    outputs_named = [f"y{k}" for k in range(len(listed))]
    return Compiled.late(ca.Function(expression.__name__, symbols, listed, names, outputs_named))


def finite_array(name: str, value: np.ndarray | float, *trailing: int) -> np.ndarray:
    """The value as float64, any leading axes before those of the shape ``trailing``.

    Raises
    ------
    ShapeError
        Another shape.
    InputError
        NaN or infinity; it names the first such item.
    """
    array = np.asarray(value, dtype=np.float64)
    if array.shape[array.ndim - len(trailing) :] != trailing or array.ndim < len(trailing):
        raise ShapeError(f"{name} must end in shape {trailing}, got {array.shape}")
    _require(np.isfinite(array), name, array, "is not finite; replace NaN and infinity by numbers")
    return array


def _unit(name: str, value: np.ndarray, size: int = 4) -> np.ndarray:
    array = finite_array(name, value, size)
    norm = np.linalg.norm(array, axis=-1, keepdims=True)
    _require(np.abs(norm[..., 0] - 1) <= UNIT_TOLERANCE, name, array, "is not of unit norm; normalise it")
    return array / norm


def _require(good: np.ndarray, name: str, value: np.ndarray, complaint: str) -> None:
    """InputError naming the first item of ``value`` whose ``good`` (over leading axes of value) is False."""
    if not np.all(good):
        index = tuple(map(int, np.argwhere(~good)[0]))
        where = f"[{', '.join(map(str, index))}]" if index else ""
        raise InputError(f"{name}{where} = {value[index]} {complaint}")
