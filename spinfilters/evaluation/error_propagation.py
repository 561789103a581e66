"""Derived quantities of a state, with their Jacobian by its error."""

from collections.abc import Callable
from typing import Final

import casadi as ca
import numpy as np

from spinfilters.attitude.expressions import Expression
from spinfilters.state.layout import StateLayout
from spinfilters.symbolic import Compiled

Quantity = Callable[[dict[str, Expression]], Expression]
"""A column vector or matrix of the blocks of a state (as `StateLayout.unpack`)."""
STRETCH: Final[int] = 1024
"""Epochs whose derivatives are in memory together: they take ten times the room of what follows from them."""


def by_stretches(epochs: int, derive: Callable[[slice], dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Named arrays over so many epochs, at least one, from those of stretches of the epochs."""
    whole: dict[str, np.ndarray] = {}
    for start in range(0, epochs, STRETCH):
        rows = slice(start, min(start + STRETCH, epochs))
        for name, part in derive(rows).items():
            if name not in whole:
                whole[name] = np.empty((epochs, *part.shape[1:]), part.dtype)
            whole[name][rows] = part
    return whole


def with_error_jacobian(layout: StateLayout, name: str, quantity: Quantity) -> Compiled:
    """x -> (y, dy/dd at d = 0) with y = quantity(x [+] d).

    Over any leading axes of x.
    The derivative goes through the layout's own retraction, so it is right for every error chart. A matrix y
    comes as the column of its columns. Interpreted: it is called once per history, which no compiler repays.
    """
    x, d = ca.SX.sym("x", layout.mean_dim), ca.SX.sym("d", layout.error_dim)
    moved = ca.vec(quantity(layout.unpack(layout.retract_expression(x, d))))
    value, jacobian = (
        ca.substitute(y, d, ca.DM.zeros(layout.error_dim)) for y in (moved, ca.jacobian(moved, d))
    )
    return Compiled.interpreted(ca.Function(name, [x], [value, jacobian], ["x"], ["y", "Y"]))
