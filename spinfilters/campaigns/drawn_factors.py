"""Factors drawn per seed, log-uniform between two limits.

In a study file `{ log_uniform = [0.2, 4.0] }` in the place of a number. A seed draws the same share of every range of that number,
whatever the cell, so that cells are compared on the same draws.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from spinfilters.campaigns.recording_factors import RecordingFactors
from spinfilters.data.input_file import value_text
from spinfilters.errors import InputError

LOG_UNIFORM: Final = "log_uniform"


@dataclass(frozen=True)
class DrawnNumber:
    """A number of a table of factors, by its limits."""

    table: str
    key: str
    smallest: float
    largest: float

    def at(self, seeds: np.random.SeedSequence) -> float:
        """Value drawn by the generator of a seed."""
        own = np.random.SeedSequence(
            seeds.entropy, spawn_key=(*seeds.spawn_key, *f"{self.table}.{self.key}".encode())
        )
        share = np.random.default_rng(own).random()
        return float(self.smallest * (self.largest / self.smallest) ** share)


def drawn_numbers(kind: str, table: Mapping[str, Any]) -> tuple[DrawnNumber, ...]:
    """Drawn numbers of a table of factors. InputError: limits that do not ascend."""
    return tuple(_number(kind, key, value) for key, value in table.items() if isinstance(value, Mapping))


def with_draws(
    factors: RecordingFactors, drawn: tuple[DrawnNumber, ...], seeds: np.random.SeedSequence
) -> RecordingFactors:
    """Factors of one seed with its drawn values."""
    for number in drawn:
        table = getattr(factors, number.table)
        factors = replace(factors, **{number.table: replace(table, **{number.key: number.at(seeds)})})
    return factors


def _number(kind: str, key: str, value: Mapping[str, Any]) -> DrawnNumber:
    limits = value.get(LOG_UNIFORM) if value.keys() == {LOG_UNIFORM} else None
    if not isinstance(limits, list) or not _ascend(limits):
        raise InputError(
            f"{kind}.{key} is {value_text(value)}; give a number, or {{ {LOG_UNIFORM} = [1.0, 2.0] }} with two positive ones that "
            "ascend, with decimal points"
        )
    return DrawnNumber(kind, key, *limits)


def _ascend(limits: list[Any]) -> bool:
    """Whether these are two positive numbers with a decimal point that ascend."""
    return len(limits) == 2 and all(isinstance(x, float) for x in limits) and 0 < limits[0] < limits[1]
