"""Attitude in textbook notation over CasADi types.

SX, MX or DM: column vectors in, column vectors out.
Quaternions are Hamilton, scalar last; an attitude error is 4 x MRP on the body side (see `conventions`).
Every representation has a way to and from the unit quaternion, so any pair is joined by two calls. Both
branches of an `if_else` are differentiated, so each is finite for every input: denominators are guarded where
they are not used.
"""

from typing import TYPE_CHECKING, Any

import casadi as ca

if TYPE_CHECKING:
    Expression = Any
else:
    Expression = ca.SX | ca.MX | ca.DM
"""Any CasADi matrix. Type stubs cannot say "the same one of three throughout", so the checker sees Any."""

SMALL_SQUARE = 1e-4
"""Square of the half angle in rad, or of its sine, below which a series replaces a quotient 0/0; the largest
dropped term of all series, x^4 / 9, is then a twentieth of double precision's rounding."""

GIMBAL_LOCK = 1e-15
"""Half-angle amplitude below which rounding decides between yaw and roll: roll is then called 0."""
SMALLEST_SQUARE = 1e-290
"""|v|^2 below which a unit quaternion [v, w] rotates about no axis that double precision can resolve."""


def cross_matrix(v: Expression) -> Expression:
    """[v x], so that [v x] u = v x u (Tweddle 2013, Eq. 2.16)."""
    return ca.skew(v)


def product(q: Expression, p: Expression) -> Expression:
    """q (x) p with R(q (x) p) = R(q) R(p) (Tweddle 2013, Eq. 2.31; the sign in 2.30 is corrected)."""
    vector = q[3] * p[:3] + p[3] * q[:3] + ca.cross(q[:3], p[:3])
    return ca.vertcat(vector, q[3] * p[3] - ca.dot(q[:3], p[:3]))


def conjugate(q: Expression) -> Expression:
    """Inverse of a unit quaternion (Tweddle 2013, Eq. 2.28)."""
    return ca.vertcat(-q[:3], q[3])


def normalised(q: Expression) -> Expression:
    """q / |q|."""
    return q / ca.sqrt(ca.dot(q, q))


def matrix_from_quaternion(q: Expression) -> Expression:
    """R_ab of the unit quaternion q_ab (3 x 3)."""
    v, s = q[:3], q[3]
    return (s * s - ca.dot(v, v)) * ca.DM.eye(3) + 2 * v @ v.T + 2 * s * cross_matrix(v)


def rotate(q: Expression, v: Expression) -> Expression:
    """R(q) v without forming R (3)."""
    u = 2 * ca.cross(q[:3], v)
    return v + q[3] * u + ca.cross(q[:3], u)


def angle_between(q: Expression, p: Expression) -> Expression:
    """Angle in [0, pi] between attitudes q and p of either sign, 4 atan2(|q - p|, |q + p|) (Kahan).

    Differences of close quaternions are exact, so tiny angles are not lost as in 2 acos(q . p). Not differentiable at 0.
    """
    p = ca.if_else(ca.dot(q, p) < 0, -1, 1) * p
    return 4 * ca.atan2(ca.norm_2(q - p), ca.norm_2(q + p))


def quaternion_from_matrix(R: Expression) -> Expression:
    """Unit quaternion of the rotation matrix R, with a scalar part that is not negative.

    4 q q' is linear in R; its column with the largest diagonal element has a norm of at least 2, so nothing
    cancels at any angle (Shepperd, J. Guidance and Control 1(3), 1978, normalised at the end).
    """
    xy, yz, zx = R[0, 1] + R[1, 0], R[1, 2] + R[2, 1], R[2, 0] + R[0, 2]
    x, y, z = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    r = (R[0, 0], R[1, 1], R[2, 2])
    columns = [
        (1 + r[0] - r[1] - r[2], ca.vertcat(1 + r[0] - r[1] - r[2], xy, zx, x)),
        (1 - r[0] + r[1] - r[2], ca.vertcat(xy, 1 - r[0] + r[1] - r[2], yz, y)),
        (1 - r[0] - r[1] + r[2], ca.vertcat(zx, yz, 1 - r[0] - r[1] + r[2], z)),
        (1 + r[0] + r[1] + r[2], ca.vertcat(x, y, z, 1 + r[0] + r[1] + r[2])),
    ]
    largest, column = columns[0]
    for size, each in columns[1:]:
        column = ca.if_else(size > largest, each, column)
        largest = ca.if_else(size > largest, size, largest)
    return normalised(_short_way(column))


def quaternion_from_rotation_vector(r: Expression) -> Expression:
    """Unit quaternion of the rotation by |r| rad about r, any |r| (Tweddle 2013, Eq. 2.17)."""
    x = ca.dot(r, r) / 4
    small = x < SMALL_SQUARE
    half = ca.sqrt(ca.if_else(small, 1, x))
    sine_over_half = ca.if_else(small, 1 - x / 6 + x**2 / 120 - x**3 / 5040, ca.sin(half) / half)
    cosine = ca.if_else(small, 1 - x / 2 + x**2 / 24 - x**3 / 720, ca.cos(half))
    return ca.vertcat(sine_over_half * r / 2, cosine)


