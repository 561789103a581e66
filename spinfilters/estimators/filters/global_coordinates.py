"""Global coordinates of a state for additive filters.

One vector of plain numbers: attitude as its total 4 x MRP, the rest as it is.
"""

from functools import cache

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.attitude.expressions import Expression, mrp_from_quaternion, quaternion_from_mrp, shadow_mrp
from spinfilters.state.blocks.rigid_body import ATTITUDE
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.layout import StateLayout
from spinfilters.symbolic.compiled import Compiled
from spinfilters.symbolic.working_time import built_property

LARGEST_MRP = 4.0
"""|a| at half a revolution: beyond it the shadow set is the shorter name of the same attitude."""


@cache
def global_coordinates(layout: StateLayout) -> "GlobalCoordinates":
    """Global coordinates of a layout, cached."""
    return GlobalCoordinates(layout)


class GlobalCoordinates:
    """Global coordinates xi (error_dim,) of the states of a layout.

    The 4 x MRP of q_ig, the numbers s, every other block itself.

    Errors of xi add; about a point they are C = d xi / d d times the layout's multiplicative error d, to first order. An attitude
    has two MRPs; which one is meant follows from the sign of the quaternion, which no step or sensor flips.
    """

    def __init__(self, layout: StateLayout) -> None:
        self.layout = layout

    def coordinates(self, x: Float[np.ndarray, "*batch m"]) -> Float[np.ndarray, "*batch n"]:
        """Global coordinates of states.

        On the MRP's branch of their quaternion's sign: |a| <= 4 where q_4 >= 0; singular at q_4 = -1.
        """
        return self._coordinates(x)[0]

    def point(self, xi: Float[np.ndarray, "*batch n"]) -> Float[np.ndarray, "*batch m"]:
        """Points of coordinates, the inverse of `coordinates`."""
        return self._point(xi)[0]

    def derivative(self, xi: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n n"]:
        """C(xi): derivative of the coordinates with respect to the multiplicative error."""
        return self._derivative(xi)[0]

    def shortened(
        self, xi: Float[np.ndarray, " n"], covariance: Float[np.ndarray, "n n"]
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n n"]]:
        """Mean and covariance after a switch to the shadow MRP where |a| > 4, unchanged elsewhere."""
        if not self.layout.has(ATTITUDE) or np.linalg.norm(xi[self.layout.slice("a")]) <= LARGEST_MRP:
            return xi, covariance
        switched, jacobian = self._shadow(xi)
        return switched, jacobian @ covariance @ jacobian.T

    def from_belief(self, belief: Gaussian) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n n"]]:
        """Mean and covariance of a belief in global coordinates, |a| <= 4.

        What a later switch to the shadow set needs is built here.
        """
        if self.layout.has(ATTITUDE):
            self._shadow.build()
        x = belief.mean.copy()
        if self.layout.has(ATTITUDE):
            q = self.layout.mean_slice("a")
            x[q] *= np.copysign(1.0, x[q.stop - 1])
        xi = self.coordinates(x)
        factor = self.derivative(xi) @ belief.factor
        return xi, factor @ factor.T

    def to_belief(self, xi: Float[np.ndarray, " n"], covariance: Float[np.ndarray, "n n"]) -> Gaussian:
        """Belief with the covariance C^-1 P C^-T.

        Raises
        ------
        numpy.linalg.LinAlgError: when the covariance is not finite or not positive definite; it is not repaired.
        """
        C = self.derivative(xi)
        half = np.linalg.solve(C, (covariance + covariance.T) / 2)
        P = np.linalg.solve(C, half.T)
        scale = np.sqrt(np.maximum(np.diag(P), 0.0))
        if not np.all(np.isfinite(scale) & (scale > 0)):
            raise np.linalg.LinAlgError(f"covariance has the diagonal {np.diag(P).tolist()}")
        P = (P + P.T) / 2 / np.outer(scale, scale)
        return Gaussian(self.layout, self.point(xi), scale[:, None] * np.linalg.cholesky(P))

    @built_property
    def _coordinates(self) -> Compiled:
        x = ca.SX.sym("x", self.layout.mean_dim)
        return Compiled(ca.Function("coordinates", [x], [self._coordinates_of(x)], ["x"], ["xi"]))

    def _coordinates_of(self, x: Expression) -> Expression:
        values = self.layout.unpack(x)
        if "q" in values:
            values["q"] = mrp_from_quaternion(values["q"])
        return self.layout.pack(values)

    @built_property
    def _point(self) -> Compiled:
        xi = ca.SX.sym("xi", self.layout.error_dim)
        return Compiled(ca.Function("point", [xi], [self._point_of(xi)], ["xi"], ["x"]))

    def _point_of(self, xi: Expression) -> Expression:
        values = {block.symbol: xi[self.layout.slice(block.name)] for block in self.layout.members}
        if self.layout.has(ATTITUDE):
            values[ATTITUDE.symbol] = quaternion_from_mrp(values[ATTITUDE.symbol])
        return self.layout.pack(values)

    @built_property
    def _derivative(self) -> Compiled:
        xi, d = ca.SX.sym("xi", self.layout.error_dim), ca.SX.sym("d", self.layout.error_dim)
        moved = self._coordinates_of(self.layout.retract_expression(self._point_of(xi), d))
        C = ca.substitute(ca.jacobian(moved, d), d, ca.SX.zeros(*d.shape))
        return Compiled(ca.Function("chart_derivative", [xi], [C], ["xi"], ["C"]))

    @built_property
    def _shadow(self) -> Compiled:
        xi, a = ca.SX.sym("xi", self.layout.error_dim), self.layout.slice("a")
        switched = ca.vertcat(xi[: a.start], shadow_mrp(xi[a]), xi[a.stop :])
        outputs = [switched, ca.jacobian(switched, xi)]
        return Compiled(ca.Function("shadow", [xi], outputs, ["xi"], ["switched", "jacobian"]))
