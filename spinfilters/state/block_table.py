"""All state blocks by name; a new one gets a line here."""

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Final

from spinfilters.errors import InputError
from spinfilters.state.block import StateBlock
from spinfilters.state.blocks.acceleration import ACCELERATION
from spinfilters.state.blocks.drag import DRAG
from spinfilters.state.blocks.gyro_bias import GYRO_BIAS
from spinfilters.state.blocks.gyro_scale import GYRO_SCALE
from spinfilters.state.blocks.linear_drag import LINEAR_DRAG
from spinfilters.state.blocks.rigid_body import RIGID_BODY
from spinfilters.state.blocks.rotor import ROTOR
from spinfilters.state.blocks.torque import TORQUE

OWN_BLOCKS: Final = (*RIGID_BODY, ACCELERATION, DRAG, GYRO_BIAS, GYRO_SCALE, LINEAR_DRAG, ROTOR, TORQUE)


def table(blocks: Iterable[StateBlock]) -> Mapping[str, StateBlock]:
    """Blocks by name in the order of their ranks.

    Raises
    ------
    InputError: a name or a rank that two of them have.
    """
    ranked = sorted(blocks, key=lambda block: block.rank)
    for attribute in ("name", "rank"):
        values = [getattr(block, attribute) for block in ranked]
        twice = {str(value) for value in values if values.count(value) > 1}
        if twice:
            raise InputError(
                f"state blocks share the {attribute} {', '.join(sorted(twice))}; give each its own"
            )
    return MappingProxyType({block.name: block for block in ranked})


BLOCKS: Final = table(OWN_BLOCKS)
"""Every state block by name, in the order in which a layout holds them."""
