"""The thesis' chart: principal frame at the centre of mass, pose of g."""

import casadi as ca

from observability.charts.chart import Block, Chart, Values, attitude, vector
from spinfilters.attitude.expressions import (
    Expression,
    conjugate,
    matrix_from_quaternion,
    product,
    quaternion_rate,
    rotate,
)
from spinfilters.models.process import body_acceleration

RATIOS = vector("k", "12")
"""k1 = ln(Jxx/Jyy), k2 = ln(Jyy/Jzz) (Tweddle 2013, Eqs 4.97-4.98)."""
MOMENTS = vector("J", "xyz")
"""Principal moments (Tweddle 2013, Eq. 3.11)."""


class PrincipalChart(Chart):
    """Chart in principal axes b: w with k1, k2 or three moments.

    Optionally attitudes q_ib, q_gb; optionally r, v, c.
    R_ig = R_ib R_gb', t = r - R_ig c (Tweddle 2013, section 4.6; his T_gb is c). Singular where moments are equal: the axes b
    are then no function of the body.

    Parameters
    ----------
    inertia: `RATIOS` or `MOMENTS`.
    with_attitude, with_place: whether the blocks q_ib and q_gb, and r, v and c, belong to the state.
    """

    def __init__(self, inertia: Block = RATIOS, with_attitude: bool = True, with_place: bool = True) -> None:
        place, turned = (vector("r"), vector("v")), (attitude("q_ib"),)
        self.name, self.has_turned_axes = "principal axes", with_attitude
        self.blocks = (
            *(place if with_place else ()),
            *(turned if with_attitude else ()),
            vector("w"),
            inertia,
            *((attitude("q_gb"),) if with_attitude else ()),
            *((vector("c"),) if with_place else ()),
        )

    def rates(self, values: Values) -> Values:
        """Euler's equations in principal axes, and the kinematics of r and q_ib."""
        rates = {name: 0 * value for name, value in values.items()}
        rates["w"] = body_acceleration(values["w"], principal_inertia(values))
        if "q_ib" in values:
            rates["q_ib"] = quaternion_rate(values["q_ib"], values["w"])
        if "r" in values:
            rates["r"] = values["v"]
        return rates

    def seen(self, values: Values) -> Values:
        """q_ig, w in g axes, t = r - R_ig c, v and c."""
        if "q_ib" not in values:
            return {"w": values["w"]}
        q = product(values["q_ib"], conjugate(values["q_gb"]))
        seen = {"q": q, "w": rotate(values["q_gb"], values["w"])}
        if "r" in values:
            seen |= {"t": values["r"] - rotate(q, values["c"]), "v": values["v"], "c": values["c"]}
        return seen

    def torque_field(self, values: Values) -> Values:
        """Torque columns in axes b, equal to axes g where the chart holds no q_gb."""
        inverse = ca.inv_minor(principal_inertia(values))
        if "q_gb" in values:
            inverse = inverse @ matrix_from_quaternion(values["q_gb"]).T
        return {"w": inverse}


def principal_inertia(values: Values) -> Expression:
    """J in principal axes: diag(e^k1, 1, e^-k2) (Tweddle 2013, Eq. 4.99), or of the three moments."""
    if "J" in values:
        return ca.diag(values["J"])
    return ca.diag(ca.vertcat(ca.exp(values["k"][0]), 1, ca.exp(-values["k"][1])))
