"""The inertia tensor in geometric axes: a chart that equal moments leave regular."""

import casadi as ca

from observability.charts.chart import Block, Chart, Values, attitude, vector
from spinfilters.attitude.expressions import Expression, quaternion_rate, rotate
from spinfilters.models.process import body_acceleration

TENSOR = Block("J", 6, ("J_xx", "J_yy", "J_zz", "J_xy", "J_xz", "J_yz"))


class TensorChart(Chart):
    """Chart in g axes: w with all six entries of J.

    Free motion shows five of them; optionally q (of q_ig); optionally t, v, c.
    """

    def __init__(self, with_attitude: bool = True, with_place: bool = True) -> None:
        self.name, self.has_turned_axes = "inertia tensor", True
        self.blocks = (
            *((vector("t"),) if with_place else ()),
            *((attitude("q"),) if with_attitude else ()),
            *((vector("v"),) if with_place else ()),
            vector("w"),
            *((vector("c"),) if with_place else ()),
            TENSOR,
        )

    def rates(self, values: Values) -> Values:
        """Euler's equations in g axes, and the kinematics of t and q."""
        rates = {name: 0 * value for name, value in values.items()}
        rates["w"] = body_acceleration(values["w"], symmetric(values["J"]))
        if "q" in values:
            rates["q"] = quaternion_rate(values["q"], values["w"])
        if "t" in values:
            rates["t"] = values["v"] - rotate(values["q"], ca.cross(values["w"], values["c"]))
        return rates

    def seen(self, values: Values) -> Values:
        """All blocks but the inertia."""
        return {name: value for name, value in values.items() if name != "J"}

    def torque_field(self, values: Values) -> Values:
        """J^-1."""
        return {"w": ca.inv_minor(symmetric(values["J"]))}


def symmetric(entries: Expression) -> Expression:
    """The 3 x 3 matrix of (xx, yy, zz, xy, xz, yz)."""
    xx, yy, zz, xy, xz, yz = (entries[k] for k in range(6))
    return ca.vertcat(ca.horzcat(xx, xy, xz), ca.horzcat(xy, yy, yz), ca.horzcat(xz, yz, zz))


def entries(matrix: Expression) -> Expression:
    """The inverse of `symmetric`."""
    return ca.vertcat(matrix[0, 0], matrix[1, 1], matrix[2, 2], matrix[0, 1], matrix[0, 2], matrix[1, 2])
