"""Further coordinates in which a filter assumes a Gaussian error of pose, velocity and rate, besides those of the layout.

To first order all of them are linear functions of one another, so that predictions and gains agree. They differ in how an update
moves the mean, x <- phi(x, d), and in how the covariance follows. With R = R_ig, t, v, w of the layout, Exp the rotation by a
rotation vector theta and J its left Jacobian:

    mrp                R Exp, by 4 x MRP; t + rho, v + nu, w + omega                          (body side; the layout's own)
    rotation-vector    R Exp(theta);      t + rho, v + nu, w + omega                          (body side)
    inertial           Exp(theta) R;      t + rho, v + nu, w + omega                          (inertial side)
    coupled            R Exp(theta);      t + R J rho, v + R J nu, w + omega                  (body side, SE_2(3))
    coupled-inertial   Exp(theta) R;      Exp t + J rho, Exp v + J nu, R' Exp' (Exp R w + J omega)   (inertial side, SE_2(3) x rate)

A rigid motion of frame i changes neither the dynamics of a free body nor its rate in body axes. ``coupled`` is the error that this
symmetry leaves unchanged (left-invariant; Barrau, Bonnabel 2017); ``coupled-inertial`` keeps the rate of the target in inertial
axes together with its attitude (cf. Serrano, Guerreiro, Lourenço, Cunha 2025, arXiv 2506.06016). Constants keep their own errors.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Final, Literal

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_expressions import (
    Expression,
    conjugate,
    cross_matrix,
    product,
    quaternion_from_rotation_vector,
    rotate,
)
from spinfilters.core.compiled import Compiled
from spinfilters.core.working_time import building, built_property
from spinfilters.models.state_layout import StateLayout

CoordinateName = Literal["mrp", "rotation-vector", "inertial", "coupled", "coupled-inertial"]
Point = dict[str, Expression]
Moved = Callable[[Point, Point], Point]
"""Blocks of a point moved by an error, from the blocks of both by `StateBlock.symbol` and `StateBlock.name`."""

SERIES_BELOW = 0.25
"""Squared angle, rad^2, below which the coefficients of J are series: both sides agree to rounding there."""
NO_ANGLE = 1e-30
"""Added to a squared angle, so that its root has a derivative at zero."""


def left_jacobian(theta: Expression) -> Expression:
    """J(theta) = I + b [theta]x + c [theta]x^2 with Exp(theta + e) = Exp(J e) Exp(theta) to first order in e.

    b = (1 - cos)/angle^2, c = (angle - sin)/angle^3.
    """
    square = ca.dot(theta, theta) + NO_ANGLE
    b = ca.if_else(square < SERIES_BELOW, _series(square, 2), (1 - ca.cos(ca.sqrt(square))) / square)
    far = ca.fmax(square, SERIES_BELOW)  # keeps the branch that is not taken finite
    angle = ca.sqrt(far)
    c = ca.if_else(square < SERIES_BELOW, _series(square, 3), (angle - ca.sin(angle)) / (far * angle))
    K = cross_matrix(theta)
    return ca.DM.eye(3) + b * K + c * (K @ K)


def _series(square: Expression, first: int) -> Expression:
    """1/n! - square/(n+2)! + square^2/(n+4)! - ..., n = ``first``, to rounding for squares below `SERIES_BELOW`."""
    total: Expression = 0 * square
    term, n = 1.0 / float(np.prod(np.arange(1, first + 1))), first
    for power in range(8):
        total = total + term * (-square) ** power
        term /= (n + 1) * (n + 2)
        n += 2
    return total


def _rotation_vector(x: Point, d: Point) -> Point:
    return {"q": product(x["q"], quaternion_from_rotation_vector(d["a"]))}


def _inertial(x: Point, d: Point) -> Point:
    return {"q": product(quaternion_from_rotation_vector(d["a"]), x["q"])}


def _couple_coordinates(x: Point, d: Point) -> Point:
    moved, J = _rotation_vector(x, d), left_jacobian(d["a"])
    for name in ("t", "v"):
        if name in x:
            moved[name] = x[name] + rotate(x["q"], J @ d[name])
    return moved


def _coupled_inertial(x: Point, d: Point) -> Point:
    turn, J = quaternion_from_rotation_vector(d["a"]), left_jacobian(d["a"])
    q = product(turn, x["q"])
    moved = {"q": q}
    for name in ("t", "v"):
        if name in x:
            moved[name] = rotate(turn, x[name]) + J @ d[name]
    moved["w"] = x["w"] + rotate(conjugate(q), J @ d["w"])
    return moved


_MOVED: Final[dict[str, Moved]] = {
    "mrp": lambda x, d: {},
    "rotation-vector": _rotation_vector,
    "inertial": _inertial,
    "coupled": _couple_coordinates,
    "coupled-inertial": _coupled_inertial,
}
"""By name; blocks that a function does not return move by their own charts."""


@dataclass(frozen=True)
class InvariantOptions:
    """Options of the invariant filter.

    Attributes
    ----------
    coordinates : CoordinateName
        Coordinates in which the error of the estimator "invariant" is Gaussian, see `spinfilters.filters.error_coordinates`. With
        "mrp" it is "mekf" without iterated updates. All other estimators keep 4 x MRP.
    """

    coordinates: CoordinateName = "coupled"


class ErrorCoordinates:
    """Coordinates d (error_dim,) of the errors of a layout's states.

    Parameters
    ----------
    layout : StateLayout
        Of the states; it has an attitude and a rate.
    name : CoordinateName
        Which coordinates.
    """

    def __init__(self, layout: StateLayout, name: CoordinateName) -> None:
        self.layout, self.name = layout, name

    def retract(self, x: Float[np.ndarray, " m"], d: Float[np.ndarray, " n"]) -> Float[np.ndarray, " m"]:
        """The point phi(x, d), its quaternion normalised."""
        return self._compile_folded(x, d)[0]

    def by_error(self, x: Float[np.ndarray, " m"]) -> Float[np.ndarray, "n n"]:
        """A(x): derivative of the layout's error about x by these coordinates, at d = 0."""
        return self._compile_folded(x, np.zeros(self.layout.error_dim))[1]

    def fold(
        self, x: Float[np.ndarray, " m"], error: Float[np.ndarray, " n"], factor: Float[np.ndarray, "n n"]
    ) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "n n"]]:
        """Fold an error's mean into a point, and move the covariance factor with it.

        Parameters
        ----------
        error, factor : ndarray
            Mean and covariance factor of the error about ``x``, linear in the layout's coordinates.

        Returns
        -------
        tuple
            The point phi(x, d), d = A^-1 error, and the factor B(x, d) A^-1 factor of the layout's error about it.
        """
        solved = np.linalg.solve(self.by_error(x), np.column_stack([error, factor]))
        point, B = self._compile_folded(x, solved[:, 0])
        return point, B @ solved[:, 1:]

    @built_property
    def _compile_folded(self) -> Compiled:
        """(x, d) -> phi(x, d), and the derivative of the layout's error about it by d."""
        return _folded_function(self.layout, self.name)


@cache
@building()
def _folded_function(layout: StateLayout, name: CoordinateName) -> Compiled:
    x = ca.SX.sym("x", layout.mean_dim)
    d, e = ca.SX.sym("d", layout.error_dim), ca.SX.sym("e", layout.error_dim)
    here, there = _moved_point(layout, name, x, d), _moved_point(layout, name, x, d + e)
    B = ca.jacobian(layout.near_local_expression(here, there), e)
    B = ca.substitute(B, e, ca.DM.zeros(layout.error_dim))
    return Compiled(ca.Function(f"fold_{name.replace('-', '_')}", [x, d], [here, B], ["x", "d"], ["y", "B"]))


def _moved_point(layout: StateLayout, name: CoordinateName, x: Expression, d: Expression) -> Expression:
    values, own = layout.unpack(x), layout.unpack(layout.retract_expression(x, d))
    errors = {block.name: d[layout.slice(block.name)] for block in layout.members}
    moved = own | _MOVED[name](values, errors)
    for block in layout.members:
        if block.chart.normalised is not None:
            moved[block.symbol] = block.chart.normalised(moved[block.symbol])
    return layout.pack(moved)
