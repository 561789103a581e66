"""Correction of the mean and reset Jacobian E = J - I.

Less the identity, accurate relative to themselves.
An update moves a constant by very little, which float must not lose beside one.

Attitude: with the MRP m = a / 4, J = ((1 - m'm) I - 2 [m x] + 2 m m') / (1 + m'm)^2.

Mass distribution: with exp(D/2) exp(D/2)' = L L', Q = L^-1 exp(D/2) is a rotation, and J takes a change X to Q (sinh(x)/x)(X) Q'
with x = ad_D / 2, a series in [D, [D, X]] that needs no scaling and squaring.
"""

import casadi as ca

from spinfilters.attitude.expressions import Expression
from spinfilters.dynamics.mass_distribution import lower_factor, traceless

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

    `spinfilters.dynamics.mass_distribution.retract_mass`; E is 5 x 5.
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
    """L - I of the lower Cholesky factor L of I + N, 3 x 3.

    Without a difference of numbers near one.
    """
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
