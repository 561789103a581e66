"""Mass distribution of a rigid body in five unconstrained numbers.

Every value is a physical body; moments and axes follow from them.

The second-moment matrix about the centre of mass, S = integral of p p' dm, is L L' with L lower triangular and of unit
determinant. ``s = (l_1, l_2, l_21, l_31, l_32)``: exp(l_1), exp(l_2), exp(-l_1 - l_2) stand on the diagonal of L and l_ij below
it. ``s = 0`` is the sphere. The inertia is J = tr(S) I - S up to scale, so the triangle inequality holds by construction, where
the thesis' chart k1, k2 (Tweddle 2013, Eqs 4.97-4.99) also admits impossible bodies.

An error of s is multiplicative, like that of the attitude: S(s [+] d) = L exp(D) L' with D symmetric and traceless,
``d = (D_11, D_22, D_21, D_31, D_32)``. Euler's equation depends on the logarithm of S almost linearly (along principal axes its
coefficients are tanh of half the differences of log S), so this is where a belief about a weakly observed body is nearly Gaussian.
In the numbers s themselves it is bent by far more than its width: on the thesis' motion the NEES of a converged batch fit reached
500 instead of 20.
"""

from functools import cache

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_expressions import Expression
from spinfilters.core.errors import InputError
from spinfilters.core.linear_algebra import SINGULAR
from spinfilters.core.working_time import building

DIMENSION = 5


def lower_factor(s: Expression) -> Expression:
    """L(s), 3 x 3, lower triangular with determinant one."""
    zero = 0 * s[0]
    return ca.vertcat(
        ca.horzcat(ca.exp(s[0]), zero, zero),
        ca.horzcat(s[2], ca.exp(s[1]), zero),
        ca.horzcat(s[3], s[4], ca.exp(-s[0] - s[1])),
    )


def second_moments(s: Expression) -> Expression:
    """S(s), 3 x 3, positive definite, determinant one."""
    L = lower_factor(s)
    return L @ L.T


def from_second_moments(S: Expression) -> Expression:
    """The s of a positive definite S, 3 x 3, of determinant one."""
    L = _cholesky(S)
    return ca.vertcat(ca.log(L[0, 0]), ca.log(L[1, 1]), L[1, 0], L[2, 0], L[2, 1])


def inertia(s: Expression) -> Expression:
    """J(s) in g axes up to scale, 3 x 3: tr(S) I - S."""
    S = second_moments(s)
    return ca.trace(S) * ca.DM.eye(3) - S


def retract_mass(s: Expression, d: Expression) -> Expression:
    """s [+] d: the mass distribution with S = L exp(D) L'."""
    root = exponential(traceless(d) / 2)
    A = _cholesky(root @ root.T)
    off = lower_factor(s) @ A
    return ca.vertcat(s[0] + ca.log(A[0, 0]), s[1] + ca.log(A[1, 1]), off[1, 0], off[2, 0], off[2, 1])


def local_mass(s: Expression, other: Expression) -> Expression:
    """The error d that takes s to another mass distribution: D = log(L^-1 S_other L^-T)."""
    return traceless_components(logarithm(_relative(s, other)))


def near_local_mass(s: Expression, other: Expression) -> Expression:
    """`local_mass` to first order in the difference, for derivatives at equality: no logarithm is formed."""
    return traceless_components(_relative(s, other) - ca.DM.eye(3))


def reset_mass_jacobian(d: Expression) -> Expression:
    """Jacobian (5 x 5) of the error about s [+] d by that about s, taken at d; it does not depend on s."""
    e = ca.SX.sym("e", DIMENSION)
    root = exponential(traceless(d) / 2)
    inverse = _lower_inverse(_cholesky(root @ root.T))
    moved = traceless_components(inverse @ exponential(traceless(e)) @ inverse.T)
    return ca.substitute(ca.jacobian(moved, e), e, d)


def inertia_matrix(s: Float[np.ndarray, " 5"]) -> Float[np.ndarray, "3 3"]:
    """J(s) in g axes up to scale, as numbers."""
    with building():
        return np.asarray(inertia(ca.DM(s)))


def inertia_matrices(s: Float[np.ndarray, "n 5"]) -> Float[np.ndarray, "n 3 3"]:
    """`inertia_matrix` of every row, in one call."""
    with building():
        S = np.asarray(_second_moments_function()(s.T)).reshape(3, len(s), 3).swapaxes(0, 1)
    trace = np.trace(S, axis1=1, axis2=2)[:, np.newaxis, np.newaxis]
    with np.errstate(invalid="ignore"):  # of numbers too large to be a body's
        # symbolically tr(S) - S_33 would be simplified to S_11 + S_22, which rounds in another way
        return np.where(np.eye(3, dtype=bool), trace - S, 0.0 - S)


@cache
def _second_moments_function() -> ca.Function:
    s = ca.SX.sym("s", DIMENSION)
    return ca.Function("second_moments", [s], [second_moments(s)])


