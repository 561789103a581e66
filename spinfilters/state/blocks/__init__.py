"""Table of all state blocks: those that the modules of this folder call ``BLOCKS``."""

from collections.abc import Iterator, Mapping
from importlib import import_module
from pkgutil import iter_modules
from types import MappingProxyType
from typing import Final

from spinfilters.errors import InputError
from spinfilters.state.block import StateBlock


def _defined() -> Iterator[StateBlock]:
    for module in iter_modules(__path__, f"{__name__}."):
        yield from import_module(module.name).BLOCKS


def table(blocks: Iterator[StateBlock]) -> Mapping[str, StateBlock]:
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


BLOCKS: Final = table(_defined())
"""Every state block by name, in the order in which a layout holds them."""
