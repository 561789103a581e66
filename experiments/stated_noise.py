"""Doubts about stated noise, and the levels that they name.

    spinfilters campaign experiments/studies/stated-noise-gyro.toml -o runs/stated-noise-gyro     # also -poses, -tracks
    python -m experiments.stated_noise runs/stated-noise-gyro [runs/stated-noise-poses runs/stated-noise-tracks]

A sensor's noise is stated at a multiple of the true level, the name of the cell's settings. Printed are, of each estimator and
multiple, verdicts that are ``ok``, verdicts that doubt a level of the sensor, those whose level is within a fifth of the true one,
and the largest error of an ``ok`` estimate in its stated deviations.
"""

import re
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pandas as pd

from experiments.command_line import run_study
from experiments.honest_noise import print_tables

NEAR = 1.2
"""Of a named level to the true one."""
TOLD = re.compile(r"sensors\.(\w+) is \S+, the data have (\S+)")
CELL = ("estimator", "settings")
HEAD = ("estimator, times the true level", "ok", "doubted", "level within a fifth", "worst error of ok")


def main() -> None:
    """Print the rows of all folders."""
    print_tables(__doc__, HEAD, rows_of)


def rows_of(table: pd.DataFrame) -> Iterator[str]:
    """A row of Markdown for every estimator and multiple."""
    for levels, own in table.groupby(list(CELL), sort=False):
        assert isinstance(levels, tuple)
        ok, told = own["verdict"] == "ok", own["verdict_reasons"].fillna("").map(named_level)
        doubted = [each is not None for each in told]
        near = [is_near(row, each) for (_, row), each in zip(own.iterrows(), told, strict=True)]
        worst = own.loc[ok, "worst_error"].max()
        cells = (f"{ok.sum()} of {len(own)}", f"{sum(doubted)}", f"{sum(near)}", f"{worst:.1f}")
        yield f"| {' | '.join((', '.join(map(str, levels)), *cells))} |"


class NamedLevel(NamedTuple):
    """A sensor's level of noise that a verdict says the data have."""

    name: str
    value: float


def named_level(reasons: str) -> NamedLevel | None:
    """The level of a sensor in the reasons for doubt."""
    found = TOLD.search(reasons)
    return None if found is None else NamedLevel(found[1], float(found[2]))


def is_near(row: pd.Series, named: NamedLevel | None) -> bool:
    """Whether a named level is near the true one."""
    return named is not None and bool(abs(np.log(named.value / row[f"true_{named.name}"])) < np.log(NEAR))


if __name__ == "__main__":
    run_study(main)
