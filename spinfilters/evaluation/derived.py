"""Quantities that follow from a state, with their derivative by the state's error."""

from collections.abc import Callable

import casadi as ca

from spinfilters.attitude.expressions import Expression
from spinfilters.state.layout import StateLayout
from spinfilters.symbolic import Compiled

Quantity = Callable[[dict[str, Expression]], Expression]
"""A column vector or matrix of the blocks of a state (as `StateLayout.unpack`)."""


def with_error_jacobian(layout: StateLayout, name: str, quantity: Quantity) -> Compiled:
    """x -> (y, dy/dd at d = 0) with y = quantity(x [+] d), over any leading axes of x.

    The derivative goes through the layout's own retraction, so it is right for every error chart. A matrix y
    comes as the column of its columns. Interpreted: it is called once per history, which no compiler repays.
    """
    x, d = ca.SX.sym("x", layout.mean_dim), ca.SX.sym("d", layout.error_dim)
    moved = ca.vec(quantity(layout.unpack(layout.retract_expression(x, d))))
    value, jacobian = (
        ca.substitute(y, d, ca.DM.zeros(layout.error_dim)) for y in (moved, ca.jacobian(moved, d))
    )
    return Compiled.interpreted(ca.Function(name, [x], [value, jacobian], ["x"], ["y", "Y"]))
