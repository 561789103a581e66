"""The filters' own state: every block as `spinfilters.state` holds it, moved by the process model itself."""

import casadi as ca

from observability.charts.chart import Block, Chart, Values, attitude, vector
from spinfilters.attitude.expressions import Expression
from spinfilters.dynamics.mass_distribution import from_second_moments, inertia, lower_factor
from spinfilters.models.process import derivative
from spinfilters.state.layout import FULL_BLOCKS, StateLayout

SCALE = Block("n", 1, ("ln_scale",))
"""Logarithm of the inertia over J(s), which the filters do not hold: free motion does not depend on it."""
MASS = Block("s", 5, ("D_11", "D_22", "D_21", "D_31", "D_32"))


class FilterChart(Chart):
    """The state of a `StateLayout` without drag, with its own multiplicative errors.

    Parameters
    ----------
    with_scale: whether the scale of the inertia is one more unknown, as a known torque needs it.
    """

    def __init__(self, layout: StateLayout | None = None, with_scale: bool = False) -> None:
        self.layout = layout or StateLayout(FULL_BLOCKS)
        self.name = "filter state"
        special = {"a": attitude("q"), "s": MASS}
        own = tuple(special.get(name) or vector(name) for name in self.layout.blocks)
        self.blocks = (*own, SCALE) if with_scale else own

    def rates(self, values: Values) -> Values:
        """Rates of the filters' process without noise."""
        rates = self.layout.unpack(derivative(self.layout, self.layout.pack(values)))
        return rates | {"n": 0 * values["n"]} if "n" in values else rates

    def seen(self, values: Values) -> Values:
        """All blocks but the masses and the scale."""
        return {name: value for name, value in values.items() if name not in ("s", "n")}

    def torque_field(self, values: Values) -> Values:
        """J^-1 over the scale."""
        scale = ca.exp(-values["n"]) if "n" in values else 1
        return {"w": scale * ca.inv_minor(inertia(values["s"]))}

    def directions(self, values: Values) -> Expression:
        """Derivative of the retraction at 0."""
        d = ca.SX.sym("d", self.layout.error_dim)
        moved = self.layout.retract_expression(self.layout.pack(values), d)
        own = ca.substitute(ca.jacobian(moved, d), d, ca.SX.zeros(*d.shape))
        return ca.diagcat(own, 1) if "n" in values else own

    def change(self, values: Values, moved: Values) -> Expression:
        """Change of the masses as S, where moved beside s.

        No move changes s itself.
        """
        return super().change(values, moved | {"s": moved.get("S", moved["s"])})

    def settled(self, moved: Values) -> Values:
        """s of the second moments that a move has left."""
        if "S" not in moved:
            return moved
        S = moved["S"]
        return moved | {"s": from_second_moments(S / ca.det(S) ** (1 / 3))}

    def _block_change(self, block: Block, value: Expression, moved: Expression) -> Expression:
        """Change of the masses, where ``moved`` is S.

        The traceless part of L^-1 S L^-T, without a logarithm or a root.
        """
        if block.name != "s":
            return super()._block_change(block, value, moved)
        inverse = ca.inv_minor(lower_factor(value))
        D = inverse @ moved @ inverse.T
        mean = ca.trace(D) / 3
        return ca.vertcat(D[0, 0] - mean, D[1, 1] - mean, D[1, 0], D[2, 0], D[2, 1])


def with_second_moments(values: Values, J: Expression) -> Values:
    """The blocks with the inertia as second moments, S = tr(J)/2 I - J.

    Beside s until the chart settles them.
    """
    return values | {"S": ca.trace(J) / 2 * ca.DM.eye(3) - J}
