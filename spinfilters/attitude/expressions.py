"""Attitude in textbook notation over CasADi types (SX, MX or DM): column vectors in, column vectors out.

Quaternions are Hamilton, scalar last; an attitude error is 4 x MRP on the body side (see `spinfilters.conventions`).
"""

import casadi as ca

Expression = ca.SX | ca.MX | ca.DM
"""Any CasADi matrix."""


def cross_matrix(v: Expression) -> Expression:
    """[v x], so that [v x] u = v x u (Tweddle 2013, Eq. 2.16)."""
    return ca.skew(v)


def product(q: Expression, p: Expression) -> Expression:
    """q (x) p with R(q (x) p) = R(q) R(p) (Tweddle 2013, Eq. 2.31; the sign in 2.30 is corrected)."""
    return ca.vertcat(q[3] * p[:3] + p[3] * q[:3] + ca.cross(q[:3], p[:3]), q[3] * p[3] - ca.dot(q[:3], p[:3]))


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


def quaternion_from_mrp(a: Expression) -> Expression:
    """Unit quaternion of the 4 x MRP `a` (Tweddle 2013, Eq. 2.35)."""
    square = ca.dot(a, a)
    return ca.vertcat(8 * a, 16 - square) / (16 + square)


def mrp_from_quaternion(q: Expression) -> Expression:
    """4 x MRP of a unit quaternion, singular at q = [0, 0, 0, -1] (Tweddle 2013, Eq. 2.34)."""
    return 4 * q[:3] / (1 + q[3])


def short_mrp_from_quaternion(q: Expression) -> Expression:
    """4 x MRP of the short way round: of q or -q, whichever has a non-negative scalar part, so |a| <= 4."""
    sign = ca.if_else(q[3] < 0, -1, 1)
    return mrp_from_quaternion(sign * q)


def shadow_mrp(a: Expression) -> Expression:
    """The other 4 x MRP of the same attitude, -16 a / |a|^2: the MRP of -q. Undefined at a = 0."""
    return -16 * a / ca.dot(a, a)


def quaternion_rate(q: Expression, w: Expression) -> Expression:
    """q_ib' = q (x) [w, 0] / 2 for a rate in body axes, rad/s (Tweddle 2013, Eq. 2.39, for q body to inertial)."""
    return product(q, ca.vertcat(w, 0)) / 2


def mrp_rate(a: Expression, w: Expression) -> Expression:
    """Rate of the 4 x MRP of q_ib for a body rate w: ((1 - |a|^2/16) I + [a x]/2 + a a'/8) w (Eq. 2.47, body to inertial)."""
    return (1 - ca.dot(a, a) / 16) * w + ca.cross(a, w) / 2 + a * ca.dot(a, w) / 8
