"""Exponential and logarithm of symmetric 3 x 3 matrices as CasADi expressions, smooth at equal eigenvalues."""

import casadi as ca

from spinfilters.attitude.expressions import Expression

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
