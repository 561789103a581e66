"""Numbers of campaigns for README and docs/results.md, each with the date, commit and machine that it comes from.

    spinfilters campaign experiments/studies/tracks.toml -o runs/tracks
    python -m experiments.campaign_numbers runs/tracks [more folders]

Prints a row of Markdown per cell: NEES per degree of freedom with its 95 % interval and the band of its last epoch, errors of
position, attitude, velocity, rate and moments over the Cramer-Rao bound, how many were called ok and how many of these were right.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from spinfilters.campaigns.campaign_folder import read_folder
from spinfilters.campaigns.report.intervals import Interval
from spinfilters.campaigns.report.statistics import CellSummary, cell_summaries
from spinfilters.campaigns.rows_folder import read_rows

OVER_BOUND = ("position_m", "attitude_rad", "velocity_m_s", "rate_rad_s", "moment_1", "moment_2")
HEAD = (
    "study and cell",
    "runs",
    "NEES / dof",
    "last epoch (band)",
    "position, attitude, velocity, rate, two moments over the bound",
    "ok; right of these",
    "date, commit, machine",
)


def main() -> None:
    """Print the rows of all folders."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", type=Path, nargs="+")
    print(f"| {' | '.join(HEAD)} |\n|{'---|' * len(HEAD)}")
    for folder in parser.parse_args().folders:
        for line in rows_of(folder):
            print(line)


def rows_of(folder: Path) -> Iterator[str]:
    """A campaign's rows of Markdown."""
    study, document = read_folder(folder)
    table = read_rows(folder, study.columns)
    date = max(filter(None, table["finished"].to_pylist()))[:10]
    origin = f"{date}, {document['commit']}, {document['machine']}"
    for cell in cell_summaries(study, table):
        levels = ", ".join(
            cell.levels[name] if "." not in name else f"{name} {cell.levels[name]}" for name in study.varied
        )
        cells = (
            f"{study.name}: {levels or cell.levels['estimator']}",
            str(cell.runs),
            *_numbers(cell),
            origin,
        )
        yield f"| {' | '.join(cells)} |"


def _numbers(cell: CellSummary) -> tuple[str, str, str, str]:
    low, high = cell.band
    right = "-" if not cell.right_of_ok.count else f"{cell.right_of_ok.value:.0%} of {cell.right_of_ok.count}"
    return (
        _interval(cell.nees),
        f"{cell.last.value:.2f} ({low:.2f} to {high:.2f})",
        ", ".join(f"{cell.over_bound[name].value:.2f}" for name in OVER_BOUND),
        f"{cell.ok.value:.0%}; {right}",
    )


def _interval(found: Interval) -> str:
    limits = f" ({found.low:.2f} to {found.high:.2f})" if np.isfinite(found.low) else ""
    return f"{found.value:.2f}{limits}"


if __name__ == "__main__":
    main()