def from_inertia(J: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, " 5"]:
    """The s whose J(s) is proportional to J.

    Raises
    ------
    InputError
        When J is no rigid body, that is when a principal moment reaches the sum of the other two (`SINGULAR`).
    """
    S = second_moments_of(J)
    smallest, _, largest = np.linalg.eigvalsh(S)
    if not smallest > SINGULAR * largest:
        raise InputError(
            f"inertia with principal moments {np.linalg.eigvalsh(J).tolist()} is no rigid body: each must be less than "
            "the sum of the other two; give moments that satisfy the triangle inequality"
        )
    L = np.linalg.cholesky(S / np.cbrt(np.linalg.det(S)))
    return np.array([np.log(L[0, 0]), np.log(L[1, 1]), L[1, 0], L[2, 0], L[2, 1]])


def second_moments_of(J: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """S = tr(J) / 2 I - J of an inertia, in its unit."""
    return np.trace(J) / 2 * np.eye(3) - J


def inertia_entries(J: Expression) -> Expression:
    """The lower triangle of J, column by column (6)."""
    return ca.vertcat(J[0, 0], J[1, 0], J[2, 0], J[1, 1], J[2, 1], J[2, 2])


def inertia_from_entries(j: Expression) -> Expression:
    """J, 3 x 3, from its `inertia_entries`."""
    return ca.vertcat(
        ca.horzcat(j[0], j[1], j[2]), ca.horzcat(j[1], j[3], j[4]), ca.horzcat(j[2], j[4], j[5])
    )


def traceless(d: Expression) -> Expression:
    """The symmetric D of trace zero with components d (5)."""
    return ca.vertcat(
        ca.horzcat(d[0], d[2], d[3]),
        ca.horzcat(d[2], d[1], d[4]),
        ca.horzcat(d[3], d[4], -d[0] - d[1]),
    )


def traceless_components(D: Expression) -> Expression:
    """(D_11, D_22, D_21, D_31, D_32) of the traceless part."""
    mean = ca.trace(D) / 3
    return ca.vertcat(D[0, 0] - mean, D[1, 1] - mean, D[1, 0], D[2, 0], D[2, 1])


def _relative(s: Expression, other: Expression) -> Expression:
    B = _lower_inverse(lower_factor(s)) @ lower_factor(other)
    return B @ B.T


def _cholesky(S: Expression) -> Expression:
    """Lower Cholesky factor of a 3 x 3 matrix."""
    a = ca.sqrt(S[0, 0])
    b, c = S[1, 0] / a, S[2, 0] / a
    e = ca.sqrt(S[1, 1] - b * b)
    f = (S[2, 1] - b * c) / e
    g = ca.sqrt(S[2, 2] - c * c - f * f)
    zero = 0 * a
    return ca.vertcat(ca.horzcat(a, zero, zero), ca.horzcat(b, e, zero), ca.horzcat(c, f, g))


def _lower_inverse(L: Expression) -> Expression:
    a, b, c = 1 / L[0, 0], 1 / L[1, 1], 1 / L[2, 2]
    ba = -L[1, 0] * a * b
    zero = 0 * a
    return ca.vertcat(
        ca.horzcat(a, zero, zero),
        ca.horzcat(ba, b, zero),
        ca.horzcat(-c * (L[2, 0] * a + L[2, 1] * ba), -L[2, 1] * b * c, c),
    )


SQUARINGS = 6
TAYLOR_ORDER = 11
"""With six squarings the truncation stays below rounding for eigenvalues within +-16."""
ROOT_ITERATIONS = (9, 7, 6, 5, 5)
"""Denman-Beavers iterations of each square root: enough for eigenvalues of the logarithm within +-16."""
SERIES_TERMS = 10


def exponential(D: Expression) -> Expression:
    """exp(D) by scaling and squaring of its Taylor series."""
    small = D / 2**SQUARINGS
    result = ca.DM.eye(3)
    for order in range(TAYLOR_ORDER, 0, -1):
        result = ca.DM.eye(3) + small @ result / order
    for _ in range(SQUARINGS):
        result = result @ result
    return result


def logarithm(X: Expression) -> Expression:
    """log(X) of a positive definite X.

    Repeated square roots, then 2 artanh((X - I)(X + I)^-1) as a series.
    Eigenvalue formulas would lose half the digits where eigenvalues meet, which for a sphere is everywhere.
    """
    eye = ca.DM.eye(3)
    for iterations in ROOT_ITERATIONS:
        X = _square_root(X, iterations)
    ratio = (X - eye) @ ca.inv_minor(X + eye)
    square, term, total = ratio @ ratio, ratio, ratio
    for k in range(1, SERIES_TERMS):
        term = term @ square
        total = total + term / (2 * k + 1)
    result = 2 ** (len(ROOT_ITERATIONS) + 1) * total
    return (result + result.T) / 2


def _square_root(X: Expression, iterations: int) -> Expression:
    """Denman and Beavers (1976): Y -> X^(1/2), Z -> X^(-1/2), quadratically."""
    Y, Z = X, ca.DM.eye(3)
    for _ in range(iterations):
        Y, Z = (Y + ca.inv_minor(Z)) / 2, (Z + ca.inv_minor(Y)) / 2
    return Y
