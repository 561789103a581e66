"""Estimated constants such as drag or gyro bias.

Values, standard deviations, names in files.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from spinfilters.state.block import ReportedConstant, StateBlock
from spinfilters.state.block_table import BLOCKS
from spinfilters.state.gaussian import Gaussian

REPORTED: Final[Mapping[str, ReportedConstant]] = {
    block.name: block.reported for block in BLOCKS.values() if block.reported is not None
}
"""How they are shown, by the name of their block."""


@dataclass(frozen=True)
class ConstantEstimate:
    """A constant block as one belief sees it, in the unit of the block."""

    block: StateBlock
    value: Float[np.ndarray, " k"]
    std: Float[np.ndarray, " k"]


def constant_estimates(belief: Gaussian) -> dict[str, ConstantEstimate]:
    """Estimates of a belief's blocks in `REPORTED`, by name."""
    layout, std = belief.layout, belief.std
    held = [block for block in layout.constant if block.name in REPORTED]
    return {
        block.name: ConstantEstimate(
            block, belief.mean[layout.mean_slice(block.name)], std[layout.slice(block.name)]
        )
        for block in held
    }


def constant_numbers(estimates: Mapping[str, ConstantEstimate]) -> dict[str, Any]:
    """Values and standard deviations by the keys of `REPORTED`.

    A number, or a list of several; None of what is not estimated.
    """
    return dict(_numbers(estimates))


def _numbers(estimates: Mapping[str, ConstantEstimate]) -> Iterator[tuple[str, Any]]:
    for name, reported in REPORTED.items():
        found = estimates.get(name)
        yield reported.value_key, None if found is None else _plain(found.value)
        yield reported.std_key, None if found is None else _plain(found.std)


def _plain(values: Float[np.ndarray, " k"]) -> float | list[float]:
    return float(values[0]) if len(values) == 1 else values.tolist()


def numbers_text(values: Iterable[float], form: str) -> str:
    """Numbers side by side in one format; "unknown" where one is none."""
    listed = list(values)
    return " ".join(format(value, form) for value in listed) if all(map(math.isfinite, listed)) else "unknown"
