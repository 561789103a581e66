"""Numbers of campaigns for README and docs/results.md.

Each with the date, commit and machine that it comes from.
    spinfilters campaign experiments/studies/tracks.toml -o runs/tracks
    python -m experiments.campaign_numbers runs/tracks [more folders] [--over estimator=smoother fault.outliers=0.0]

Prints a row of Markdown per cell: NEES per degree of freedom with its 95 % interval and the band of its last epoch; errors of
position, attitude, velocity, rate and moments over the Cramer-Rao bound, or with --over the median (largest) over seeds of a run's
errors over those of the cell with these levels; how many were called ok and how many of these were right.
"""

import argparse
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from experiments.command_line import run_study
from spinfilters.campaigns.rows_folder import read_folder, read_rows
from spinfilters.campaigns.statistics import CellSummary, Interval, cell_summaries
from spinfilters.campaigns.study import Study
from spinfilters.core.errors import InputError

OVER_BOUND = ("position_m", "attitude_rad", "velocity_m_s", "rate_rad_s", "moment_1", "moment_2")
HEAD = (
    "study and cell",
    "runs",
    "NEES / dof",
    "last epoch (band)",
    "position, attitude, velocity, rate, two moments over {}",
    "ok; right of these",
    "date, commit, machine",
)


def main() -> None:
    """Print the rows of all folders."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument(
        "--over", nargs="+", default=[], metavar="FACTOR=LEVEL", help="levels of the cell to compare with"
    )
    given = parser.parse_args()
    over = dict(each.partition("=")[::2] for each in given.over)
    head = " | ".join(HEAD).format(", ".join(given.over) or "the bound")
    print(f"| {head} |\n|{'---|' * len(HEAD)}")
    for folder in given.folders:
        for line in rows_of(folder, over):
            print(line)


def rows_of(folder: Path, over: Mapping[str, str] = {}) -> Iterator[str]:
    """A campaign's rows of Markdown."""
    study, document = read_folder(folder)
    table = read_rows(folder, study.columns)
    rows = table.select(["cell", "seed", *(f"error_{name}" for name in OVER_BOUND)]).to_pandas()
    date = max(filter(None, table["finished"].to_pylist()))[:10]
    origin = f"{date}, {document['commit']}, {document['machine']}"
    for cell in cell_summaries(study, table):
        levels = ", ".join(
            cell.levels[name] if "." not in name else f"{name} {cell.levels[name]}" for name in study.varied
        )
        errors = (
            _over_cell(rows, cell.cell, _cell(study, {**cell.levels, **over})) if over else _over_bound(cell)
        )
        name = f"{study.name}: {levels or cell.levels['estimator']}"
        yield f"| {' | '.join((name, str(cell.runs), *_numbers(cell, errors), origin))} |"


def _cell(study: Study, levels: Mapping[str, str]) -> int:
    """Number of the cell with these levels. InputError: there is none."""
    found = [number for number, cell in enumerate(study.cells) if cell.levels == levels]
    if not found:
        raise InputError(f"{study.name} has no cell {', '.join(f'{k}={v}' for k, v in levels.items())}")
    return found[0]


def _over_cell(rows: pd.DataFrame, cell: int, reference: int) -> str:
    """Median and largest ratio of errors to the reference cell.

    Over seeds; the reference cell in the same seed.
    """
    own, other = (
        rows[rows["cell"] == number].set_index("seed").drop(columns="cell") for number in (cell, reference)
    )
    ratios = (own / other).dropna(how="all")
    return ", ".join(
        f"{ratios[f'error_{name}'].median():.2f} ({ratios[f'error_{name}'].max():.2f})" for name in OVER_BOUND
    )


def _over_bound(cell: CellSummary) -> str:
    return ", ".join(f"{cell.over_bound[f'error_{name}'].value:.2f}" for name in OVER_BOUND)


def _numbers(cell: CellSummary, errors: str) -> tuple[str, str, str, str]:
    low, high = cell.band
    right = "-" if not cell.right_of_ok.count else f"{cell.right_of_ok.value:.0%} of {cell.right_of_ok.count}"
    return (
        _interval(cell.nees),
        f"{cell.last.value:.2f} ({low:.2f} to {high:.2f})",
        errors,
        f"{cell.ok.value:.0%}; {right}",
    )


def _interval(found: Interval) -> str:
    limits = f" ({found.low:.2f} to {found.high:.2f})" if np.isfinite(found.low) else ""
    return f"{found.value:.2f}{limits}"


if __name__ == "__main__":
    run_study(main)