def rotation_vector_from_quaternion(q: Expression) -> Expression:
    """Rotation vector in rad of the short way round, |r| <= pi; at pi its sign is that of q's vector part."""
    q = _short_way(q)
    square, scalar = ca.dot(q[:3], q[:3]), q[3]
    small = square < SMALL_SQUARE
    x = square / ca.if_else(small, scalar, 1) ** 2
    sine = ca.sqrt(ca.if_else(small, 1, square))
    series = 2 * (1 - x / 3 + x**2 / 5 - x**3 / 7) / ca.if_else(small, scalar, 1)
    return ca.if_else(small, series, 2 * ca.atan2(sine, scalar) / sine) * q[:3]


def quaternion_from_euler321(angles: Expression) -> Expression:
    """q_ib of [psi, theta, phi] = yaw, pitch, roll in rad: R_ib = Rz(psi) Ry(theta) Rx(phi).

    Rz, Ry, Rx turn vectors right-handedly, so R_ib maps body to inertial. Tweddle 2013, Eq. 2.14, is its
    transpose, the inertial-to-body matrix.
    """
    c, s = ca.cos(angles / 2), ca.sin(angles / 2)
    yaw, pitch, roll = (ca.vertcat(ca.DM.eye(3)[:, axis] * s[k], c[k]) for k, axis in enumerate((2, 1, 0)))
    return product(product(yaw, pitch), roll)


def quaternion_from_mrp(a: Expression) -> Expression:
    """Unit quaternion of the 4 x MRP `a` (Tweddle 2013, Eq. 2.35)."""
    square = ca.dot(a, a)
    return ca.vertcat(8 * a, 16 - square) / (16 + square)


def mrp_from_quaternion(q: Expression) -> Expression:
    """4 x MRP of a unit quaternion, singular at q = [0, 0, 0, -1] (Tweddle 2013, Eq. 2.34)."""
    return 4 * q[:3] / (1 + q[3])


def short_mrp_from_quaternion(q: Expression) -> Expression:
    """4 x MRP of the short way round, |a| <= 4: that of q or -q, whichever has no negative scalar part."""
    return mrp_from_quaternion(_short_way(q))


def shadow_mrp(a: Expression) -> Expression:
    """The other 4 x MRP of the same attitude, -16 a / |a|^2: that of -q, undefined at a = 0."""
    return -16 * a / ca.dot(a, a)


def quaternion_from_axis_angle(axis: Expression, angle: Expression) -> Expression:
    """Unit quaternion of the rotation by ``angle`` rad about a unit ``axis`` (Tweddle 2013, Eq. 2.17)."""
    return ca.vertcat(axis * ca.sin(angle / 2), ca.cos(angle / 2))


def axis_angle_from_quaternion(q: Expression) -> tuple[Expression, Expression]:
    """Unit axis (3) and angle in [0, pi] of the short way round; no rotation has axis x and angle 0."""
    q = _short_way(q)
    square = ca.dot(q[:3], q[:3])
    none = square < SMALLEST_SQUARE
    sine = ca.sqrt(ca.if_else(none, 1, square))
    return ca.if_else(none, ca.DM([1, 0, 0]), q[:3] / sine), ca.if_else(none, 0, 2 * ca.atan2(sine, q[3]))


def euler321_from_quaternion(q: Expression) -> Expression:
    """Yaw, pitch and roll [psi, theta, phi] of q_ib: |psi|, |phi| <= pi, |theta| <= pi/2; not differentiable at theta = +-pi/2.

    With A, B = cos(theta/2) +- sin(theta/2), the product in `quaternion_from_euler321` gives
    [w + y, z - x] = A [cos, sin]((psi - phi)/2) and [w - y, z + x] = B [cos, sin]((psi + phi)/2).
    The angles rebuild q to rounding even where yaw and roll are ill conditioned
    (after Bernardes and Viollet, PLoS ONE 17(11), 2022).
    """
    x, y, z, w = q[0], q[1], q[2], q[3]
    A, B = ca.sqrt((w + y) ** 2 + (z - x) ** 2), ca.sqrt((w - y) ** 2 + (z + x) ** 2)
    difference, total = ca.atan2(z - x, w + y), ca.atan2(z + x, w - y)
    half_difference = ca.if_else(A < GIMBAL_LOCK, total, difference)
    half_sum = ca.if_else(B < GIMBAL_LOCK, difference, total)
    theta = 2 * ca.atan2(A - B, A + B)
    return ca.vertcat(_wrap_angle(half_sum + half_difference), theta, _wrap_angle(half_sum - half_difference))


def quaternion_rate(q: Expression, w: Expression) -> Expression:
    """q_ib' = q (x) [w, 0] / 2 for a body rate w in rad/s (Tweddle 2013, Eq. 2.39, for q body to inertial)."""
    return product(q, ca.vertcat(w, 0)) / 2


def linear_rate_rotation(w0: Expression, w1: Expression, dt: Expression) -> Expression:
    """Rotation vector (end to start) of dt seconds at a body rate that goes linearly from w0 to w1 (rad/s).

    (w0 + w1) dt/2 + (w0 x w1) dt^2/12: the Magnus series to its coning term, with an error of order dt^5 (Blanes et al., Physics
    Reports 470, 2009; for a right factor, q' = q (x) [w, 0] / 2).
    """
    return dt * (w0 + w1) / 2 + dt**2 / 12 * ca.cross(w0, w1)


def _wrap_angle(angle: Expression) -> Expression:
    """The angle in (-pi, pi] of one within (-3 pi, 3 pi)."""
    return angle - ca.if_else(angle > ca.pi, 2 * ca.pi, 0) + ca.if_else(angle < -ca.pi, 2 * ca.pi, 0)


def _short_way(q: Expression) -> Expression:
    return ca.if_else(q[3] < 0, -1, 1) * q
