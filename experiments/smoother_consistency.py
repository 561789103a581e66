"""The smoother's batch problem beside bound and Table 6.4.

Solved at once: from the closed form to the optimum; the Cramer-Rao bound.
    python -m experiments.smoother_consistency [--seeds 24] [--start-seeds 100] [-o runs/smoother]

Simulates the common workload without its map, rich and thesis motion. What a campaign's rows do not hold: linearisations of two
schedules from the closed form, the NEES of the linear estimate about the truth (which tells wrong noise from what is not linear),
and the marginals of Table 6.4 of Tweddle (2013); errors beside the bound and NEES by block stand with them. The smoother epoch by
epoch in its modes is `experiments/studies/smoother-modes.toml`. A seed that has been run is read from the output folder.
"""

import argparse
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.progress import track

from experiments.benchmarks.smoother_workload import MOTIONS
from experiments.command_line import run_study
from experiments.smoother_figures import bound_figure, nees_figure
from experiments.smoother_report import batch_table, block_table, start_table, thesis_table
from experiments.smoother_runs import Arrays, SmootherCase, run_batch
from spinfilters.io.output_files import make_folder
from spinfilters.plots.style import save_figure
from spinfilters.run.array_files import read_arrays, write_arrays

Run = Callable[[SmootherCase], Arrays]


def main() -> None:
    """Run the study, print tables with bars, draw."""
    options = _options()
    console = Console(width=132)
    count = max(options.seeds, options.start_seeds)
    batch = {motion: all_runs(run_batch, _cases(motion, count), options) for motion in MOTIONS}
    accuracy = {motion: runs[: options.seeds] for motion, runs in batch.items()}
    console.print(batch_table(accuracy), block_table(accuracy), thesis_table(accuracy["thesis"]))
    if count > options.seeds:
        console.print(block_table(batch))
    console.print(start_table(batch))
    save_figure(nees_figure(accuracy), options.output / "nees.png")
    save_figure(bound_figure(accuracy), options.output / "bound.png")
    console.print(f"pictures: {options.output}")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=24, help="of each motion, for accuracy and modes")
    parser.add_argument("--start-seeds", type=int, default=100, help="of each motion, for the start")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/smoother"))
    return parser.parse_args()


def _cases(motion: str, seeds: int) -> list[SmootherCase]:
    return [SmootherCase(motion, seed) for seed in range(seeds)]


def all_runs(run: Run, cases: list[SmootherCase], options: argparse.Namespace) -> list[Arrays]:
    """Every case's arrays, in order; each is kept in a file of its own."""
    folder = options.output / run.__name__.removeprefix("run_")
    make_folder(folder)
    description = f"{folder.name}, {cases[0].motion}, {cases[0].epochs} frames"
    return list(
        track(_mapped(partial(kept, run, folder), cases, options.jobs), description, total=len(cases))
    )


def _mapped(run: Run, cases: list[SmootherCase], jobs: int) -> Iterable[Arrays]:
    if jobs == 1:
        yield from map(run, cases)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(run, cases)


def kept(run: Run, folder: Path, case: SmootherCase) -> Arrays:
    """Arrays of a case from its file, computed first if missing."""
    path = folder / f"{case.label}.npz"
    if not path.exists():
        write_arrays(path, run(case))
    return read_arrays(path)


if __name__ == "__main__":
    run_study(main)
