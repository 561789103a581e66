"""Mass distribution: five numbers of which every value is a physical body, and what follows from them.

The second-moment matrix about the centre of mass, S = integral of p p' dm, is L L' with L lower triangular and of unit
determinant. ``s = (l_1, l_2, l_21, l_31, l_32)``: exp(l_1), exp(l_2), exp(-l_1 - l_2) stand on the diagonal of L and l_ij below
it. ``s = 0`` is the sphere. The inertia is J = tr(S) I - S up to scale, so the triangle inequality holds by construction, where
the thesis' chart k1, k2 (Tweddle 2013, Eqs 4.97-4.99) also admits impossible bodies.
"""

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.attitude.expressions import Expression
from spinfilters.errors import InputError

DIMENSION = 5


def second_moments(s: Expression) -> Expression:
    """S(s), 3 x 3, positive definite, determinant one."""
    diagonal = ca.exp(ca.vertcat(s[0], s[1], -s[0] - s[1]))
    zero = 0 * s[0]
    L = ca.vertcat(
        ca.horzcat(diagonal[0], zero, zero),
        ca.horzcat(s[2], diagonal[1], zero),
        ca.horzcat(s[3], s[4], diagonal[2]),
    )
    return L @ L.T


def inertia(s: Expression) -> Expression:
    """J(s) in g axes up to scale, 3 x 3: tr(S) I - S."""
    S = second_moments(s)
    return ca.trace(S) * ca.DM.eye(3) - S


def inertia_matrix(s: Float[np.ndarray, " 5"]) -> Float[np.ndarray, "3 3"]:
    """J(s) in g axes up to scale, as numbers."""
    return np.asarray(inertia(ca.DM(s)))


def from_inertia(J: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, " 5"]:
    """The s whose J(s) is proportional to J.

    Raises
    ------
    InputError: when J is no rigid body, that is when a principal moment reaches the sum of the other two.
    """
    S = np.trace(J) / 2 * np.eye(3) - J
    smallest = float(np.linalg.eigvalsh(S)[0])
    if not smallest > 0:
        raise InputError(
            f"inertia with principal moments {np.linalg.eigvalsh(J).tolist()} is no rigid body: each must be less than the "
            "sum of the other two; give moments that satisfy the triangle inequality"
        )
    L = np.linalg.cholesky(S / np.cbrt(np.linalg.det(S)))
    return np.array([np.log(L[0, 0]), np.log(L[1, 1]), L[1, 0], L[2, 0], L[2, 1]])
