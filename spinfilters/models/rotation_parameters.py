"""Numbers by which the constants of a state enter the equation of the body rate."""

import casadi as ca

from spinfilters.attitude.expressions import Expression
from spinfilters.state.layout import StateLayout


def rotation_parameters(layout: StateLayout, values: dict[str, Expression]) -> Expression:
    """Constants that enter the rotation, block after block.

    Six entries of J(s), then the drag.
    """
    return ca.vertcat(
        *[block.rotation.of(values[block.symbol]) for block in layout.members if block.rotation]
    )


def rotation_parameter_slices(layout: StateLayout) -> dict[str, slice]:
    """Slices of each block's numbers among the `rotation_parameters`."""
    places, end = {}, 0
    for block in layout.members:
        if block.rotation is not None:
            places[block.name] = slice(end, end + block.rotation.count)
            end += block.rotation.count
    return places
