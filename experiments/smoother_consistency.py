"""Monte Carlo of the smoother: is it as good as the bound allows, does it know it, and does it lose anything by letting go?

    python -m experiments.smoother_consistency [--seeds 24] [--start-seeds 100] [--long-seeds 8] [-o runs/smoother]

Simulates the workload disam115 without its map (`Scenario.common_workload`), rich and thesis motion. Batch: all frames at once
from the
closed form; errors beside the Cramer-Rao bound, mean NEES over runs and frames (20 degrees of freedom) with the 95 % band of the
mean over runs, and the NEES of the linear estimate about the truth, which tells wrong noise from what is not linear. Table 6.4 of
Tweddle (2013) beside ours. Frame by frame: latest estimates of every mode relative to those of the mode that keeps everything,
second half of the run, on disam115 and on a recording of 300 frames. A seed that has been run is read from the output folder, so
that an interrupted study goes on where it was.
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
from experiments.smoother_figures import bound_figure, nees_figure, sliding_figure
from experiments.smoother_report import batch_table, block_table, mode_table, start_table, thesis_table
from experiments.smoother_runs import FRAMES, Arrays, SmootherCase, run_batch, run_sliding
from spinfilters.data.atomic_write import make_folder
from spinfilters.plots.style import save_figure
from spinfilters.runs.npz_file import read_arrays, write_arrays

LONG = 300
"""Frames of the longer recording: more than twice what the default mode keeps."""
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
    for epochs, seeds in ((FRAMES, options.seeds), (LONG, options.long_seeds)):
        if not seeds:
            continue
        sliding = {m: all_runs(run_sliding, _cases(m, seeds, epochs), options) for m in MOTIONS}
        console.print(mode_table(sliding, epochs))
        save_figure(sliding_figure(sliding), options.output / f"sliding-{epochs}.png")
    console.print(f"pictures: {options.output}")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=24, help="of each motion, for accuracy and modes")
    parser.add_argument("--start-seeds", type=int, default=100, help="of each motion, for the start")
    parser.add_argument(
        "--long-seeds", type=int, default=8, help=f"of each motion, {LONG} frames; 0 for none"
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/smoother"))
    return parser.parse_args()


def _cases(motion: str, seeds: int, epochs: int = FRAMES) -> list[SmootherCase]:
    return [SmootherCase(motion, seed, epochs) for seed in range(seeds)]


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
    """A case's arrays from its file, run before if there is none."""
    path = folder / f"{case.label}.npz"
    if not path.exists():
        write_arrays(path, run(case))
    return read_arrays(path)


if __name__ == "__main__":
    main()
